import mujoco
import numpy as np
import pytest

from breastscan.geometry import se3
from sim.live.skin import live_vertices
from sim.tissue.hemisphere import coarser_rows, hemisphere


@pytest.mark.parametrize(("rings", "every"), [(6, 1), (6, 2), (12, 4), (9, 3)])
def test_every_nth_ring_of_a_hemisphere_is_the_coarser_hemisphere(rings, every):
    np.testing.assert_allclose(
        hemisphere(rings)[0][coarser_rows(rings, every)], hemisphere(rings // every)[0], atol=1e-12
    )


def test_rings_that_do_not_divide_are_refused():
    with pytest.raises(ValueError, match="divisor"):
        coarser_rows(7, 2)


def test_the_live_skin_is_drawn_where_the_mocap_bodies_are(quiet_scene):
    """They carry the phantom's skin undeformed at first, and any other where it is moved to."""
    model, data = quiet_scene.live, mujoco.MjData(quiet_scene.live)
    mujoco.mj_forward(model, data)
    skin_S = quiet_scene.phantom.skin.vertices_S
    np.testing.assert_allclose(
        data.flexvert_xpos, se3.transform(quiet_scene.X_BS, live_vertices(skin_S)), atol=1e-6
    )
    pressed_S = skin_S - 0.005 * quiet_scene.phantom.skin.normals_S
    data.mocap_pos[1:] = se3.transform(quiet_scene.X_BS, live_vertices(pressed_S))
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.flexvert_xpos, data.mocap_pos[1:], atol=1e-6)


def test_the_live_model_moves_as_the_simulated_one_does(quiet_scene):
    """Same arm, same joints: the state of one is a state of the other."""
    live, physics = quiet_scene.live, quiet_scene.physics
    assert [live.joint(i).name for i in range(live.njnt)] == [
        physics.joint(i).name for i in range(physics.njnt)
    ]
