"""Which mechanics a phantom has: soft tissue by finite elements, a rigid print, or MuJoCo's own
solid.
"""

from collections.abc import Callable

from sim.tissue.contact import Mechanics
from sim.tissue.flex import FlexTissue
from sim.tissue.phantom import Phantom
from sim.tissue.printed import PrintedBreast
from sim.tissue.soft import SoftTissue


def build_mechanics(
    phantom: Phantom, progress: Callable[[float, str], None] | None = None
) -> Mechanics:
    """The contact mechanics that the phantom's configuration names.

    Args:
        phantom: Shape and mechanics.
        progress: Told the fraction done (0 to 1) and what is being done, where that takes a while.
    """
    if phantom.config.mechanics == "printed":
        return PrintedBreast(phantom)
    if phantom.config.mechanics == "flex":
        return FlexTissue(phantom)
    return SoftTissue.build(phantom, progress)
