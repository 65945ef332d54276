# pyright: reportAttributeAccessIssue=false
# (MuJoCo's compiled modules carry no types)
"""The wrist sensor: from MuJoCo's raw force and torque to the wrench of the tissue at the probe's tip."""

from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Float

from breastscan.errors import ConfigError
from sim.probe import SENSOR_HEIGHT, Payload

GRAVITY_W = np.array([0.0, 0.0, -9.80665])
"""Standard gravity [m/s^2]."""
MEASURED_AT_F = np.array([0.0, 0.0, SENSOR_HEIGHT])
"""The sensor's measuring point in the flange's frame [m]."""


@dataclass(frozen=True, kw_only=True)
class WrenchSensorConfig:
    """Errors of the sensor."""

    force_noise: float = 0.05
    """RMS noise of each force component [N]."""
    torque_noise: float = 0.002
    """RMS noise of each torque component [N m]."""
    seed: int = 0
    """Draws the noise."""

    def __post_init__(self) -> None:
        for name in ("force_noise", "torque_noise"):
            value = getattr(self, name)
            if not 0 <= value < np.inf:
                raise ConfigError(f"{name} must be finite and not negative, got {value}", value)


class WrenchSensor:
    """Adds noise, takes the tool's known weight out, moves the wrench to the tip, and subtracts the tare."""

    def __init__(self, config: WrenchSensorConfig, payload: Payload, X_FP: Float[np.ndarray, "4 4"]) -> None:
        self._payload = payload
        self._R_PF = X_FP[:3, :3].T
        self._tip_F = X_FP[:3, 3] - MEASURED_AT_F
        self._centre_F = payload.centre_F - MEASURED_AT_F
        self._sigma = np.repeat([config.force_noise, config.torque_noise], 3)
        self._rng = np.random.default_rng(config.seed)
        self._zero_P = np.zeros(6)

    def measure(self, raw_F: Float[np.ndarray, "6"], R_WF: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "6"]:
        """Wrench of the tissue on the probe since the tare, force first, at P in basis P [N, N m].

        Args:
            raw_F: What the tool does to its sensor, force first, at the measuring point [N, N m].
            R_WF: Orientation of the flange in the world.
        """
        noisy_F = raw_F + self._sigma * self._rng.standard_normal(6)
        weight_F = self._payload.mass * GRAVITY_W @ R_WF
        force_F = noisy_F[:3] - weight_F
        torque_F = noisy_F[3:] - moment(self._centre_F, weight_F) - moment(self._tip_F, force_F)
        return np.concatenate([self._R_PF @ force_F, self._R_PF @ torque_F]) - self._zero_P

    def tare(self, measured_P: Float[np.ndarray, "6"]) -> None:
        """Take a wrench that `measure` gave as zero."""
        self._zero_P = self._zero_P + measured_P


def moment(arm: Float[np.ndarray, "3"], force: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Moment of a force at the end of a lever arm; `np.cross` would take longer than all the rest of a period."""
    product = np.empty(3)
    mujoco.mju_cross(product, arm, force)
    return product
