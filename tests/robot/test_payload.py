import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from breastscan.errors import CalibrationError
from breastscan.robot.payload import GRAVITY_B, Payload, cross_matrix, identify, load_map

AT_F = np.array([0.0, 0.0, 0.036])
TRUE = Payload(mass=0.39, centre_F=np.array([0.035, -0.002, 0.095]))
ZERO_F = np.array([1.0, -2.0, 3.0, 0.05, -0.02, 0.01])


def tilted(count, degrees, seed=0):
    """Flange orientations tilted about ever other horizontal axes, from looking down."""
    rng = np.random.default_rng(seed)
    down = Rotation.from_euler("x", np.pi)
    axes = rng.normal(size=(count, 3)) * [1, 1, 0]
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return (Rotation.from_rotvec(np.radians(degrees) * axes) * down).as_matrix()


def readings(R_BF, noise=0.0, seed=1):
    """Statics from first principles: weight at the centre of mass, and its moment."""
    rows = []
    for R in R_BF:
        weight_F = R.T @ (TRUE.mass * GRAVITY_B)
        rows.append(np.concatenate([weight_F, np.cross(TRUE.centre_F - AT_F, weight_F)]))
    drawn = np.random.default_rng(seed).normal(size=(len(rows), 6))
    return np.array(rows) + ZERO_F + noise * drawn * [1, 1, 1, 0.04, 0.04, 0.04]


def test_mass_centre_and_zero_are_found_exactly_without_noise():
    R_BF = tilted(6, 40)
    found = identify(readings(R_BF), R_BF, AT_F)
    assert found.payload.mass == pytest.approx(TRUE.mass, abs=1e-12)
    np.testing.assert_allclose(found.payload.centre_F, TRUE.centre_F, atol=1e-12)
    np.testing.assert_allclose(found.zero_F, ZERO_F, atol=1e-12)
    assert found.force_rms < 1e-12


def test_twelve_poses_of_an_averaged_industrial_sensor_give_grams_and_millimetres():
    """.05 N averaged over .2 s is 5 mN: as in the twin's own tare."""
    R_BF = tilted(12, 40)
    found = [identify(readings(R_BF, noise=0.005, seed=seed), R_BF, AT_F) for seed in range(50)]
    mass = np.array([f.payload.mass for f in found]) - TRUE.mass
    centre = np.array([f.payload.centre_F for f in found]) - TRUE.centre_F
    assert np.sqrt((mass**2).mean()) < 1e-3
    assert np.sqrt((centre**2).mean()) < 1e-3
    assert np.mean([f.force_rms for f in found]) == pytest.approx(0.005, rel=0.2)


@pytest.mark.parametrize(
    ("R_BF", "why"),
    [
        (tilted(3, 40), "3 poses"),
        (tilted(8, 2), "tilt the flange too little"),
        (np.tile(np.eye(3), (8, 1, 1)), "tilt"),
    ],
)
def test_poses_that_do_not_tell_the_payload_are_refused(R_BF, why):
    with pytest.raises(CalibrationError, match=why):
        identify(readings(R_BF), R_BF, AT_F)


def test_a_wide_swing_about_one_axis_is_enough():
    R_BF = (
        Rotation.from_euler("x", np.linspace(120, 240, 8)[:, None], degrees=True)
        .as_matrix()
        .reshape(8, 3, 3)
    )
    found = identify(readings(R_BF), R_BF, AT_F)
    assert found.payload.mass == pytest.approx(TRUE.mass, abs=1e-9)
    np.testing.assert_allclose(found.payload.centre_F, TRUE.centre_F, atol=1e-9)


def test_readings_that_are_not_finite_or_of_the_wrong_sign_are_refused():
    R_BF = tilted(6, 40)
    broken = readings(R_BF)
    broken[2, 1] = np.nan
    with pytest.raises(CalibrationError, match="not finite"):
        identify(broken, R_BF, AT_F)
    with pytest.raises(CalibrationError, match="sign"):
        identify(-readings(R_BF), R_BF, AT_F)


def test_the_load_is_weight_less_inertia_with_its_moment():
    free_F = np.array([0.3, -0.4, -9.0])
    wrench_F = load_map(TRUE, AT_F) @ free_F
    np.testing.assert_allclose(wrench_F[:3], TRUE.mass * free_F)
    np.testing.assert_allclose(wrench_F[3:], np.cross(TRUE.centre_F - AT_F, TRUE.mass * free_F))


def test_the_cross_matrix_multiplies_as_the_cross_product():
    a, b = np.random.default_rng(0).normal(size=(2, 5, 3))
    np.testing.assert_allclose(np.einsum("nij,nj->ni", cross_matrix(a), b), np.cross(a, b))
