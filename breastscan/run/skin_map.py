"""Which skin an examination has touched, point by point, as a cloud that other tools show."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int, UInt8
from trimesh.exchange.ply import export_ply

from breastscan.run import ply

MAP_FILE = "coverage.ply"
STROKES, WANTED = "strokes", "wanted"
"""Properties of a vertex: how many strokes have touched it, and whether it was to be touched."""
COLOURS = {
    "in a margin": "#b8bfca",
    "not touched": "#d55e00",
    "by one stroke": "#56b4e9",
    "by two or more": "#0072b2",
}
"""Of skin in the margins, and of the other by how many strokes have touched it."""


@dataclass(frozen=True, kw_only=True)
class SkinMap:
    """Points of the skin, evenly spread, and by how many strokes each was touched."""

    points_B: Float[np.ndarray, "n 3"]
    """Before they were pressed [m]."""
    strokes: Int[np.ndarray, "n"]
    wanted: Bool[np.ndarray, "n"]
    """Whether they lie between the margins of nipple and base."""

    @property
    def parts(self) -> dict[str, Bool[np.ndarray, "n"]]:
        """The points of each of `COLOURS`."""
        parts = (
            ~self.wanted,
            self.wanted & (self.strokes == 0),
            self.wanted & (self.strokes == 1),
            self.wanted & (self.strokes > 1),
        )
        return dict(zip(COLOURS, parts, strict=True))

    def save(self, path: Path) -> None:
        """Write it as binary PLY, coloured, with `STROKES` and `WANTED` of every point."""
        colours = np.empty((len(self.points_B), 4), np.uint8)
        for name, part in self.parts.items():
            colours[part] = _rgba(COLOURS[name])
        cloud = trimesh.Trimesh(self.points_B, vertex_colors=colours, process=False)
        cloud.vertex_attributes[STROKES] = self.strokes.astype(np.uint8)
        cloud.vertex_attributes[WANTED] = self.wanted.astype(np.uint8)
        path.write_bytes(export_ply(cloud))

    @staticmethod
    def load(path: Path) -> "SkinMap":
        """Read it again.

        Raises:
            ValueError: It is no such file.
        """
        vertex = ply.elements_in(path.read_bytes()).get("vertex", {})
        try:
            return SkinMap(
                points_B=np.column_stack([vertex[axis] for axis in "xyz"]).astype(float),
                strokes=np.asarray(vertex[STROKES], int),
                wanted=np.asarray(vertex[WANTED], bool),
            )
        except KeyError as error:
            raise ValueError(f"its vertices have no property {error}") from error


def _rgba(colour: str) -> UInt8[np.ndarray, "4"]:
    return np.frombuffer(bytes.fromhex(f"{colour[1:]}ff"), np.uint8)
