# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""The phantom as MuJoCo's own deformable solid, for those who want nothing but MuJoCo, with what
that costs.

The solid lives in a small model of its own, beside a copy of the probe's face that is moved by
hand: MuJoCo's sensors do not see a flex's contacts, so the force is read from the contacts and
given to the arm as every mechanics gives it.

What was tried with MuJoCo 4.0 at 500 Hz. Only the `discrete` integrator is stable. Full tetrahedra
lock: with 300 vertices on the skin they are 40 % too stiff at 2 mm and 30 % too soft at 8 mm, where
the face slips between them. Quadratic cells diverge. Trilinear cells are stable; at a Poisson's
ratio of .45 they lock, at .3 and equal stiffness under contact 10 x 10 x 5 of them are 12 to 15 %
too stiff from 4 mm on (40 % at 2 mm), at a ninth of real time. Layers are left out: a flex has one
Young's modulus.
"""

import mujoco
import numpy as np
from jaxtyping import Float, Int

from breastscan.errors import ConfigError, RobotError
from breastscan.tissue.mesh import mesh_breast, skin_triangles
from sim.tissue.contact import Contact, ContactPatch, with_motion
from sim.tissue.interpolation import interpolation_matrix, interpolation_weights
from sim.tissue.phantom import Phantom
from sim.wrist.probe import lens
from sim.wrist.probe_face import ProbeFace

SKIN_POINTS = 800
"""Vertices of the skin that touch; they follow the cells."""
CELLS = (10, 10, 5)
"""Trilinear cells along x, y and z."""
POISSON = 0.3
"""Poisson's ratio of the cells [-]: nearer to .5 they lock."""
DENSITY = 1000.0
"""[kg/m^3] [VICTRE]"""
DAMPING = 0.01
"""Rayleigh's coefficient [s]: strains relax within 10 ms."""
PERIOD = 0.002
"""Step of the solid [s]."""
STRIDE = 1e-4
"""Longest travel of the probe in a step [m]; a press from farther off takes several."""
MAX_STEPS = 25
JUMP = 0.01
"""A probe that has moved farther since the last press comes down along its axis instead, from so
far off [m]."""
CONTACT = 'contype="1" conaffinity="1" condim="1" solref="0.004 1" solimp="0.95 0.99 0.001"'
"""Without friction: the gel's is added as for every mechanics."""


class FlexTissue:
    """The solid and the probe in MuJoCo. Every press is a step in time from the state before it."""

    def __init__(self, phantom: Phantom) -> None:
        """Describe and compile the solid.

        Raises:
            ConfigError: The phantom has layers, or lies on a curved chest.
        """
        if phantom.curvature != 0:
            raise ConfigError(
                'a flex stands on a flat chest only: use mechanics "soft" for a curved one',
                phantom.curvature,
            )
        if phantom.config.layers.present:
            raise ConfigError(
                'a flex has one stiffness throughout: use mechanics "soft" for layers',
                phantom.config,
            )
        self._phantom = phantom
        mesh = mesh_breast(phantom.embed, SKIN_POINTS)
        self._skin = np.flatnonzero(mesh.skin)
        self._undeformed_S = mesh.nodes[self._skin]
        self._normals_S = phantom.normal(mesh.direction[self._skin])
        near, weights = interpolation_weights(
            mesh.direction[self._skin], phantom.inverse_map(phantom.skin.vertices_S)
        )
        weights[phantom.skin.vertices_S[:, 2] == 0] = 0.0
        corners_S = mesh.nodes[skin_triangles(mesh)]
        across_S = np.cross(corners_S[:, 1] - corners_S[:, 0], corners_S[:, 2] - corners_S[:, 0])
        self._area = float(np.linalg.norm(across_S, axis=1).sum() / 2 / len(self._skin))
        self._to_skin = interpolation_matrix(near, weights, len(self._skin))
        self._model = mujoco.MjModel.from_xml_string(
            _description(phantom, mesh.nodes, mesh.tetrahedra)
        )
        self._data = mujoco.MjData(self._model)
        self._face = self._model.geom("face").id
        self.reset()

    def press(self, X_SP: Float[np.ndarray, "4 4"], velocity_S: Float[np.ndarray, "3"]) -> Contact:
        """Press the probe, held at `X_SP` and moving with `velocity_S` [m/s] over the phantom, into
        the solid.

        Raises:
            RobotError: The solid has diverged.
        """
        start_S, p_S = self._data.mocap_pos[0].copy(), X_SP[:3, 3]
        if np.linalg.norm(p_S - start_S) > JUMP:
            start_S = p_S - JUMP * X_SP[:3, 2]
        mujoco.mju_mat2Quat(self._data.mocap_quat[0], np.ascontiguousarray(X_SP[:3, :3]).ravel())
        steps = int(np.clip(np.ceil(np.linalg.norm(p_S - start_S) / STRIDE), 1, MAX_STEPS))
        for fraction in np.linspace(0, 1, steps + 1)[1:]:
            self._data.mocap_pos[0] = start_S + fraction * (p_S - start_S)
            mujoco.mj_step(self._model, self._data)
        if not np.abs(self._data.qvel).max() < np.inf:
            raise RobotError(
                f"MuJoCo's solid diverged at {self._data.time:.3f} s: make the phantom softer, or "
                "use mechanics "
                '"soft", which cannot',
                self._data.time,
            )
        self._points_S, self._forces_S = self._contacts()
        elastic_S = self._forces_S.sum(axis=0)
        loads = np.linalg.norm(self._forces_S, axis=1)
        touching = loads.sum() > 0
        centre_S = loads @ self._points_S / loads.sum() if touching else p_S.copy()
        torque_S = np.cross(self._points_S - p_S, self._forces_S).sum(axis=0)
        force_S, torque_S = with_motion(
            elastic_S, torque_S, centre_S - p_S, np.ascontiguousarray(velocity_S), 0.0,
            self._phantom.config.gel_friction,
        )  # fmt: skip
        inward = np.einsum("nc,nc->n", self._undeformed_S - self._vertices_S(), self._normals_S)
        depth = max(float(inward.max()), 0.0) if touching else 0.0
        return Contact(
            force_S=force_S,
            torque_S=torque_S,
            depth=depth,
            vertices=int(np.sum(loads > 0)),
            centre_S=centre_S,
        )

    def deformed_skin(self) -> Float[np.ndarray, "n 3"]:
        """Vertices of the phantom's fine skin mesh in S after the last press [m]."""
        return self._phantom.skin.vertices_S + self._to_skin @ (
            self._vertices_S() - self._undeformed_S
        )

    def patch(self) -> ContactPatch:
        """The contacts of the last press; an equal part of the skin's triangles belongs to each
        vertex.
        """
        loads = np.linalg.norm(self._forces_S, axis=1)
        touching = loads > 0
        areas = np.full(int(touching.sum()), self._area)
        return ContactPatch(
            points_S=self._points_S[touching], pressure=loads[touching] / self._area, areas=areas
        )

    def reset(self) -> None:
        """Put the solid back at rest, undeformed, the probe far above it."""
        mujoco.mj_resetData(self._model, self._data)
        self._data.mocap_pos[0] = (0.0, 0.0, 1.0)
        mujoco.mj_forward(self._model, self._data)
        self._points_S, self._forces_S = np.zeros((0, 3)), np.zeros((0, 3))

    def _vertices_S(self) -> Float[np.ndarray, "n 3"]:
        """Where the skin's vertices are now [m]."""
        return self._data.flexvert_xpos[self._skin]

    def _contacts(self) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Places of the contacts [m], and the forces of the solid on the probe there [N]."""
        points_S, forces_S = np.zeros((self._data.ncon, 3)), np.zeros((self._data.ncon, 3))
        force = np.zeros(6)
        for k in range(self._data.ncon):
            contact = self._data.contact[k]
            mujoco.mj_contactForce(self._model, self._data, k, force)
            # the frame's x points from the first to the second
            sign = 1.0 if contact.geom[1] == self._face else -1.0
            points_S[k], forces_S[k] = contact.pos, sign * force[0] * contact.frame[:3]
        return points_S, forces_S


def _description(
    phantom: Phantom, nodes_S: Float[np.ndarray, "n 3"], tetrahedra: Int[np.ndarray, "m 4"]
) -> str:
    """The solid and the face in MJCF."""
    config, face = phantom.config, lens(ProbeFace())
    a, b, c, d = nodes_S[tetrahedra].transpose(1, 0, 2)
    volume = float(np.einsum("nc,nc->n", a - d, np.cross(b - d, c - d)).sum() / 6)
    # the same stiffness under contact
    young = config.young * (1 - POISSON**2) / (1 - config.poisson**2)
    return f"""<mujoco>
      <option timestep="{PERIOD}" integrator="discrete" solver="Newton" gravity="0 0 0"/>
      <size memory="800M"/>
      <asset><mesh name="face" vertex="{_text(face.vertices)}" face="{_text(face.faces)}"/></asset>
      <worldbody>
        <body mocap="true" pos="0 0 1"><geom name="face" type="mesh" mesh="face" {CONTACT}/></body>
        <body name="chest">
          <flexcomp name="solid" type="direct" dim="3" dof="trilinear" radius="0"
              cellcount="{_text(np.array(CELLS))}" mass="{DENSITY * abs(volume)}"
              point="{_text(nodes_S)}" element="{_text(tetrahedra)}">
            <pin gridrange="0 0 0 {CELLS[0]} {CELLS[1]} 0"/>
            <elasticity young="{young}" poisson="{POISSON}" damping="{DAMPING}"/>
            <contact selfcollide="none" {CONTACT}/>
          </flexcomp>
        </body>
      </worldbody>
    </mujoco>"""


def _text(values: np.ndarray) -> str:
    return " ".join(f"{value:.9g}" for value in values.ravel())
