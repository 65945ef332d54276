"""Fuzzy PD: gains that follow the error and its change, by the usual 7 x 7 rules [Zhang, Sec.
V-B.2].

Triangular sets a unit apart on [-3, 3], product and centre average: since the sets add up to one
everywhere, the answer is the rule table, interpolated between the four rules that fire. In plain
Python, because no library answers within a control period.

As usually printed the table is lopsided: a force that is too high would be corrected more lazily
than one that is too low, and noise would turn into a standing error. It is therefore read at (-|e|,
-sign(e) de), where both are the same.
"""

from dataclasses import dataclass

from breastscan.errors import ConfigError

SETS = ("NB", "NM", "NS", "ZO", "PS", "PM", "PB")
"""Negative big to positive big; their peaks lie at -3 to 3."""
LARGEST = 3.0
"""Where the outermost sets have their peaks; beyond, they stay at 1."""

_USUAL_TABLE = """
    PB/PS PB/NS PM/NB PM/NB PS/NB ZO/NM ZO/PS
    PB/PS PB/NS PM/NB PS/NM PS/NM ZO/NS NS/ZO
    PM/ZO PM/NS PM/NM PS/NM ZO/NS NS/NS NS/ZO
    PM/ZO PM/NS PS/NS ZO/NS NS/NS NM/NS NM/ZO
    PS/ZO PS/ZO ZO/ZO NS/ZO NS/ZO NM/ZO NM/ZO
    PS/PB ZO/NS NS/PS NM/PS NM/PS NM/PS NB/PB
    ZO/PB ZO/PM NM/PM NM/PM NM/PS NB/PS NB/PB
"""
RULES = tuple(
    tuple(rule.split("/") for rule in line.split()) for line in _USUAL_TABLE.strip().splitlines()
)
"""Sets of the changes of both gains, proportional and derivative; rows the error's set, columns
that of its change."""
_PEAK = {name: index - LARGEST for index, name in enumerate(SETS)}
_CHANGES = tuple(tuple((_PEAK[kp], _PEAK[kd]) for kp, kd in row) for row in RULES)


@dataclass(frozen=True, kw_only=True)
class FuzzyGains:
    """The gains about which the rules move, and how far they move them."""

    error_scale: float = 1.0
    """Force error that is called big [N]."""
    change_scale: float = 26.0
    """Change of the error that is called big [N/s]."""
    proportional: float = 0.0135
    """Speed of the correction per force error [m/s/N]."""
    proportional_swing: float = 0.35
    """Share of it that the rules add or take away at most [-]."""
    derivative: float = 2e-6
    """Speed of the correction per change of the force error [m/N]."""
    derivative_swing: float = 0.93
    """Share of it that the rules add or take away at most [-]."""
    filter_hz: float = 88.0
    """Corner of the low-pass on the measured force [Hz]."""

    def __post_init__(self) -> None:
        for name, swing in (
            ("proportional", self.proportional_swing),
            ("derivative", self.derivative_swing),
        ):
            if swing > 1.0:
                raise ConfigError(
                    f"{name}_swing must be 1 at most, got {swing}: a gain that turns "
                    "negative would push the wrong way",
                    swing,
                )

    def at(self, error: float, change: float) -> tuple[float, float]:
        """Proportional [m/s/N] and derivative gain [m/N] at a force error [N] and its change
        [N/s].
        """
        dkp, dkd = infer(LARGEST * error / self.error_scale, LARGEST * change / self.change_scale)
        return (
            self.proportional * (1.0 + self.proportional_swing * dkp / LARGEST),
            self.derivative * (1.0 + self.derivative_swing * dkd / LARGEST),
        )


def infer(error: float, change: float) -> tuple[float, float]:
    """What the rules say about both gains, in [-3, 3]: the same for (e, de) and (-e, -de).

    Args:
        error: Scaled error; beyond [-3, 3] as at its ends.
        change: Its scaled change.
    """
    if error > 0.0:
        error, change = -error, -change
    return infer_as_printed(error, change)


def infer_as_printed(error: float, change: float) -> tuple[float, float]:
    """The table itself, lopsided."""
    row, across = _place(error)
    column, along = _place(change)
    first, second = _CHANGES[row], _CHANGES[row + 1]
    w00, w01 = (1.0 - across) * (1.0 - along), (1.0 - across) * along
    w10, w11 = across * (1.0 - along), across * along
    a = first[column]
    b = first[column + 1]
    c = second[column]
    d = second[column + 1]
    return (
        w00 * a[0] + w01 * b[0] + w10 * c[0] + w11 * d[0],
        w00 * a[1] + w01 * b[1] + w10 * c[1] + w11 * d[1],
    )


def _place(value: float) -> tuple[int, float]:
    """Index of the left one of the two sets that a value belongs to, and its membership of the
    right one.
    """
    place = min(max(value, -LARGEST), LARGEST) + LARGEST
    index = min(int(place), len(SETS) - 2)
    return index, place - index
