"""What each class of wrist sensor makes of a tool at rest, of a long wait, of other poses, and
of a shaken arm.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy import signal
from scipy.spatial.transform import Rotation

from breastscan.robot.payload import GRAVITY_B, load_map
from breastscan.robot.ur.ur5e import PERIOD
from sim.robot import SimRobot
from sim.scene import HOME_Q, Scene, SceneConfig
from sim.wrist.probe import payload
from sim.wrist.wrench_errors import Quality, WrenchSensorConfig
from sim.wrist.wrench_sensor import MEASURED_AT_F, WrenchSensor

DOWN = np.diag([1.0, -1.0, -1.0])
"""Orientation of a flange that looks down."""
REST = np.zeros(3)
WAIT = 300.0
"""Length of the wait in which the built-in sensor drifts by 4 N [s]."""
SEGMENT = 512
"""Samples of one segment of the spectrum."""
TILT = np.radians(50.0)
"""How far the flange is tilted about any axis, as around the breast [rad]."""
TILTS = 200
SHAKE_HZ, SHAKE = 3.0, 0.009
"""Frequency [Hz] and amplitude [rad] of the first three joints."""
CONTACT_P = np.array([0.0, 0.0, -5.0])
"""Force on the tip by which gain and cross-talk are judged [N]."""


@dataclass(frozen=True, kw_only=True)
class Readings:
    """Of one sensor."""

    quality: Quality
    """Its class."""
    wait: Float[np.ndarray, "n 3"]
    """Force at the tip while nothing happens, tared at the start, one row a period [N]."""
    frequency: Float[np.ndarray, "f"]
    """Of the spectrum [Hz]."""
    density: Float[np.ndarray, "f"]
    """Noise of a force component [N^2/Hz]."""
    tilted: Float[np.ndarray, "k"]
    """Force read with nothing touching, tilted in every direction after a tare looking down,
    without noise [N]."""
    contact_error: float
    """Error of a contact of 5 N along the probe, positive if too little is read; without noise
    [N]."""
    shaken: Float[np.ndarray, "n"]
    """Force read while the arm shakes the tool in the air [N]."""
    inertia: Float[np.ndarray, "n"]
    """Force that the shaking takes [N]."""

    @property
    def noise_rms(self) -> float:
        """RMS of a force component about its drift [N]."""
        return float(np.sqrt((signal.detrend(self.wait, axis=0) ** 2).mean()))

    @property
    def drifted(self) -> float:
        """Force that has crept in by the end of the wait [N]."""
        second = round(1.0 / PERIOD)
        return float(
            np.linalg.norm(self.wait[-second:].mean(axis=0) - self.wait[:second].mean(axis=0))
        )


def read(config: WrenchSensorConfig) -> Readings:
    """Put one sensor through all of it."""
    scene = Scene(SceneConfig(wrist=config))
    wait = _held(scene, config, [DOWN], round(WAIT / PERIOD))
    frequency, density = signal.welch(
        signal.detrend(wait, axis=0), 1 / PERIOD, nperseg=SEGMENT, axis=0
    )
    still = replace(
        config, force_noise=0.0, torque_noise=0.0, drift=0.0, resolution=0.0, bandwidth=np.inf
    )
    tilted = _held(scene, still, [DOWN, *_tilts(config.seed or 0)], 1)
    shaken, inertia = _shaken(scene)
    return Readings(
        quality=config.quality,
        wait=wait - wait[: round(0.2 / PERIOD)].mean(axis=0),
        frequency=frequency,
        density=density.mean(axis=1),
        tilted=np.linalg.norm(tilted[1:] - tilted[0], axis=1),
        contact_error=_contact_error(scene, still),
        shaken=shaken,
        inertia=inertia,
    )


def _held(
    scene: Scene, config: WrenchSensorConfig, orientations: list[np.ndarray], periods: int
) -> np.ndarray:
    """Forces at the tip with the flange held still in each orientation in turn, for so many
    periods.
    """
    load = payload(scene.config.mount_angle)
    sensor, weight = WrenchSensor(config, load, scene.X_FP), load_map(load, MEASURED_AT_F)
    rows = []
    for R_WF in orientations:
        load_F = weight @ (R_WF.T @ GRAVITY_B)
        rows.extend(sensor.measure(load_F, R_WF, REST, REST)[:3] for _ in range(periods))
    return np.array(rows)


def _tilts(seed: int) -> list[np.ndarray]:
    """Orientations tilted by up to `TILT` about any horizontal axis."""
    rng = np.random.default_rng(seed)
    azimuth, tilt = rng.uniform(0, 2 * np.pi, TILTS), TILT * np.sqrt(rng.uniform(0, 1, TILTS))
    axes = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(TILTS)], axis=1)
    return list(Rotation.from_rotvec(tilt[:, None] * axes).as_matrix() @ DOWN)


def _contact_error(scene: Scene, config: WrenchSensorConfig) -> float:
    load = payload(scene.config.mount_angle)
    sensor, weight_F = (
        WrenchSensor(config, load, scene.X_FP),
        load_map(load, MEASURED_AT_F) @ (DOWN.T @ GRAVITY_B),
    )
    sensor.tare(sensor.measure(weight_F, DOWN, REST, REST))
    force_F = scene.X_FP[:3, :3] @ CONTACT_P
    contact_F = np.concatenate([force_F, np.cross(scene.X_FP[:3, 3] - MEASURED_AT_F, force_F)])
    read_P = sensor.measure(weight_F + contact_F, DOWN, REST, REST)
    return float(read_P[2] - CONTACT_P[2])


def _shaken(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Force read, and force that the tool's motion takes, while the arm shakes [N]."""
    robot = SimRobot(scene)
    read = []
    velocity = []
    robot.tare()
    centre_F = payload(scene.config.mount_angle).centre_F
    for t in np.arange(0.0, 1.5, PERIOD):
        shake = SHAKE * np.sin(2 * np.pi * SHAKE_HZ * t)
        robot.servo_joint(HOME_Q + shake * np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]))
        state = robot.state()
        read.append(np.linalg.norm(state.wrench_P[:3]))
        X_BF = scene.arm.forward(state.q)
        velocity.append(X_BF[:3, :3] @ centre_F + X_BF[:3, 3])
    acceleration = np.gradient(np.gradient(np.array(velocity), PERIOD, axis=0), PERIOD, axis=0)
    return np.array(read), payload(scene.config.mount_angle).mass * np.linalg.norm(
        acceleration, axis=1
    )
