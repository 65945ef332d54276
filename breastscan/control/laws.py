"""The force laws that have a name, with their gains.

They come from one search for all laws, on a model of the contact (`experiments.tune_force`). Each
law is half as fast here as is best there, so that it does not oscillate on a body that is stiffer
than the model.
"""

from dataclasses import dataclass, field
from typing import Literal, get_args

from breastscan.control.filters import Filtered
from breastscan.control.force_law import ForceLaw, Measurement, Reference
from breastscan.control.fuzzy import FuzzyGains

LawName = Literal["observer", "pi-stiffness", "pi", "pd", "fuzzy-pd", "admittance"]
LAW_NAMES: tuple[LawName, ...] = get_args(LawName)
DEFAULT_LAW: LawName = "observer"
"""`docs/control.md` says why."""


@dataclass(frozen=True, kw_only=True)
class Observer:
    """The tip goes where the skin will be once the servo has followed."""

    closing_time: float = 0.05
    """Time constant with which the tip closes up to there [s]."""

    def begin(self, force: float) -> None:
        """Nothing is carried over: the memory is the estimate of the skin."""

    def speed(
        self, measurement: Measurement, reference: Reference, memory: None
    ) -> tuple[float, None]:
        """Follow the skin's estimated place and speed, predicted over the servo's lag, at the
        indentation of the force.
        """
        surface = measurement.surface
        ahead = (
            surface.position
            + surface.speed * measurement.lag
            + surface.indentation(reference.force)
        )
        return surface.speed + (ahead - measurement.depth) / self.closing_time, None


@dataclass(frozen=True)
class IntegralMemory:
    """What a law with an integral carries from one period to the next."""

    filtered: Filtered
    integral: float = 0.0
    """Of the error, as a speed [m/s]."""
    requested: float = 0.0
    """The speed that the law requested in the last period [m/s]."""


@dataclass(frozen=True, kw_only=True)
class PiStiffness:
    """PI on the force error over the estimated stiffness: an error of indentation."""

    proportional: float = 13.5
    """[1/s]"""
    integral: float = 50.0
    """[1/s^2]"""
    filter_hz: float = 34.0
    """Corner of the low-pass on the measured force [Hz]."""

    def begin(self, force: float) -> IntegralMemory:
        """The filter at the force, the integral at zero."""
        return IntegralMemory(Filtered(force))

    def speed(
        self, measurement: Measurement, reference: Reference, memory: IntegralMemory
    ) -> tuple[float, IntegralMemory]:
        """The integral and the error of the indentation, and the change of the reference."""
        slope = measurement.surface.slope(reference.force)
        feed_forward = reference.change / slope
        return _pi(self, measurement, reference.force, memory, slope, feed_forward)


@dataclass(frozen=True, kw_only=True)
class Pi:
    """Speed proportional to the force error and to its integral."""

    proportional: float = 0.0093
    """[m/s/N]"""
    integral: float = 0.05
    """[m/s^2/N]"""
    filter_hz: float = 100.0
    """Corner of the low-pass on the measured force [Hz]."""

    def begin(self, force: float) -> IntegralMemory:
        """The filter at the force, the integral at zero."""
        return IntegralMemory(Filtered(force))

    def speed(
        self, measurement: Measurement, reference: Reference, memory: IntegralMemory
    ) -> tuple[float, IntegralMemory]:
        """Fixed gains on the force error and its integral."""
        return _pi(self, measurement, reference.force, memory)


@dataclass(frozen=True, kw_only=True)
class Pd:
    """Speed proportional to the force error and to its change."""

    proportional: float = 0.014
    """[m/s/N]"""
    derivative: float = 7e-7
    """[m/N]"""
    filter_hz: float = 44.0
    """Corner of the low-pass on the measured force [Hz]."""

    def begin(self, force: float) -> Filtered:
        """The filter at the force."""
        return Filtered(force)

    def speed(
        self, measurement: Measurement, reference: Reference, memory: Filtered
    ) -> tuple[float, Filtered]:
        """Fixed gains on the force error and its change."""
        return _pd(self, measurement, reference, memory)

    def at(self, error: float, change: float) -> tuple[float, float]:
        """The gains, whatever the error [N] and its change [N/s]."""
        return self.proportional, self.derivative


@dataclass(frozen=True, kw_only=True)
class FuzzyPd(FuzzyGains):
    """PD whose gains follow the rules of `control.fuzzy` [Zhang, Sec. V-B.2]."""

    def begin(self, force: float) -> Filtered:
        """The filter at the force."""
        return Filtered(force)

    def speed(
        self, measurement: Measurement, reference: Reference, memory: Filtered
    ) -> tuple[float, Filtered]:
        """The gains of this error and this change, on both."""
        return _pd(self, measurement, reference, memory)


@dataclass(frozen=True, kw_only=True)
class Admittance:
    """A mass and a damper that the force error moves."""

    mass: float = 0.33
    """[kg]"""
    damping: float = 70.0
    """[N s/m]"""
    filter_hz: float = 100.0
    """Corner of the low-pass on the measured force [Hz]."""

    def begin(self, force: float) -> Filtered:
        """The filter at the force."""
        return Filtered(force)

    def speed(
        self, measurement: Measurement, reference: Reference, memory: Filtered
    ) -> tuple[float, Filtered]:
        """Mass * acceleration + damping * speed = force error."""
        filtered = memory.after(measurement.force, self.filter_hz, measurement.period)
        push = reference.force - filtered.force - self.damping * measurement.rate
        return measurement.rate + measurement.period * push / self.mass, filtered


@dataclass(frozen=True, kw_only=True)
class Laws:
    """Every law that has a name, with its gains."""

    observer: Observer = field(default_factory=Observer)
    pi_stiffness: PiStiffness = field(default_factory=PiStiffness)
    pi: Pi = field(default_factory=Pi)
    pd: Pd = field(default_factory=Pd)
    fuzzy_pd: FuzzyPd = field(default_factory=FuzzyPd)
    admittance: Admittance = field(default_factory=Admittance)

    def named(self, name: LawName) -> ForceLaw:
        """One of them."""
        return getattr(self, name.replace("-", "_"))


def _pi(
    law: PiStiffness | Pi,
    measurement: Measurement,
    force: float,
    memory: IntegralMemory,
    slope: float = 1.0,
    feed_forward: float = 0.0,
) -> tuple[float, IntegralMemory]:
    """PI on the error of a force [N] over a slope, with a speed [m/s] fed forward."""
    filtered = memory.filtered.after(measurement.force, law.filter_hz, measurement.period)
    error = (force - filtered.force) / slope
    integral = _integrated(memory, law.integral * error, measurement)
    requested = law.proportional * error + integral + feed_forward
    return requested, IntegralMemory(filtered, integral, requested)


def _pd(
    law: Pd | FuzzyPd, measurement: Measurement, reference: Reference, memory: Filtered
) -> tuple[float, Filtered]:
    """PD on the force error, with the law's gains at this error and this change."""
    filtered = memory.after(measurement.force, law.filter_hz, measurement.period)
    error, change = reference.force - filtered.force, reference.change - filtered.change
    proportional, derivative = law.at(error, change)
    return proportional * error + derivative * change, filtered


def _integrated(memory: IntegralMemory, growth: float, measurement: Measurement) -> float:
    """The integral [m/s] one period on; it stands still while a limit holds back what was requested
    already.
    """
    held_back = memory.requested - measurement.rate
    if held_back * growth > 0.0:
        return memory.integral
    return memory.integral + growth * measurement.period
