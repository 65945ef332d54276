"""The unit hemisphere z >= 0: its triangulation and its tangent axes."""

import numpy as np
from jaxtyping import Float, Int


def sphere_axes(direction: Float[np.ndarray, "n 3"]) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors that form a right-handed triad with each unit `direction`, smooth over
    the upper hemisphere.
    """
    x, y, z = direction.T
    a = -1 / (1 + z)
    b = x * y * a
    return np.stack([1 + x * x * a, b, -x], axis=1), np.stack([b, 1 + y * y * a, -y], axis=1)


def hemisphere(rings: int) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """A near-uniform triangulation of the unit hemisphere: the pole, then rings of 6, 12, 18,
    ... vertices.
    """
    ring = np.repeat(np.arange(rings + 1), [1] + [6 * k for k in range(1, rings + 1)])
    place = np.arange(len(ring)) - np.where(ring > 0, 1 + 3 * ring * (ring - 1), 0)
    polar = np.pi / 2 * ring / rings
    azimuth = 2 * np.pi * place / np.maximum(6 * ring, 1)
    z = np.where(ring == rings, 0.0, np.cos(polar))  # cos(pi/2) is not exactly 0 in floating point
    vertices = np.stack(
        [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), z], axis=1
    )
    return vertices, np.concatenate([_ring_triangles(k) for k in range(1, rings + 1)])


def coarser_rows(rings: int, every: int) -> Int[np.ndarray, "k"]:
    """Which vertices of `hemisphere(rings)` those of `hemisphere(rings // every)` are, in its
    order.

    Raises:
        ValueError: `rings` is not a multiple of `every`.
    """
    if rings % every:
        raise ValueError(f"{rings} rings have no every {every}th: give a divisor")
    first = [3 * every * k * (every * k - 1) + 1 for k in range(1, rings // every + 1)]
    return np.concatenate(
        [[0], *(start + every * np.arange(6 * (k + 1)) for k, start in enumerate(first))]
    ).astype(int)


def _ring_triangles(k: int) -> Int[np.ndarray, "m 3"]:
    """Triangles between ring k - 1 and ring k, in six equal sectors."""

    def vertex(ring: int, place: np.ndarray) -> np.ndarray:
        return np.zeros_like(place) if ring == 0 else 1 + 3 * ring * (ring - 1) + place % (6 * ring)

    sector = np.arange(6)[:, None]
    outer, inner = np.arange(k) + sector * k, np.arange(k) + sector * (k - 1)
    pointing_in = [vertex(k - 1, inner), vertex(k, outer), vertex(k, outer + 1)]
    pointing_out = [
        vertex(k - 1, inner[:, :-1]),
        vertex(k, outer[:, :-1] + 1),
        vertex(k - 1, inner[:, :-1] + 1),
    ]
    return np.concatenate(
        [np.stack(t, axis=-1).reshape(-1, 3) for t in (pointing_in, pointing_out)]
    )
