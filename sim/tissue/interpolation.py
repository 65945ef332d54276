"""From the finite elements' vertices to finer points of the skin: smooth local interpolation on
the unit hemisphere.
"""

import numpy as np
import scipy.sparse
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from sim.tissue.hemisphere import sphere_axes

NEIGHBOURS = 12
"""Vertices that each point takes its value from."""


def interpolation_weights(
    sources: Float[np.ndarray, "n 3"], targets: Float[np.ndarray, "m 3"]
) -> tuple[Int[np.ndarray, "m k"], Float[np.ndarray, "m k"]]:
    """The sources nearest to each target, and the weights of their values there; all on the unit
    hemisphere.

    Cubic radial basis functions with a linear polynomial over the nearest sources, in the target's
    tangent plane: exact at the sources, and exact for linear fields.
    """
    near = np.asarray(KDTree(sources).query(targets, NEIGHBOURS)[1])
    offset = sources[near] - targets[:, None]
    plane = np.stack(
        [np.einsum("nkc,nc->nk", offset, axis) for axis in sphere_axes(targets)], axis=2
    )
    linear = np.concatenate([np.ones((*near.shape, 1)), plane], axis=2)
    size = NEIGHBOURS + 3
    system = np.zeros((len(targets), size, size))
    system[:, :NEIGHBOURS, :NEIGHBOURS] = (
        np.linalg.norm(plane[:, :, None] - plane[:, None], axis=-1) ** 3
    )
    system[:, :NEIGHBOURS, NEIGHBOURS:] = linear
    system[:, NEIGHBOURS:, :NEIGHBOURS] = linear.transpose(0, 2, 1)
    at_target = np.zeros((len(targets), size, 1))
    at_target[:, :NEIGHBOURS, 0] = np.linalg.norm(plane, axis=-1) ** 3
    at_target[:, NEIGHBOURS] = 1.0
    return near, np.linalg.solve(system, at_target)[:, :NEIGHBOURS, 0]


def interpolation_matrix(
    near: Int[np.ndarray, "m k"], weights: Float[np.ndarray, "m k"], sources: int
) -> scipy.sparse.csr_array:
    """The same as a matrix that takes the values at all `sources` to the targets."""
    rows = np.repeat(np.arange(len(near)), near.shape[1])
    return scipy.sparse.csr_array(
        (weights.ravel(), (rows, near.ravel())), shape=(len(near), sources)
    )
