"""Who bears which force, compiled: the linear complementarity problem of frictionless contact."""

import math
from typing import no_type_check

import numba
import numpy as np

MARGIN = 0.004
"""Vertices that are nearer to the face than this may come into contact by bulging [m]."""
PENETRATION = 1e-9
"""What is left of a penetration when the search for contacts ends [m]."""
PIVOTING_ROUNDS = 60
PATIENCE = 3
"""Rounds of block pivoting without progress before the slow rule takes over."""


@numba.njit(cache=True)
@no_type_check
def solve_contact(flexibility, index, gap, guess):
    """Forces [N] on the candidates such that none pulls and none penetrates: a linear complementarity problem.

    Block pivoting from the active vertices of the guess; a positive definite flexibility has one solution only, so the
    guess changes the time it takes, never the forces.
    """
    count = len(index)
    active = guess & (gap < MARGIN)
    force = np.zeros(count)
    fewest, patience = count + 1, PATIENCE
    for _ in range(PIVOTING_ROUNDS):
        touching = np.nonzero(active)[0]
        force[:] = 0.0
        if len(touching) > 0:
            force[touching] = _solve_active(flexibility, index[touching], -gap[touching])
        wrong = _wrong_vertices(flexibility, index, gap, active, touching, force)
        if len(wrong) == 0:
            break
        if len(wrong) < fewest:
            fewest, patience = len(wrong), PATIENCE
        patience -= 1
        for i in wrong if patience >= 0 else wrong[-1:]:  # one at a time is Murty's rule: slow but sure to end
            active[i] = not active[i]
    return force


@numba.njit(cache=True)
@no_type_check
def _wrong_vertices(flexibility, index, gap, active, touching, force):
    """Candidates that pull although active, or penetrate although not."""
    wrong = np.empty(len(index), np.int64)
    count = 0
    for i in range(len(index)):
        if active[i]:
            bad = force[i] < 0
        elif gap[i] > MARGIN:
            continue
        else:
            clearance = gap[i]
            for j in touching:
                clearance += flexibility[index[i], index[j]] * force[j]
            bad = clearance < -PENETRATION
        if bad:
            wrong[count] = i
            count += 1
    return wrong[:count]


@numba.njit(cache=True, fastmath={"reassoc", "contract"})
@no_type_check
def _solve_active(flexibility, index, gap):
    """Forces that close the gaps of the active vertices: `flexibility[index][:, index] force = gap`, by Cholesky."""
    count = len(index)
    lower = np.empty((count, count))
    force = gap.copy()
    for i in range(count):
        for j in range(i + 1):
            value = flexibility[index[i], index[j]]
            for k in range(j):
                value -= lower[i, k] * lower[j, k]
            lower[i, j] = math.sqrt(value) if i == j else value / lower[j, j]
        for k in range(i):
            force[i] -= lower[i, k] * force[k]
        force[i] /= lower[i, i]
    for i in range(count - 1, -1, -1):
        force[i] /= lower[i, i]
        for k in range(i):
            force[k] -= lower[i, k] * force[i]
    return force
