"""Who bears which force, compiled: the linear complementarity problem of frictionless contact."""

import math
from typing import NamedTuple, no_type_check

import numba
import numpy as np
from jaxtyping import Bool, Float, Int

MARGIN = 0.004
"""Vertices that are nearer to the face than this may come into contact by bulging [m]."""
PENETRATION = 1e-9
"""What is left of a penetration when the search for contacts ends [m]."""
PIVOTING_ROUNDS = 60
PATIENCE = 3
"""Rounds of block pivoting without progress before the slow rule takes over."""


class Solved(NamedTuple):
    """What is kept of the last solution, to be quicker with the next; every solution overwrites
    it.
    """

    touching: Bool[np.ndarray, "n"]
    """Of all vertices, those that touch: the next guess."""
    order: Int[np.ndarray, "m"]
    """Vertices in the order in which they were factorised, -1 behind the last."""
    lower: Float[np.ndarray, "m m"]
    """Cholesky factor of their flexibility."""
    place: Int[np.ndarray, "n"]
    """Where among the candidates a vertex stands, if it is one: what an earlier search left for
    another vertex means nothing."""

    @staticmethod
    def nothing(vertices: int, capacity: int) -> "Solved":
        """Before the first solution; of the vertices at `capacity` so many touch."""
        return Solved(
            np.zeros(vertices, bool),
            np.full(capacity, -1),
            np.empty((capacity, capacity)),
            np.zeros(vertices, np.int64),
        )


@numba.njit(cache=True)
@no_type_check
def solve_contact(flexibility, index, gap, solved):
    """Forces [N] on the candidates such that none pulls and none penetrates: a linear
    complementarity problem.

    Block pivoting from the vertices that touched last time; a positive definite flexibility has one
    solution only, so the guess changes the time it takes, never the forces.

    Args:
        flexibility: Of all vertices, symmetric [m/N].
        index: The candidates among them, ascending.
        gap: Of the candidates [m].
        solved: The last solution with this flexibility.
    """
    count = len(index)
    solved.place[index] = np.arange(count)
    active = solved.touching[index] & (gap < MARGIN)
    force = np.zeros(count)
    fewest, patience = count + 1, PATIENCE
    for _ in range(PIVOTING_ROUNDS):
        force[:] = 0.0
        touching = _factorise(flexibility, index, gap, active, solved)
        if len(touching) > 0:
            force[touching] = _solve(solved.lower, -gap[touching])
        wrong = _wrong_vertices(flexibility, index, gap, active, touching, force)
        if len(wrong) == 0:
            break
        if len(wrong) < fewest:
            fewest, patience = len(wrong), PATIENCE
        patience -= 1
        # one at a time is Murty's rule: slow but sure to end
        for i in wrong if patience >= 0 else wrong[-1:]:
            active[i] = not active[i]
    solved.touching[:] = False
    solved.touching[index] = force > 0
    return force


@numba.njit(cache=True)
@no_type_check
def _wrong_vertices(flexibility, index, gap, active, touching, force):
    """Candidates that pull although active, or penetrate although not."""
    waiting = np.nonzero(~active & (gap <= MARGIN))[0]
    column, clearance = index[waiting], gap[waiting]
    # force by force and not vertex by vertex: so the sums do not wait for themselves
    for j in touching:
        row, pressing = flexibility[index[j]], force[j]
        for k in range(len(waiting)):
            clearance[k] += row[column[k]] * pressing
    bad = active & (force < 0)
    for k in range(len(waiting)):
        bad[waiting[k]] = clearance[k] < -PENETRATION
    return np.nonzero(bad)[0]


@numba.njit(cache=True, fastmath={"reassoc", "contract"})
@no_type_check
def _factorise(flexibility, index, gap, active, solved):
    """Cholesky factor of the active candidates' flexibility; the candidates in the order of its
    rows.

    The rows before the first vertex that no longer touches stay. The others follow, the deepest
    first: those that will leave next come last, so that a sliding probe renews a few rows a period
    and not all of them.
    """
    order, lower = solved.order, solved.lower
    touching, first = np.empty(np.sum(active), np.int64), 0
    if len(touching) > len(order):
        raise ValueError("more vertices touch than there is room for")
    waiting = active.copy()
    while first < len(order) and order[first] >= 0:
        at = solved.place[order[first]]
        if at >= len(index) or index[at] != order[first] or not active[at]:
            break
        touching[first], waiting[at] = at, False
        first += 1
    others = np.nonzero(waiting)[0]
    touching[first:] = others[np.argsort(gap[others])]
    count = len(touching)
    order[first:count] = index[touching[first:]]
    order[count:] = -1
    for i in range(first, count):
        for j in range(i + 1):
            value = flexibility[order[i], order[j]]
            for k in range(j):
                value -= lower[i, k] * lower[j, k]
            lower[i, j] = math.sqrt(value) if i == j else value / lower[j, j]
    return touching


@numba.njit(cache=True, fastmath={"reassoc", "contract"})
@no_type_check
def _solve(lower, right):
    """Solve with a Cholesky factor."""
    count, force = len(right), right.copy()
    for i in range(count):
        for k in range(i):
            force[i] -= lower[i, k] * force[k]
        force[i] /= lower[i, i]
    for i in range(count - 1, -1, -1):
        force[i] /= lower[i, i]
        known = force[i]  # a number of its own, or the loop cannot take several k at a time
        for k in range(i):
            force[k] -= lower[i, k] * known
    return force
