"""The wrist sensor: from MuJoCo's raw force and torque to the wrench of the tissue at the probe's
tip.

What loads the sensor passes its wrong gains, its offsets, its noisy low-pass and its converter.
From the reading, weight and inertia of the tool are taken out as far as they are known, the rest is
moved to the tip, and the tare subtracted.
"""

import math
from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float

from breastscan.robot.payload import GRAVITY_B, Payload, cross_matrix, load_map
from breastscan.robot.ur.ur5e import PERIOD
from sim.wrist.probe import SENSOR_HEIGHT
from sim.wrist.wrench_errors import TORQUE_ARM, WrenchErrors, WrenchSensorConfig

GRAVITY_W = GRAVITY_B
"""[m/s^2]; the robot's base stands in the world's origin."""
MEASURED_AT_F = np.array([0.0, 0.0, SENSOR_HEIGHT])
"""The sensor's measuring point in the flange's frame [m]."""
NOISE_BLOCK = 256
"""Periods for which noise is drawn at a time: 30 us, less than a program's turn may take."""


class WrenchSensor:
    """One sensor with its errors. It is read once a control period."""

    def __init__(
        self, config: WrenchSensorConfig, payload: Payload, X_FP: Float[np.ndarray, "4 4"]
    ) -> None:
        """Switch the sensor on.

        Args:
            config: What it gets wrong.
            payload: The payload that its controller reckons with.
            X_FP: Where the wrench is wanted, the probe tip in the flange.
        """
        errors, rng = config.errors, np.random.default_rng(config.seed or 0)
        self._errors = errors
        self._gain = _gain(errors, rng)
        self._drift_F = (
            PERIOD * errors.drift * np.concatenate([_direction(rng), TORQUE_ARM * _direction(rng)])
        )
        # at 60 degrees, up moves by its own length
        self._pose_offset = errors.pose_offset * _contraction(rng)
        self._pole = low_pass_pole(errors.bandwidth)
        sigma = np.repeat([errors.force_noise, errors.torque_noise], 3)
        self._white = sigma * math.sqrt((1 + self._pole) / (1 - self._pole))
        self._settled_noise = sigma * rng.standard_normal(6)
        self._steps = errors.resolution * np.repeat([1.0, TORQUE_ARM], 3)
        self._range = np.repeat([errors.force_range, errors.torque_range], 3)
        self._hold = round(1 / (errors.sample_rate * PERIOD))
        self._rng, self._noise = rng, np.empty((0, 6))
        self._first_noise = rng.bit_generator.state
        self._latest: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        """Load, orientation and acceleration of the last period."""
        self._to_tip = _shift_to_tip(X_FP)
        self._velocity_W = None
        self._filtered_F = None
        self._periods = 0
        self.samples = 0
        """Readings so far."""
        self.reading_F = np.zeros(6)
        """The last reading, weight and all, at the measuring point in basis F, force first [N, N
        m]."""
        self._wrench_P, self._zero_P = np.zeros(6), np.zeros(6)
        self.set_payload(payload)

    def set_payload(self, payload: Payload) -> None:
        """Take out weight and inertia of this payload from now on."""
        self._load = load_map(payload, MEASURED_AT_F)

    def measure(
        self,
        load_F: Float[np.ndarray, "6"],
        R_WF: Float[np.ndarray, "3 3"],
        velocity_W: Float[np.ndarray, "3"],
        acceleration_W: Float[np.ndarray, "3"],
    ) -> Float[np.ndarray, "6"]:
        """Wrench of the tissue on the probe since the tare, force first, at P in basis P [N, N m].

        Args:
            load_F: What the tool really does to its sensor, force first, at the measuring point [N,
                N m].
            R_WF: Orientation of the flange in the world.
            velocity_W: Velocity of the tool's centre of mass [m/s].
            acceleration_W: Its acceleration [m/s^2].
        """
        if not self._errors.knows_acceleration:
            before_W = velocity_W if self._velocity_W is None else self._velocity_W
            acceleration_W = (velocity_W - before_W) / PERIOD
            self._velocity_W = velocity_W
        self._latest = load_F, R_WF, acceleration_W
        return self._sense(*self._latest)

    def restart(self) -> Float[np.ndarray, "6"]:
        """Let noise, drift and samples begin as when switched on; measure the last load again."""
        assert self._latest is not None, "it measures from the first period on"
        self._rng.bit_generator.state = self._first_noise
        self._periods, self._filtered_F = 0, None
        return self._sense(*self._latest)

    def tare(self, measured_P: Float[np.ndarray, "6"]) -> None:
        """Take a wrench that `measure` gave as zero."""
        self._zero_P = self._zero_P + measured_P

    def _sense(
        self, load_F: np.ndarray, R_WF: np.ndarray, acceleration_W: np.ndarray
    ) -> np.ndarray:
        """A period of the sensor."""
        reading_F = self._read(load_F, R_WF)
        if self._periods % self._hold == 0:
            self.samples += 1
            self.reading_F = reading_F
            self._wrench_P = _at_tip(reading_F, R_WF, acceleration_W, self._load, self._to_tip)
        self._periods += 1
        return self._wrench_P - self._zero_P

    def _read(self, load_F: np.ndarray, R_WF: np.ndarray) -> np.ndarray:
        """What the converter gives."""
        if self._filtered_F is None:  # the low-pass has been running for long
            self._filtered_F = (
                _felt(load_F, R_WF, self._gain, self._pose_offset) + self._settled_noise
            )
        return _converted(
            load_F, R_WF, self._gain, self._pose_offset, self._periods * self._drift_F,
            self._next_noise(), self._pole, self._filtered_F, self._range, self._steps,
        )  # fmt: skip

    def _next_noise(self) -> np.ndarray:
        row = self._periods % NOISE_BLOCK
        if row == 0:
            self._noise = self._white * self._rng.standard_normal((NOISE_BLOCK, 6))
        return self._noise[row]


@numba.njit(cache=True)
@no_type_check  # keeps the tests' run-time type checker from wrapping what numba compiles
def _felt(load_F, R_WF, gain, pose_offset):
    """What the gauges make of a load, and of the flange's orientation: R_WF[2] is up, seen in F."""
    felt_F = np.zeros(6)
    for i in range(6):
        for j in range(6):
            felt_F[i] += gain[i, j] * load_F[j]
    for i in range(3):
        for j in range(3):
            felt_F[i] -= pose_offset[i, j] * R_WF[2, j]
    return felt_F


@numba.njit(cache=True)
@no_type_check
def _converted(load_F, R_WF, gain, pose_offset, drift_F, noise_F, pole, filtered_F, limits, steps):
    """The reading after low-pass, saturation and converter; the low-pass's memory `filtered_F`
    is changed in place.
    """
    felt_F, reading_F = _felt(load_F, R_WF, gain, pose_offset), np.empty(6)
    for i in range(6):
        filtered_F[i] = pole * filtered_F[i] + (1 - pole) * (felt_F[i] + drift_F[i] + noise_F[i])
        reading_F[i] = min(max(filtered_F[i], -limits[i]), limits[i])
        if steps[i] > 0:
            reading_F[i] = steps[i] * np.rint(reading_F[i] / steps[i])
    return reading_F


@numba.njit(cache=True)
@no_type_check
def _at_tip(reading_F, R_WF, acceleration_W, load, to_tip):
    """The reading less the payload's weight and inertia, moved to the tip."""
    rest_F, wrench_P = reading_F.copy(), np.zeros(6)
    for j in range(3):
        free = 0.0
        for k in range(3):
            free += (GRAVITY_W[k] - acceleration_W[k]) * R_WF[k, j]
        for i in range(6):
            rest_F[i] -= load[i, j] * free
    for i in range(6):
        for j in range(6):
            wrench_P[i] += to_tip[i, j] * rest_F[j]
    return wrench_P


def low_pass_pole(bandwidth: float) -> float:
    """Pole of the first-order low-pass that, sampled every period, is 3 dB down at `bandwidth`
    [Hz]; 0 passes all.
    """
    if bandwidth >= 0.5 / PERIOD:
        return 0.0
    reach = 2 - math.cos(2 * math.pi * bandwidth * PERIOD)
    return reach - math.sqrt(reach**2 - 1)


def _gain(errors: WrenchErrors, rng: np.random.Generator) -> np.ndarray:
    """Readings over loads: near 1 on the diagonal, near 0 beside it, forces and torques apart."""
    drawn = errors.cross_talk * rng.standard_normal((6, 6))
    np.fill_diagonal(drawn, errors.gain_error * rng.standard_normal(6))
    return np.eye(6) + drawn * np.kron(np.eye(2), np.ones((3, 3)))


def _direction(rng: np.random.Generator) -> np.ndarray:
    drawn = rng.standard_normal(3)
    return drawn / np.linalg.norm(drawn)


def _contraction(rng: np.random.Generator) -> np.ndarray:
    """A matrix that lengthens no vector and keeps the length of one."""
    drawn = rng.standard_normal((3, 3))
    return drawn / np.linalg.norm(drawn, 2)


def _shift_to_tip(X_FP: np.ndarray) -> np.ndarray:
    """From a wrench at the measuring point in basis F to the same at P in basis P."""
    R_PF, lever_F = X_FP[:3, :3].T, X_FP[:3, 3] - MEASURED_AT_F
    return np.block([[R_PF, np.zeros((3, 3))], [-R_PF @ cross_matrix(lever_F), R_PF]])
