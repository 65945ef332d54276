"""The force laws, to choose from by name: how fast the tip is to move along its axis.

Each is a pure function (measurement, reference, memory, gains) -> (speed, memory), on the twin and
on the robot, at 500 or 125 Hz. The command is a speed: as an offset of the pose, a law without an
integral could not hold a force on an elastic body. What was sent in the end, after every limit,
comes back in `Measurement.rate`: no law winds up against a limit.

The gains come from one search for all laws, on a model of the contact (`experiments.tune_force`).
Each law is half as fast here as is best there, so that it does not oscillate on a body that is
stiffer than the model.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

from breastscan.control.filters import Filtered
from breastscan.control.fuzzy import FuzzyGains
from breastscan.control.surface import SkinEstimate

LawName = Literal["observer", "pi-stiffness", "pi", "pd", "fuzzy-pd", "admittance"]


@dataclass(frozen=True)
class Measurement:
    """What a law may know about this period."""

    force: float
    """Measured, positive when pressing [N]."""
    depth: float
    """The tip's commanded place along its axis, positive into the tissue [m]."""
    rate: float
    """The commanded speed that was sent in the last period [m/s]."""
    surface: SkinEstimate
    """The estimate of the skin."""
    lag: float
    """Time by which the tip follows its commands [s]."""
    period: float
    """[s]"""


@dataclass(frozen=True)
class Reference:
    """The force that is wanted now."""

    force: float
    """[N]"""
    change: float = 0.0
    """[N/s]"""


@dataclass(frozen=True, kw_only=True)
class AdmittanceGains:
    """A mass and a damper that the force error moves."""

    mass: float = 0.33
    """[kg]"""
    damping: float = 70.0
    """[N s/m]"""
    filter_hz: float = 100.0
    """Corner of the low-pass on the measured force [Hz]."""


@dataclass(frozen=True, kw_only=True)
class PdGains:
    """Speed proportional to the force error and to its change."""

    proportional: float = 0.014
    """[m/s/N]"""
    derivative: float = 7e-7
    """[m/N]"""
    filter_hz: float = 44.0
    """Corner of the low-pass on the measured force [Hz]."""


@dataclass(frozen=True, kw_only=True)
class PiGains:
    """Speed proportional to the force error and to its integral."""

    proportional: float = 0.0093
    """[m/s/N]"""
    integral: float = 0.05
    """[m/s^2/N]"""
    filter_hz: float = 100.0
    """Corner of the low-pass on the measured force [Hz]."""


@dataclass(frozen=True, kw_only=True)
class PiStiffnessGains:
    """The same law on the force error over the estimated stiffness: an error of indentation."""

    proportional: float = 13.5
    """[1/s]"""
    integral: float = 50.0
    """[1/s^2]"""
    filter_hz: float = 34.0
    """Corner of the low-pass on the measured force [Hz]."""


@dataclass(frozen=True, kw_only=True)
class ObserverGains:
    """The tip goes where the skin will be once the servo has followed."""

    closing_time: float = 0.05
    """Time constant with which the tip closes up to there [s]."""


@dataclass(frozen=True, kw_only=True)
class LawGains:
    """The gains of every law."""

    observer: ObserverGains = field(default_factory=ObserverGains)
    pi_stiffness: PiStiffnessGains = field(default_factory=PiStiffnessGains)
    pi: PiGains = field(default_factory=PiGains)
    pd: PdGains = field(default_factory=PdGains)
    fuzzy_pd: FuzzyGains = field(default_factory=FuzzyGains)
    admittance: AdmittanceGains = field(default_factory=AdmittanceGains)

    def of(self, law: str) -> object:
        """Those of one law."""
        return getattr(self, law.replace("-", "_"))


@dataclass(frozen=True)
class LawMemory:
    """What a law carries from one period to the next; each uses what it needs."""

    filtered: Filtered
    integral: float = 0.0
    """Of the error, as a speed [m/s]."""
    requested: float = 0.0
    """The speed that the law requested in the last period [m/s]."""


Law = Callable[[Measurement, Reference, LawMemory, Any], tuple[float, LawMemory]]


def admittance(
    measurement: Measurement, reference: Reference, memory: LawMemory, gains: AdmittanceGains
) -> tuple[float, LawMemory]:
    """Mass * acceleration + damping * speed = force error."""
    filtered = memory.filtered.after(measurement.force, gains.filter_hz, measurement.period)
    push = reference.force - filtered.force - gains.damping * measurement.rate
    return measurement.rate + measurement.period * push / gains.mass, LawMemory(filtered)


def pd(
    measurement: Measurement, reference: Reference, memory: LawMemory, gains: PdGains
) -> tuple[float, LawMemory]:
    """Fixed gains on the force error and its change."""
    filtered = memory.filtered.after(measurement.force, gains.filter_hz, measurement.period)
    error, change = reference.force - filtered.force, reference.change - filtered.change
    return gains.proportional * error + gains.derivative * change, LawMemory(filtered)


def fuzzy_pd(
    measurement: Measurement, reference: Reference, memory: LawMemory, gains: FuzzyGains
) -> tuple[float, LawMemory]:
    """PD whose gains follow the rules of `control.fuzzy` [Zhang, Sec. V-B.2]."""
    filtered = memory.filtered.after(measurement.force, gains.filter_hz, measurement.period)
    error, change = reference.force - filtered.force, reference.change - filtered.change
    proportional, derivative = gains.at(error, change)
    return proportional * error + derivative * change, LawMemory(filtered)


def pi(
    measurement: Measurement, reference: Reference, memory: LawMemory, gains: PiGains
) -> tuple[float, LawMemory]:
    """Fixed gains on the force error and its integral."""
    filtered = memory.filtered.after(measurement.force, gains.filter_hz, measurement.period)
    error = reference.force - filtered.force
    integral = _integrated(memory, gains.integral * error, measurement)
    requested = gains.proportional * error + integral
    return requested, LawMemory(filtered, integral, requested)


def pi_stiffness(
    measurement: Measurement, reference: Reference, memory: LawMemory, gains: PiStiffnessGains
) -> tuple[float, LawMemory]:
    """PI on the error of the indentation that the estimated stiffness makes of the force error."""
    filtered = memory.filtered.after(measurement.force, gains.filter_hz, measurement.period)
    slope = measurement.surface.slope(reference.force)
    error = (reference.force - filtered.force) / slope
    integral = _integrated(memory, gains.integral * error, measurement)
    requested = gains.proportional * error + integral + reference.change / slope
    return requested, LawMemory(filtered, integral, requested)


def observer(
    measurement: Measurement, reference: Reference, memory: LawMemory, gains: ObserverGains
) -> tuple[float, LawMemory]:
    """Follow the skin's estimated place and speed, predicted over the servo's lag, at the
    indentation of the force.
    """
    surface = measurement.surface
    ahead = (
        surface.position + surface.speed * measurement.lag + surface.indentation(reference.force)
    )
    return surface.speed + (ahead - measurement.depth) / gains.closing_time, memory


LAWS: dict[str, Law] = {
    "observer": observer,
    "pi-stiffness": pi_stiffness,
    "pi": pi,
    "pd": pd,
    "fuzzy-pd": fuzzy_pd,
    "admittance": admittance,
}


def _integrated(memory: LawMemory, growth: float, measurement: Measurement) -> float:
    """The integral [m/s] one period on; it stands still while a limit holds back what it requested
    for already.
    """
    held_back = memory.requested - measurement.rate
    if held_back * growth > 0.0:
        return memory.integral
    return memory.integral + growth * measurement.period
