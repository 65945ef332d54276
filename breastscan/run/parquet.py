"""Tables as Parquet files that say of themselves what stands in them and where it came from."""

import io
import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import polars

from breastscan.errors import ConfigError
from breastscan.geometry import se3
from breastscan.run.columns import FRAMES, Column, Columns, descriptions, names
from breastscan.run.provenance import provenance

KINDS = {"number": polars.Float64, "text": polars.String, "yes or no": polars.Boolean}
"""As what each kind of column is stored."""
POSE_COLUMNS = 7
NAMED = 3
"""Most missing columns that an error names."""


def write(
    path: Path, columns: Columns, values: Mapping[str, object], seed: int | None = None
) -> None:
    """Write arrays as flat columns; what is None is left out.

    Args:
        path: The file.
        columns: Which columns hold which array.
        values: The arrays: a value, a vector or a pose a row.
        seed: Of the run, for the file's metadata.
    """
    flat: dict[str, object] = {}
    for field, group in columns.items():
        if values[field] is not None:
            flat |= zip((column.name for column in group), _split(values[field]), strict=True)
    whole = io.BytesIO()  # polars itself would not say of a full disk that it is full
    polars.DataFrame(flat).write_parquet(whole, metadata=_metadata(columns, seed))
    path.write_bytes(whole.getvalue())


def read(path: Path, columns: Columns, optional: tuple[str, ...] = ()) -> dict[str, np.ndarray]:
    """The arrays that `write` wrote; of the optional ones those that are there.

    Raises:
        ConfigError: The file is no such table: a column is missing or holds something else, or
            there is no row.
    """
    try:
        source = polars.read_parquet(path)
    except (polars.exceptions.PolarsError, OSError) as error:
        raise ConfigError(
            f"{path} is not a Parquet file ({error}): run the scan again", path
        ) from error
    present = {
        field: group
        for field, group in columns.items()
        if field not in optional or group[0].name in source.columns
    }
    _require_columns(present, source, path)
    return {field: _joined(group, source) for field, group in present.items()}


def _metadata(columns: Columns, seed: int | None) -> dict[str, str]:
    """Where the file comes from and what its columns are; nested entries as JSON."""
    facts = provenance()
    told = {"breastscan": facts["versions"]["breastscan"], "seed": seed, **facts}
    told |= {"frames": FRAMES, "columns": descriptions(columns)}
    return {
        name: value if isinstance(value, str) else json.dumps(value)
        for name, value in told.items()
        if value is not None
    }


def _require_columns(columns: Columns, source: polars.DataFrame, path: Path) -> None:
    missing = [name for name in names(columns) if name not in source.columns]
    if missing:
        shown = ", ".join(missing[:NAMED])
        more = f" and {len(missing) - NAMED} more" if len(missing) > NAMED else ""
        raise ConfigError(
            f"{path} lacks the columns {shown}{more}: it is another table than docs/data.md lists, "
            "or of an earlier version; run the scan again",
            missing,
        )
    if source.is_empty():
        raise ConfigError(f"{path} holds no sample: run the scan again", path)
    for column in (column for group in columns.values() for column in group):
        _require_kind(column, source[column.name], path)


def _require_kind(column: Column, found: polars.Series, path: Path) -> None:
    if found.dtype != KINDS[column.kind] or found.has_nulls():
        raise ConfigError(
            f"column {column.name} of {path} should hold a {column.kind} in every row, as "
            f"{KINDS[column.kind]}, got {found.dtype} with {found.null_count()} empty rows: run "
            "the scan again",
            column.name,
        )


def _split(values: object) -> list[np.ndarray]:
    """One array a column."""
    array = np.asarray(values)
    if array.ndim == 3:
        array = np.hstack([array[:, :3, 3], se3.quaternion(array)])
    return [array] if array.ndim == 1 else list(array.T)


def _joined(group: tuple[Column, ...], source: polars.DataFrame) -> np.ndarray:
    """The array of which `_split` made these columns."""
    columns = [source[column.name].to_numpy(writable=True) for column in group]
    if len(columns) == 1:
        return columns[0]
    array = np.stack(columns, axis=1)
    if len(columns) == POSE_COLUMNS:
        return se3.from_quaternion(array[:, 3:], array[:, :3])
    return array
