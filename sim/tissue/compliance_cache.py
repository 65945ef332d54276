"""The tissue's compliance kept on disk: it takes seconds to compute, and one serves every size
and every stiffness.
"""

import hashlib
import os
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
import platformdirs

from breastscan.tissue.mesh import mesh_breast
from sim.tissue.compliance import SkinCompliance, compute_compliance
from sim.tissue.layers import SKIN_THICKNESS, TRANSITION
from sim.tissue.phantom import Phantom

FORMAT = 2
"""Raised with every change of the computation or of the file."""
MAX_BYTES = 100_000_000
"""What the kept files may take on disk; the oldest go first."""
DECIMALS = 9
"""Places to which two shapes must agree, over their mean radius."""


def cached_compliance(
    phantom: Phantom, skin_points: int, progress: Callable[[float, str], None] | None = None
) -> SkinCompliance:
    """The phantom's compliance, from the user's cache directory if it is there and sound, else
    computed and kept.
    """
    folder = platformdirs.user_cache_path("breastscan")
    path = folder / f"tissue-{_key(phantom, skin_points)}.npz"
    unit = _load(path)
    if unit is None:
        computed = compute_compliance(phantom, skin_points, progress).scaled(1 / phantom.radius)
        unit = _in_file_order(computed)
        _save(path, unit)
        _make_room(folder)
    return unit.scaled(phantom.radius)  # the same to the last bit, whether it was kept or computed


def _key(phantom: Phantom, skin_points: int) -> str:
    """Hash of all that the compliance of a breast with a radius of 1 m depends on: its mesh and
    its tissues.
    """
    mesh = mesh_breast(phantom.embed, skin_points)
    digest = hashlib.sha256(repr((FORMAT, phantom.config.poisson, *_layers(phantom))).encode())
    digest.update(np.round(mesh.nodes / phantom.radius, DECIMALS).tobytes())
    digest.update(mesh.tetrahedra.tobytes())
    return digest.hexdigest()[:16]


def _layers(phantom: Phantom) -> list[float]:
    """The tissues' numbers in a breast with a radius of 1 m; those that are absent have none.

    The numbers themselves, not the stiffness at the mesh's corners: a small mass lies between them.
    """
    layers, unit = phantom.config.layers, phantom.radius
    transition = TRANSITION / unit
    numbers = [layers.skin_ratio * SKIN_THICKNESS / unit]
    if layers.gland_fraction > 0:
        numbers += [layers.gland_fraction, layers.gland_ratio, transition]
    if layers.mass_radius > 0:
        place = [coordinate / unit for coordinate in layers.mass_p_S]
        numbers += [layers.mass_radius / unit, *place, layers.mass_ratio, transition]
    return [round(number, DECIMALS) for number in numbers]


def _load(path: Path) -> SkinCompliance | None:
    """The compliance in the file; None if there is none or it is damaged."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {field.name: file[field.name] for field in fields(SkinCompliance)}
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile):
        return None
    count = len(arrays["vertices_S"])
    valid = (
        arrays["response_S"].shape == (count, count, 3) and np.isfinite(arrays["response_S"]).all()
    )
    return SkinCompliance(**arrays) if valid else None


def _in_file_order(compliance: SkinCompliance) -> SkinCompliance:
    """The arrays in memory as a file gives them: sums over another order differ in the last bit."""
    arrays = {
        field.name: np.ascontiguousarray(getattr(compliance, field.name))
        for field in fields(SkinCompliance)
    }
    return SkinCompliance(**arrays)


def _save(path: Path, compliance: SkinCompliance) -> None:
    """Write beside the target and move it there, so that no reader ever sees half a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
        try:
            np.savez(
                file,
                **{field.name: getattr(compliance, field.name) for field in fields(SkinCompliance)},
            )
        except BaseException:
            os.unlink(file.name)
            raise
    os.replace(file.name, path)


def _make_room(folder: Path) -> None:
    """Delete the oldest files until the rest takes no more than `MAX_BYTES`."""
    taken = 0
    for path in sorted(
        folder.glob("tissue-*.npz"), key=lambda file: file.stat().st_mtime, reverse=True
    ):
        taken += path.stat().st_size
        if taken > MAX_BYTES:
            path.unlink(missing_ok=True)
