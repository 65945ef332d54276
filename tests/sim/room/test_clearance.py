import numpy as np

from sim.room.cell import cell_of
from sim.room.clearance import Clearance
from sim.scene import HOME_Q


def test_an_arm_folded_into_itself_is_found(quiet_scene):
    """The elbow bent by 170 degrees puts the wrist into the upper arm, far above the table."""
    folded = np.deg2rad([180.0, -90.0, 170.0, 0.0, -90.0, 0.0])
    closest = Clearance(cell_of(quiet_scene)).closest(folded)
    assert closest.distance < 0
    assert closest.of_arm.startswith("link")
    assert "hull" in closest.of_other


def test_links_that_share_a_joint_do_not_count(quiet_scene):
    assert Clearance(cell_of(quiet_scene)).closest(HOME_Q).distance > 0.02


def test_the_minimum_gap_is_the_closest_pairs(quiet_scene):
    clearance = Clearance(cell_of(quiet_scene))
    q = HOME_Q + np.random.default_rng(0).uniform(-0.4, 0.4, (5, 6))
    np.testing.assert_allclose(clearance(q), [clearance.closest(row).distance for row in q])
