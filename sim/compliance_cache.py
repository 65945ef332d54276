"""The tissue's compliance kept on disk: it takes half a minute to compute and depends on the shape alone."""

import hashlib
import os
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np
import platformdirs

from sim.compliance import SkinCompliance, compute_compliance
from sim.mesh import mesh_phantom
from sim.phantom import Phantom

FORMAT = 1
"""Raised with every change of the computation or of the file."""


def cached_compliance(
    phantom: Phantom, skin_points: int, progress: Callable[[float, str], None] | None = None
) -> SkinCompliance:
    """The phantom's compliance, from the user's cache directory if it is there and sound, else computed and kept."""
    path = platformdirs.user_cache_path("breastscan") / f"tissue-{_key(phantom, skin_points)}.npz"
    kept = _load(path)
    if kept is not None:
        return kept
    compliance = compute_compliance(phantom, skin_points, progress)
    _save(path, compliance)
    return compliance


def _key(phantom: Phantom, skin_points: int) -> str:
    """Hash of all that the compliance depends on: the mesh, which holds the shape, and Poisson's ratio."""
    mesh = mesh_phantom(phantom, skin_points)
    digest = hashlib.sha256(repr((FORMAT, phantom.config.poisson)).encode())
    digest.update(mesh.nodes_S.tobytes())
    digest.update(mesh.tetrahedra.tobytes())
    return digest.hexdigest()[:16]


def _load(path: Path) -> SkinCompliance | None:
    """The compliance in the file; None if there is none or it is damaged."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {field.name: file[field.name] for field in fields(SkinCompliance)}
    except (OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile):
        return None
    count = len(arrays["vertices_S"])
    sound = arrays["response_S"].shape == (count, count, 3) and np.isfinite(arrays["response_S"]).all()
    return SkinCompliance(**arrays) if sound else None


def _save(path: Path, compliance: SkinCompliance) -> None:
    """Write beside the target and move it there, so that no reader ever sees half a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
        try:
            np.savez(file, **{field.name: getattr(compliance, field.name) for field in fields(SkinCompliance)})
        except BaseException:
            os.unlink(file.name)
            raise
    os.replace(file.name, path)
