import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from breastscan.errors import ConfigError
from sim.probe import SENSOR_HEIGHT, payload, tip_pose
from sim.wrench_sensor import GRAVITY_W, WrenchSensor, WrenchSensorConfig

ANGLE = np.pi / 4
X_FP = tip_pose(ANGLE)
QUIET = WrenchSensorConfig(force_noise=0.0, torque_noise=0.0)


def raw_wrench_F(force_P, torque_P, R_WF):
    """Statics: weight at the payload's centre and a wrench at the tip, about the sensor's measuring point."""
    load = payload(ANGLE)
    measured_at_F = np.array([0, 0, SENSOR_HEIGHT])
    weight_F = R_WF.T @ (load.mass * GRAVITY_W)
    force_F, torque_F = X_FP[:3, :3] @ force_P, X_FP[:3, :3] @ torque_P
    moment_F = (
        torque_F + np.cross(X_FP[:3, 3] - measured_at_F, force_F) + np.cross(load.centre_F - measured_at_F, weight_F)
    )
    return np.concatenate([force_F + weight_F, moment_F])


@pytest.mark.parametrize("seed", range(5))
def test_weight_is_taken_out_and_the_tip_wrench_remains_in_any_orientation(seed):
    rng = np.random.default_rng(seed)
    R_WF = Rotation.random(rng=rng).as_matrix()
    force_P, torque_P = rng.normal(size=3), rng.normal(size=3)
    sensor = WrenchSensor(QUIET, payload(ANGLE), X_FP)
    measured_P = sensor.measure(raw_wrench_F(force_P, torque_P, R_WF), R_WF)
    np.testing.assert_allclose(measured_P, [*force_P, *torque_P], atol=1e-12)


def test_tare_makes_the_present_wrench_zero_and_later_changes_count_from_there():
    sensor = WrenchSensor(QUIET, payload(ANGLE), X_FP)
    push_P, none = np.array([0.0, 0, -2.0]), np.zeros(3)
    sensor.tare(sensor.measure(raw_wrench_F(push_P, none, np.eye(3)), np.eye(3)))
    sensor.tare(sensor.measure(raw_wrench_F(push_P, none, np.eye(3)), np.eye(3)))
    measured_P = sensor.measure(raw_wrench_F(2.5 * push_P, none, np.eye(3)), np.eye(3))
    np.testing.assert_allclose(measured_P, [0, 0, -3.0, 0, 0, 0], atol=1e-12)


def test_noise_has_the_configured_rms_and_repeats_with_its_seed():
    raw = raw_wrench_F(np.zeros(3), np.zeros(3), np.eye(3))
    runs = []
    for _ in range(2):
        sensor = WrenchSensor(WrenchSensorConfig(seed=3), payload(ANGLE), X_FP)
        runs.append(np.array([sensor.measure(raw, np.eye(3)) for _ in range(4000)]))
    np.testing.assert_array_equal(*runs)
    np.testing.assert_allclose(np.sqrt((runs[0][:, :3] ** 2).mean(axis=0)), 0.05, rtol=0.05)


@pytest.mark.parametrize("value", [-0.1, np.nan, np.inf])
def test_impossible_noise_is_refused(value):
    with pytest.raises(ConfigError):
        WrenchSensorConfig(force_noise=value)
