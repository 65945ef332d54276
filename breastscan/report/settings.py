"""The settings of a run, as `config.json` nests them."""

from collections.abc import Iterator
from typing import Any

SET_POINT = "contact.force"
"""Name that the set-point of the contact force [N] ends in, wherever it is nested."""


def flattened(settings: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Nested settings as pairs of a dotted name and a value."""
    for key, value in settings.items():
        if isinstance(value, dict):
            yield from flattened(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def force_set_point(settings: dict[str, Any]) -> float | None:
    """Contact force that the scan was set to hold [N]; None where the settings do not say."""
    return next((float(value) for name, value in flattened(settings) if f".{name}".endswith(f".{SET_POINT}")), None)
