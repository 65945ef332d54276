"""MuJoCo's solid: what it can do, within what its documentation says that it cannot."""

import numpy as np
import pytest

from breastscan.errors import ConfigError
from sim.tissue.flex import FlexTissue
from sim.tissue.layers import LayerConfig
from sim.tissue.phantom import Phantom
from sim.tissue.phantom_config import PhantomConfig
from tests.sim.tissue.press_poses import REST, loop_pose


@pytest.fixture(scope="module")
def phantom() -> Phantom:
    return Phantom(PhantomConfig(mechanics="flex"))


def test_a_press_of_five_millimetres_comes_near_the_finite_elements_and_leaves_no_trace(phantom):
    """4.2 N by MuJoCo's cells, 3.7 N by full finite elements."""
    flex = FlexTissue(phantom)
    for depth in np.arange(-0.001, 0.0051, 1e-4):
        X_SP = loop_pose(phantom, 0.7, depth)
        contact = flex.press(X_SP, REST)
    assert -contact.force_S @ X_SP[:3, 2] == pytest.approx(3.73, rel=0.2)
    assert contact.depth == pytest.approx(0.005, abs=5e-4)
    patch = flex.patch()
    assert patch.pressure @ patch.areas == pytest.approx(np.linalg.norm(contact.force_S), rel=0.1)
    moved = np.linalg.norm(flex.deformed_skin() - phantom.skin.vertices_S, axis=1)
    assert moved.max() == pytest.approx(0.005, abs=1e-3)
    flex.reset()
    np.testing.assert_allclose(flex.deformed_skin(), phantom.skin.vertices_S, atol=1e-6)
    assert flex.press(loop_pose(phantom, 0.7, -0.005), REST).vertices == 0


def test_layers_are_refused():
    with pytest.raises(ConfigError, match="soft"):
        FlexTissue(Phantom(PhantomConfig(mechanics="flex", layers=LayerConfig(mass_radius=0.01))))
