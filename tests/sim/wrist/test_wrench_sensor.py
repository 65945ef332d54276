"""Each error of the wrist sensor by its statistics, and what is left of weight and inertia."""

import numpy as np
import pytest
from scipy import signal
from scipy.spatial.transform import Rotation

from breastscan.errors import ConfigError
from breastscan.robot.payload import Payload
from breastscan.robot.ur.ur5e import PERIOD
from sim.wrist.probe import SENSOR_HEIGHT, payload, tip_pose
from sim.wrist.wrench_errors import WRENCH_CLASSES, WrenchSensorConfig
from sim.wrist.wrench_sensor import GRAVITY_W, WrenchSensor, low_pass_pole

ANGLE = np.pi / 4
X_FP = tip_pose(ANGLE)
REST = np.zeros(3)
DOWN = np.diag([1.0, -1.0, -1.0])
CLASSES = list(WRENCH_CLASSES)


def sensor(**errors):
    """An ideal sensor but for these errors."""
    return WrenchSensor(WrenchSensorConfig(**{"quality": "ideal", **errors}), payload(ANGLE), X_FP)


def load_F(force_P, torque_P, R_WF, acceleration_W=REST):
    """Newton: weight and inertia at the payload's centre and a wrench at the tip, about the
    measuring point.
    """
    load = payload(ANGLE)
    measured_at_F = np.array([0, 0, SENSOR_HEIGHT])
    weight_F = R_WF.T @ (load.mass * (GRAVITY_W - acceleration_W))
    force_F, torque_F = X_FP[:3, :3] @ force_P, X_FP[:3, :3] @ torque_P
    moment_F = (
        torque_F
        + np.cross(X_FP[:3, 3] - measured_at_F, force_F)
        + np.cross(load.centre_F - measured_at_F, weight_F)
    )
    return np.concatenate([force_F + weight_F, moment_F])


def held(one, force_P=REST, count=1, R_WF=DOWN):
    """Wrenches at rest under a lasting force at the tip."""
    load = load_F(force_P, REST, R_WF)
    return np.array([one.measure(load, R_WF, REST, REST) for _ in range(count)])


def read_F(one, count):
    """Readings before the tool is taken out, at rest, less the tool's weight."""
    load, rows = load_F(REST, REST, DOWN), []
    for _ in range(count):
        one.measure(load, DOWN, REST, REST)
        rows.append(one.reading_F - load)
    return np.array(rows)


@pytest.mark.parametrize("seed", range(5))
def test_weight_is_taken_out_and_the_tip_wrench_remains_in_any_orientation(seed):
    rng = np.random.default_rng(seed)
    R_WF = Rotation.random(rng=rng).as_matrix()
    force_P, torque_P = rng.normal(size=3), rng.normal(size=3)
    measured_P = sensor().measure(load_F(force_P, torque_P, R_WF), R_WF, REST, REST)
    np.testing.assert_allclose(measured_P, [*force_P, *torque_P], atol=1e-12)


def test_inertia_is_taken_out_exactly_where_the_acceleration_is_known():
    acceleration_W = np.array([2.0, -1.0, 3.0])
    measured_P = sensor().measure(
        load_F(REST, REST, DOWN, acceleration_W), DOWN, REST, acceleration_W
    )
    np.testing.assert_allclose(measured_P, 0, atol=1e-12)


def test_inertia_by_the_speeds_of_two_samples_leaves_what_the_acceleration_changed_in_a_period():
    """A shake of 5 mm at 5 Hz, 4.9 m/s^2: a period late, 6 % is left of the 1.9 N that would
    read as contact.
    """
    one = sensor(knows_acceleration=False)
    w, amplitude = 2 * np.pi * 5.0, 0.005
    readings = []
    for t in PERIOD * np.arange(500):
        velocity_W = np.array([0, 0, amplitude * w * np.cos(w * t)])
        # that leads to the next speed
        acceleration_W = np.array([0, 0, -amplitude * w**2 * np.sin(w * (t + PERIOD / 2))])
        readings.append(
            one.measure(load_F(REST, REST, DOWN, acceleration_W), DOWN, velocity_W, acceleration_W)
        )
    peak = np.linalg.norm(np.array(readings)[2:, :3], axis=1).max()
    whole = payload(ANGLE).mass * amplitude * w**2
    assert peak == pytest.approx(whole * w * PERIOD, rel=0.1)
    assert peak < 0.07 * whole


def test_tare_makes_the_present_wrench_zero_and_later_changes_count_from_there():
    one, push_P = sensor(), np.array([0.0, 0, -2.0])
    for _ in range(2):
        one.tare(held(one, push_P)[0])
    np.testing.assert_allclose(held(one, 2.5 * push_P)[0], [0, 0, -3.0, 0, 0, 0], atol=1e-12)


@pytest.mark.parametrize("quality", CLASSES)
def test_noise_has_the_classs_rms_and_repeats_with_its_seed(quality):
    errors = WRENCH_CLASSES[quality]
    runs = [
        read_F(
            sensor(
                force_noise=errors.force_noise,
                torque_noise=errors.torque_noise,
                bandwidth=errors.bandwidth,
                seed=3,
            ),
            count=8000,
        )
        for _ in range(2)
    ]
    np.testing.assert_array_equal(*runs)
    rms = np.sqrt((runs[0] ** 2).mean(axis=0))
    np.testing.assert_allclose(rms[:3], errors.force_noise, rtol=0.05)
    np.testing.assert_allclose(rms[3:], errors.torque_noise, rtol=0.05)


@pytest.mark.parametrize("bandwidth", [20.0, 50.0, 100.0, 200.0])
def test_a_sine_at_the_bandwidth_comes_through_3_db_down(bandwidth):
    one = sensor(bandwidth=bandwidth)
    times = PERIOD * np.arange(1000)
    read = np.array(
        [held(one, np.array([0, 0, np.sin(2 * np.pi * bandwidth * t)]))[0, 2] for t in times]
    )
    wave = np.exp(-2j * np.pi * bandwidth * times)[500:]
    assert 2 * abs((wave * read[500:]).mean()) == pytest.approx(1 / np.sqrt(2), rel=0.01)


def test_noise_is_band_limited_as_a_first_order_low_pass():
    one = sensor(force_noise=0.3, bandwidth=50.0)
    read = read_F(one, count=16000)[:, 0]
    frequency, power = signal.welch(read, 1 / PERIOD, nperseg=128)
    pole = low_pass_pole(50.0)
    shape = 1 / np.abs(1 - pole * np.exp(-2j * np.pi * frequency * PERIOD)) ** 2
    ratio = power[2:-2] / shape[2:-2]
    assert np.abs(ratio / ratio.mean() - 1).max() < 0.35
    assert ratio[:30].mean() == pytest.approx(ratio[30:].mean(), rel=0.05)


@pytest.mark.parametrize("quality", ["industrial", "ur5e_builtin"])
def test_a_sensor_left_alone_drifts_as_fast_as_its_class(quality):
    errors = WRENCH_CLASSES[quality]
    one = sensor(drift=errors.drift)
    count = round(6.0 / PERIOD)
    read = held(one, count=count)
    crept = np.linalg.norm(read[-1, :3] - read[0, :3])
    assert crept == pytest.approx(errors.drift * 6.0, rel=0.01)
    half = np.linalg.norm(read[count // 2, :3] - read[0, :3])
    assert half == pytest.approx(crept / 2, rel=0.01)


def test_the_built_in_sensor_drifts_4_n_in_5_minutes():
    assert WRENCH_CLASSES["ur5e_builtin"].drift * 300 == pytest.approx(4.0)


def test_readings_come_in_steps_of_the_resolution():
    one = sensor(resolution=0.1)
    read = []
    for force in np.linspace(0, 1, 500):
        held(one, np.array([0, 0, -force]))
        read.append(one.reading_F.copy())
    read = np.array(read)
    np.testing.assert_allclose(np.rint(read[:, :3] / 0.1) * 0.1, read[:, :3], atol=1e-12)
    steps = np.diff(np.unique(np.round(read[:, 2], 9)))
    np.testing.assert_allclose(steps, 0.1, atol=1e-9)
    error = read[:, 2] - [
        load_F(np.array([0, 0, -f]), REST, DOWN)[2] for f in np.linspace(0, 1, 500)
    ]
    assert error.std() == pytest.approx(0.1 / np.sqrt(12), rel=0.1)


def test_gain_and_cross_talk_have_their_spread_over_many_sensors_and_leave_torques_to_torques():
    response = []
    for seed in range(200):
        one = sensor(gain_error=0.01, cross_talk=0.03, seed=seed)
        base = one._read(np.zeros(6), DOWN)
        response.append(np.column_stack([one._read(row, DOWN) - base for row in np.eye(6)]))
    errors = np.array(response) - np.eye(6)
    diagonal = np.einsum("nii->ni", errors)
    assert np.abs(diagonal.std(axis=0) - 0.01).max() < 0.002
    beside = errors[:, [0, 1, 2, 3], [1, 2, 0, 5]]
    assert np.abs(beside.std(axis=0) - 0.03).max() < 0.006
    assert np.abs(errors[:, :3, 3:]).max() == 0.0


def test_the_pose_offset_stays_below_its_bound_within_60_degrees_and_nearly_reaches_it():
    azimuth = np.linspace(0, 2 * np.pi, 150)
    axes = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(150)], axis=1)
    tilted = Rotation.from_rotvec(np.radians(60) * axes).as_matrix() @ DOWN
    largest = []
    for seed in range(5):
        one = sensor(pose_offset=1.5, seed=seed)
        one.tare(held(one)[0])
        largest.append(max(np.linalg.norm(held(one, R_WF=R)[0, :3]) for R in tilted))
    assert max(largest) <= 1.5 + 1e-9
    assert max(largest) > 1.2


def test_a_sensor_saturates_at_its_range():
    one = sensor(force_range=50.0, torque_range=10.0)
    held(one, np.array([0, 0, -200.0]))
    assert np.abs(one.reading_F[:3]).max() == 50.0
    assert np.abs(one.reading_F[3:]).max() <= 10.0


def test_a_slow_sensor_repeats_its_reading_and_its_count_until_the_next_one():
    one = sensor(sample_rate=125.0, force_noise=0.1)
    counts, read = [], []
    for _ in range(40):
        read.append(held(one)[0, 0])
        counts.append(one.samples)
    assert counts == [1 + k // 4 for k in range(40)]
    assert len(np.unique(read)) == 10


def test_a_payload_entered_wrong_reads_as_a_force():
    one = sensor()
    true = payload(ANGLE)
    one.set_payload(Payload(mass=true.mass - 0.1, centre_F=true.centre_F))
    assert np.linalg.norm(held(one)[0, :3]) == pytest.approx(0.1 * 9.80665, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("force_noise", -0.1), ("torque_noise", np.nan), ("drift", np.inf), ("bandwidth", 0.0),
        ("force_range", -1.0), ("sample_rate", 0.0), ("sample_rate", 300.0),
        ("sample_rate", 1000.0),
    ],
)  # fmt: skip
def test_impossible_sensors_are_refused(name, value):
    with pytest.raises(ConfigError, match=name):
        WrenchSensorConfig(**{name: value})


@pytest.mark.parametrize("quality", CLASSES)
def test_a_restarted_sensor_measures_what_one_just_switched_on_does(quality):
    fresh, used = (sensor(quality=quality) for _ in range(2))
    expected = held(fresh, count=5000)
    held(used, count=777)
    np.testing.assert_array_equal([used.restart(), *held(used, count=4999)], expected)
