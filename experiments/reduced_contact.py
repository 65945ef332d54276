"""One axis of the scan: a late servo presses a nonlinear spring whose rest position moves, and a
noisy sensor tells.

The product's own force control runs on it, without the arm, the tissue's finite elements and the
contact problem: what gains are tuned on.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from breastscan.control import contact
from breastscan.control.contact import ContactConfig, ContactMemory
from breastscan.control.phases import ramp
from breastscan.control.servo_model import ServoModel
from breastscan.robot.ur.ur5e import PERIOD, SERVO

EXPONENT = 1.47
"""Of the twin's force over its indentation, from .5 to 8 mm on the default phantom [-]."""
YOUNG = 30e3
FORCE = 4.95
INDENTATION = 0.006
"""Measured once on the twin: this force [N] at this indentation [m] for this modulus [Pa]."""
DAMPING = 3.0
"""Relative rise of the force per speed of indentation [s/m], as in `sim.tissue.soft`."""
NORMAL_FRACTION = 0.64
"""Fraction of a vertical motion along the probe axis, halfway up the breast."""

Motion = Callable[[float], float]


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """Errors of the force along the probe axis."""

    noise: float = 0.0
    """RMS [N]."""
    bandwidth_hz: float = 1e3
    """Corner of its low-pass [Hz]."""
    resolution: float = 0.0
    """[N]"""
    drift: float = 0.0
    """[N/s]"""


SENSORS = {
    "ideal": Sensor(),
    "industrial": Sensor(noise=0.05, bandwidth_hz=100.0, resolution=0.02, drift=0.1 / 60.0),
    "ur5e_builtin": Sensor(noise=0.3, bandwidth_hz=50.0, resolution=0.1, drift=4.0 / 300.0),
}


@dataclass(frozen=True, kw_only=True)
class Plant:
    """What the controller meets."""

    young: float = YOUNG
    """[Pa]"""
    lag: float = SERVO.lag
    """Of the servo [s]."""
    stiffness_scale: Motion = field(default=lambda t: 1.0)
    """Factor on the force over time."""
    skin: Motion = field(default=lambda t: 0.0)
    """Place of the undeformed skin along the axis over time [m]."""
    sensor: Sensor = SENSORS["ideal"]


def run(
    config: ContactConfig, plant: Plant, *, duration: float, seed: int
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Settle on the skin and hold the force.

    Args:
        config: Law and bounds.
        plant: What is pressed.
        duration: From first contact on [s].
        seed: Of the sensor's noise.

    Returns:
        True force and commanded depth, one value a period [N, m].
    """
    scale = FORCE / INDENTATION**EXPONENT * plant.young / YOUNG
    readings = _Readings(plant.sensor, round(duration / PERIOD), seed)
    start = plant.skin(0.0) + (config.contact_force / scale) ** (1 / EXPONENT)
    tip = ServoModel.resting(start, SERVO, PERIOD)
    memory = ContactMemory.resting(start, SERVO, PERIOD)
    memory = replace(
        memory, slow=replace(memory.slow, force=config.contact_force), variance=readings.variance
    )
    memory = contact.begin(memory, config)
    before = plant.skin(0.0)
    forces, depths = np.empty((2, round(duration / PERIOD)))
    for k in range(len(forces)):
        time = k * PERIOD
        skin = plant.skin(time)
        indentation, inward = max(tip.position - skin, 0.0), tip.speed - (skin - before) / PERIOD
        force = (
            plant.stiffness_scale(time)
            * scale
            * indentation**EXPONENT
            * max(1.0 + DAMPING * inward, 0.0)
        )
        before = skin
        memory = contact.sense(memory, readings(k, force), config, PERIOD)
        wanted = ramp(time, config.contact_force, config.force, config.phases.ramp_time)
        memory = contact.regulate(memory, wanted, config, SERVO.lag, PERIOD)
        tip = tip.after(memory.depth, plant.lag, PERIOD)
        forces[k], depths[k] = force, memory.depth
    return forces, depths


class _Readings:
    """The sensor: low-pass, noise in its band, drift, rounding."""

    def __init__(self, sensor: Sensor, count: int, seed: int) -> None:
        self._sensor = sensor
        self._weight = 1.0 - math.exp(-2.0 * math.pi * sensor.bandwidth_hz * PERIOD)
        white = np.random.default_rng(seed).standard_normal(count)
        self._noise = sensor.noise * np.sqrt((2.0 - self._weight) / self._weight) * white
        self._passed = 0.0
        self.variance = sensor.noise**2 * self._weight
        """What the controller would have learnt of it in the air [N^2]: half the mean square of
        differences."""

    def __call__(self, k: int, force: float) -> float:
        sensor = self._sensor
        self._passed += self._weight * (force + self._noise[k] - self._passed)
        reading = self._passed + sensor.drift * k * PERIOD
        return (
            round(reading / sensor.resolution) * sensor.resolution if sensor.resolution else reading
        )


def breathing(amplitude: float, waveform: str, rate: float = 0.25, phase: float = 0.0) -> Motion:
    """Vertical breathing [m] of the plate, as it moves the skin along the probe axis: `sine`, or
    `cos4` [Lujan].
    """
    along = -NORMAL_FRACTION * amplitude

    def sine(time: float) -> float:
        return along * math.sin(2.0 * math.pi * rate * time + phase)

    def cos4(time: float) -> float:
        return 2.0 * along * math.cos(math.pi * rate * time + phase) ** 4

    return {"sine": sine, "cos4": cos4}[waveform]


def ramped(height: float, *, start: float, duration: float) -> Motion:
    """A skin that lies `height` [m] deeper than planned from `start + duration` [s] on."""
    return lambda time: height * min(max((time - start) / duration, 0.0), 1.0)


def waviness(seed: int, speed: float = 0.025) -> Motion:
    """What a plan misses of the skin: waves of .1 mm and 10 to 40 mm, and 3 mm ripple of .016 mm
    RMS [m].
    """
    rng = np.random.default_rng(seed)
    lengths, phases = np.array([40.0, 25.0, 15.0, 10.0, 3.1]) * 1e-3, rng.uniform(0, 2 * np.pi, 5)
    heights = np.array([0.10, 0.07, 0.04, 0.03, 0.023]) * 1e-3
    waves = [
        (h, 2 * math.pi * speed / length, p)
        for h, length, p in zip(heights, lengths, phases, strict=True)
    ]
    return lambda time: sum(h * math.sin(w * time + p) for h, w, p in waves)


def together(*motions: Motion) -> Motion:
    """The sum of motions."""
    return lambda time: sum(motion(time) for motion in motions)
