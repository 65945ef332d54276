"""Where a run's numbers come from, as its `config.json` says."""

from typing import Any

KEYS = ("date", "command", "commit", "seed")
"""In the order in which they are shown."""


def of(settings: dict[str, Any]) -> list[tuple[str, str]]:
    """Date, command, commit, version and seed as pairs of a name and a text; what is not known is
    left out.
    """
    versions = settings.get("versions")
    version = versions.get("breastscan") if isinstance(versions, dict) else None
    known = {key: settings.get(key) for key in KEYS} | {"version": version}
    return [(key, str(value)) for key, value in known.items() if value is not None]
