"""What a force law is: a measurement and a wanted force in, a speed along the probe axis out.

The laws that have a name are in `control.laws`; one of your own is a class with these two methods,
given as `ContactConfig(law=...)`. The command is a speed: as an offset of the pose, a law without
an integral could not hold a force on an elastic body. What was sent in the end, after every limit,
comes back in `Measurement.rate`: a law that goes by it does not wind up against a limit.
"""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from breastscan.control.surface import SkinEstimate


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
    """Control period [s]."""


@dataclass(frozen=True)
class Reference:
    """The force that is wanted now."""

    force: float
    """[N]"""
    change: float = 0.0
    """[N/s]"""


@runtime_checkable
class ForceLaw(Protocol):
    """A law that holds a force; a frozen dataclass, whose fields `config.json` then holds.

    Both methods are pure. A law keeps what it needs in its memory, a value of its own choice:
    a command that the robot refused did not happen, and its memory is dropped with it.
    """

    def begin(self, force: float) -> Any:
        """The memory for the first period of a contact.

        Args:
            force: Low-passed force at that moment, positive when pressing [N].
        """
        ...

    def speed(
        self, measurement: Measurement, reference: Reference, memory: Any
    ) -> tuple[float, Any]:
        """One period.

        Args:
            measurement: What is known.
            reference: The force that is wanted.
            memory: What this law returned in the period before, or at `begin`.

        Returns:
            Requested speed of the tip along its axis, positive into the tissue [m/s], which the
            controller then bounds; and the memory for the next period.
        """
        ...
