"""Grid, uniform and geometric down-sampling, measured [Zhang, Sec. III-B, Fig. 11, Table 3]."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.ndimage import binary_erosion
from scipy.spatial import KDTree

from breastscan.cloud import filters, normals
from breastscan.report import theme
from breastscan.run.columns import Column
from experiments.paper import drawing
from experiments.paper.item import Item, column, coordinates, judged
from experiments.paper.scans import Scanned

CELLS = (3e-3, 2e-3, 1.5e-3)
"""Edges of the grid's cubes that are tried [m]; the middle one is drawn."""
DRAWN_CELL = CELLS[1]
RIM_PX = 1
"""Width of the rim of the breast in the picture that counts as its edge [px]."""
PREFERRED = 1.05
"""Share of a sample on the rim over the rim's share of the area, from which it prefers the rim."""


@dataclass(frozen=True, kw_only=True)
class Sampled:
    """One way of down-sampling, and what it did."""

    name: str
    requested: int
    """Number of points that was asked for; 0 where a length is asked for."""
    chosen: Int[np.ndarray, "m"]
    """Rows of the cloud."""
    time: float
    """[s]"""
    spacing_mm: float
    """Mean distance of the nearest neighbours [mm]."""
    unevenness: float
    """Standard deviation of that distance over its mean [-]; of points drawn at random over a plane
    .52."""
    gap_mm: float
    """Farthest that any point of the cloud is from the sample [mm]."""
    edge_ratio: float
    """Share of the sample that lies on the rim over the rim's share of the cloud's area [-]."""


def unevenness(points: Float[np.ndarray, "n 3"]) -> tuple[float, float]:
    """Mean distance of nearest neighbours, and its deviation over the mean [-]."""
    distances = KDTree(points).query(points, k=2)[0][:, 1]
    return float(distances.mean()), float(distances.std() / distances.mean())


def compared(
    cloud: Float[np.ndarray, "n 3"],
    on_rim: np.ndarray,
    area: Float[np.ndarray, "n"],
    *,
    seed: int,
    cells: tuple[float, ...] = CELLS,
) -> list[Sampled]:
    """All three ways, the grid with several cells; the others take as many points as the drawn
    grid.

    Args:
        cloud: Points [m].
        on_rim: Which of them lie on the cloud's edge.
        area: Of the surface that each stands for [m^2].
        seed: Of what is drawn at random.
        cells: Edges of the grid's cubes; the others follow the one in the middle.
    """
    count = len(filters.grid_sample(cloud, cells[len(cells) // 2]))

    def geometric() -> np.ndarray:
        return filters.geometric_sample(cloud, normals.surface_variation(cloud), count, seed=seed)

    filters.uniform_sample(cloud, 2)  # compiled beforehand
    ways: list[tuple[str, int, Callable[[], np.ndarray]]] = [
        (f"grid, {1e3 * cell:g} mm", 0, lambda cell=cell: filters.grid_sample(cloud, cell))
        for cell in cells
    ]
    ways += [
        ("uniform", count, lambda: filters.uniform_sample(cloud, count)),
        ("geometric", count, geometric),
    ]
    return [_sampled(name, wanted, way, cloud, on_rim, area) for name, wanted, way in ways]


def _sampled(
    name: str,
    requested: int,
    way: Callable[[], np.ndarray],
    cloud: Float[np.ndarray, "n 3"],
    on_rim: np.ndarray,
    area: Float[np.ndarray, "n"],
) -> Sampled:
    start = time.perf_counter()
    chosen = way()
    seconds = time.perf_counter() - start
    spacing, uneven = unevenness(cloud[chosen])
    gap = float(KDTree(cloud[chosen]).query(cloud)[0].max())
    return Sampled(
        name=name,
        requested=requested,
        chosen=chosen,
        time=seconds,
        spacing_mm=1e3 * spacing,
        unevenness=uneven,
        gap_mm=1e3 * gap,
        edge_ratio=float(on_rim[chosen].mean() / (area[on_rim].sum() / area.sum())),
    )


def items(scan: Scanned, *, seed: int) -> Iterator[Item]:
    """What the down-sampling answers."""
    seen = scan.result.reconstruction
    found = np.isfinite(seen.points_L[..., 0])
    cloud = seen.points_L[found]
    on_rim = np.logical_not(binary_erosion(found, iterations=RIM_PX))[found]
    rows = compared(cloud, on_rim, _areas(cloud), seed=seed)
    yield _side_by_side(rows, scan.in_base_mm(cloud))
    yield _table(rows)


def _areas(cloud_L: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Skin that each pixel's point stands for, up to a factor: it grows with depth and slant."""
    n_L = normals.estimate_normals(cloud_L)
    along = np.abs(np.sum(n_L * cloud_L, axis=1)) / np.linalg.norm(cloud_L, axis=1)
    return cloud_L[:, 2] ** 2 / np.maximum(np.nan_to_num(along, nan=1.0), 0.1)


COLUMNS: tuple[tuple[Column, Callable[[Sampled], object]], ...] = (
    (column("sampling", "way of down-sampling", kind="text"), lambda row: row.name),
    (column("requested", "points asked for, 0 where a length is"), lambda row: row.requested),
    (column("points", "points kept"), lambda row: len(row.chosen)),
    (column("time_ms", "wall time", "ms"), lambda row: 1e3 * row.time),
    (
        column("spacing_mm", "mean distance of nearest neighbours", "mm"),
        lambda row: row.spacing_mm,
    ),
    (column("unevenness", "its deviation over its mean"), lambda row: row.unevenness),
    (
        column("gap_mm", "farthest that a point of the cloud is from the sample", "mm"),
        lambda row: row.gap_mm,
    ),
    (
        column("edge_ratio", "share of the sample on the rim over the rim's share of the area"),
        lambda row: row.edge_ratio,
    ),
)
"""Of Table 3's counterpart."""


def _named(rows: list[Sampled], name: str) -> Sampled:
    return next(row for row in rows if row.name.startswith(name))


def _drawn(rows: list[Sampled]) -> list[Sampled]:
    grid = next(row for row in rows if row.name == f"grid, {1e3 * DRAWN_CELL:g} mm")
    return [grid, _named(rows, "uniform"), _named(rows, "geometric")]


def _side_by_side(rows: list[Sampled], cloud_mm: Float[np.ndarray, "n 3"]) -> Item:
    grid, uniform, geometric = drawn = _drawn(rows)
    figure, axes = theme.panels(1, 4, height_in=3.0, sharey=True)
    drawing.scattered(axes[0, 0], cloud_mm, s=0.8)
    theme.title(axes[0, 0], f"Original, {len(cloud_mm)}")
    for axis, row in zip(axes[0, 1:], drawn, strict=True):
        drawing.scattered(axis, cloud_mm[row.chosen], s=1.0)
        theme.title(axis, f"{row.name.capitalize()}, {len(row.chosen)}")
    axes[0, 0].set_ylabel("y in B [mm]")
    numbered = [(row.name.partition(",")[0], index) for row in drawn for index in row.chosen]
    names, chosen = (np.array(values) for values in zip(*numbered, strict=True))
    return Item(
        heading="Fig. 11",
        ours=f"{len(cloud_mm)} points down to {len(uniform.chosen)}: the spacing varies by "
        f"{uniform.unevenness:.2f} of its mean with uniform sampling, {grid.unevenness:.2f} with "
        f"the grid, {geometric.unevenness:.2f} geometrically",
        verdict=judged(_is_most_even(uniform, grid, geometric), "agrees"),
        why="uniform (farthest-point) sampling is the most even of the three; the scan uses it, "
        "as the paper does.",
        figure=figure,
        shows="The denoised breast from above, and the three samples of it with as many points.",
        data={
            column("sampling", "way of down-sampling", kind="text"): names,
            **coordinates("{}_mm", "point that was kept", cloud_mm[chosen]),
        },
    )


def _table(rows: list[Sampled]) -> Item:
    grid, uniform, geometric = _drawn(rows)
    times = sorted((row.time, row.name.partition(",")[0]) for row in (grid, uniform, geometric))
    return Item(
        heading="Table 3",
        ours=f"time {1e3 * grid.time:.0f} / {1e3 * uniform.time:.0f} / {1e3 * geometric.time:.0f} "
        f"ms (grid / uniform / geometric), points on the rim {grid.edge_ratio:.2f} / "
        f"{uniform.edge_ratio:.2f} / {geometric.edge_ratio:.2f} times their share of the area, "
        f"largest gap {grid.gap_mm:.1f} / {uniform.gap_mm:.1f} / {geometric.gap_mm:.1f} mm; "
        "number exact but for the grid's",
        verdict=judged(
            _is_most_even(uniform, grid, geometric)
            and grid.time < uniform.time
            and len(uniform.chosen) == uniform.requested,
            "agrees",
        ),
        why=f"quickest is {times[0][1]}, slowest {times[-1][1]}. "
        f"{_claims(grid, uniform, geometric)}",
        data={entry: np.array([read(row) for row in rows]) for entry, read in COLUMNS},
    )


def _is_most_even(one: Sampled, *others: Sampled) -> bool:
    return one.unevenness < min(other.unevenness for other in others)


def _claims(grid: Sampled, uniform: Sampled, geometric: Sampled) -> str:
    """Which of Table 3's words the numbers bear out."""
    claims = {
        "grid is efficient": grid.time < uniform.time,
        "uniform sampling is the most even": _is_most_even(uniform, grid, geometric),
        "uniform sampling prefers edges": uniform.edge_ratio > PREFERRED,
        "uniform sampling is costly": uniform.time > grid.time,
        "geometric sampling is uneven on the whole": geometric.unevenness
        > max(grid.unevenness, uniform.unevenness),
        "geometric sampling is efficient": geometric.time < uniform.time,
    }
    held = [claim for claim, holds in claims.items() if holds]
    failed = [claim for claim, holds in claims.items() if not holds]
    text = f"Borne out: {', '.join(held)}."
    return text + (f" Not borne out: {', '.join(failed)}." if failed else "")
