"""What settings must satisfy wherever they stand."""

import dataclasses
import difflib
import math
from collections.abc import Iterable

from breastscan.errors import ConfigError


def require_positive(config: object, name: str, *, but: tuple[str, ...] = ()) -> None:
    """Accept a frozen config whose numbers are all finite and positive, those of configs inside it
    as well.

    Args:
        config: The config; fields that are no numbers are left alone.
        name: What the command line calls it.
        but: Fields with a range of their own.

    Raises:
        ConfigError: A number is not.
    """
    for field, value in vars(config).items():
        option = f"{name}.{field}"
        if field in but:
            continue
        if dataclasses.is_dataclass(value):
            require_positive(value, option)
        elif (
            isinstance(value, float | int)
            and not isinstance(value, bool)
            and not 0 < value < math.inf
        ):
            raise ConfigError(f"{option} must be a positive number, got {value}", value)


def require_seed(seed: int | None, name: str = "seed") -> None:
    """Accept a seed that a generator takes, or none.

    Raises:
        ConfigError: It is negative.
    """
    if seed is not None and seed < 0:
        raise ConfigError(f"{name} must be a whole number from 0 on, got {seed}", seed)


def require_known(name: str, known: Iterable[str], what: str) -> None:
    """Accept one of some names; of another, tell the nearest.

    Raises:
        ConfigError: It is none of them.
    """
    names = list(known)
    if name not in names:
        near = difflib.get_close_matches(name, names, 1)
        meant = f", did you mean {near[0]}" if near else ""
        raise ConfigError(
            f"there is no {what} {name!r}{meant}: use one of {', '.join(names)}", name
        )
