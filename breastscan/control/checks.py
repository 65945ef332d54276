"""What every setting of the control must satisfy."""

import math

from breastscan.errors import ConfigError


def require_positive(config: object, name: str, *, or_zero: tuple[str, ...] = ()) -> None:
    """Accept a frozen config whose numbers are all finite and positive.

    Args:
        config: The config; fields that are no numbers are left alone.
        name: What the command line calls it.
        or_zero: Fields that may be zero as well.

    Raises:
        ConfigError: A number is not.
    """
    for field, value in vars(config).items():
        if not isinstance(value, float | int) or isinstance(value, bool):
            continue
        allowed = value > 0 or (value == 0 and field in or_zero)
        if not (math.isfinite(value) and allowed):
            wanted = "not negative" if field in or_zero else "a positive number"
            raise ConfigError(f"{name}.{field.replace('_', '-')} must be {wanted}, got {value}", value)
