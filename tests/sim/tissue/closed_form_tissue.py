"""Tissues for the tests of the twin whose force is known in closed form."""

import numpy as np

from sim.tissue.contact import Contact, ContactPatch

NOWHERE = ContactPatch(points_S=np.zeros((0, 3)), pressure=np.zeros(0), areas=np.zeros(0))


class SpringTissue:
    """A frictionless block under a level surface: its force is known in closed form."""

    def __init__(self, height: float, stiffness: float, skin_S: np.ndarray | None = None) -> None:
        self.height = height
        self.stiffness = stiffness
        self.skin_S = skin_S

    def press(self, X_SP, velocity_S):
        depth = max(0.0, self.height - float(X_SP[2, 3]))
        force_S = np.array([0.0, 0.0, self.stiffness * depth])
        return Contact(
            force_S=force_S,
            torque_S=np.zeros(3),
            depth=depth,
            vertices=int(depth > 0),
            centre_S=X_SP[:3, 3].copy(),
        )

    def deformed_skin(self):
        return self.skin_S

    def patch(self):
        return NOWHERE

    def reset(self):
        pass


class UndefinedTissue:
    """A tissue whose mathematics has broken down."""

    def press(self, X_SP, velocity_S):
        nowhere = np.full(3, np.nan)
        return Contact(force_S=nowhere, torque_S=nowhere, depth=0.0, vertices=0, centre_S=nowhere)

    def deformed_skin(self):
        return np.full((1, 3), np.nan)

    def patch(self):
        return NOWHERE

    def reset(self):
        pass


class ExplodingTissue(SpringTissue):
    """A spring that is stiffer than the time step can bear: 100 MN/m without damping."""

    def __init__(self, height: float) -> None:
        super().__init__(height, stiffness=1e8)
