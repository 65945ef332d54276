"""What settings must satisfy wherever they stand."""

import dataclasses
import math

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
        option = f"{name}.{field.replace('_', '-')}"
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
