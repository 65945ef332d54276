"""A balanced k-d tree of points, for kernels that look for what lies near.

It is halved by number: points that lie in one place make it no deeper and no search longer. Node 1
is the root, 2 i and 2 i + 1 are the children of i, and the second half of the nodes are leaves.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from breastscan.geometry.compiled import kernel

LEAF = 16
"""Points in a leaf at most: fewer make more boxes, more make more distances."""
FARTHEST = 1e150
"""From the origin [m]: beyond it, squares of distances overflow."""
DEPTH = 64
"""Levels of a tree that no memory could hold."""


class PointTree(NamedTuple):
    """What kernels take; made by `point_tree`."""

    points: Float[np.ndarray, "n 3"]
    """In the order of the leaves [m]."""
    order: Int[np.ndarray, "n"]
    """Which of the given points each is."""
    first: Int[np.ndarray, "nodes"]
    """Where each node's points begin."""
    end: Int[np.ndarray, "nodes"]
    """Where they end."""
    low: Float[np.ndarray, "nodes 3"]
    """Least corner of the box around them [m]."""
    high: Float[np.ndarray, "nodes 3"]
    """Greatest corner [m]."""


def point_tree(points: Float[np.ndarray, "n 3"], leaf: int = LEAF) -> PointTree:
    """The tree of these points, `leaf` of them or fewer in a leaf.

    Raises:
        ValueError: There is none, or one is not finite.
    """
    require_points(points)
    leaves = 1
    while leaves * leaf < len(points):
        leaves *= 2
    tree = PointTree(
        points=np.array(points, float, order="C"),
        order=np.arange(len(points)),
        first=np.zeros(2 * leaves, np.int64),
        end=np.full(2 * leaves, len(points)),
        low=np.empty((2 * leaves, 3)),
        high=np.empty((2 * leaves, 3)),
    )
    _halve(tree)
    return tree


def require_points(points: Float[np.ndarray, "n 3"], least: int = 1) -> None:
    """Refuse a cloud that nothing can be told of.

    Raises:
        ValueError: Fewer points than `least`, or coordinates that are not finite.
    """
    if len(points) < least:
        raise ValueError(
            f"there must be {least} point{'s' * (least > 1)} or more, got {len(points)}"
        )
    if not np.abs(points).max() < FARTHEST:  # nor is NaN
        bad = np.flatnonzero(~(np.abs(points) < FARTHEST).all(axis=1))
        raise ValueError(
            f"coordinates must be finite, {len(bad)} of {len(points)} points are not, the first is "
            f"point {bad[0]}, {points[bad[0]]}: drop them"
        )


@kernel
def _halve(tree):
    """Sort the points so that every node's are halved across the longest side of their box."""
    leaves = tree.first.size // 2
    for node in range(1, 2 * leaves):
        first, end = tree.first[node], tree.end[node]
        _bound(tree, node)
        if node < leaves:
            middle = (first + end) // 2
            axis = np.argmax(tree.high[node] - tree.low[node])
            _select(tree.points, tree.order, first, end, middle, axis)
            tree.first[2 * node] = first
            tree.end[2 * node] = tree.first[2 * node + 1] = middle
            tree.end[2 * node + 1] = end


@kernel
def _bound(tree, node):
    """Measure a node's box."""
    for axis in range(3):
        low = high = tree.points[tree.first[node], axis]
        for i in range(tree.first[node] + 1, tree.end[node]):
            value = tree.points[i, axis]
            low = value if value < low else low
            high = value if value > high else high
        tree.low[node, axis], tree.high[node, axis] = low, high


@kernel
def _select(points, order, first, end, middle, axis):
    """Hoare's selection: none of the points before `middle` lies beyond one of those after it."""
    last, draw = end - 1, 1
    while first < last:
        # drawn, as the C standard's example does: smooth surfaces rise and fall, so that a pivot at
        # a fixed place may be the worst each time
        draw = (draw * 1103515245 + 12345) % 2**31
        pivot = points[first + draw % (last - first + 1), axis]
        i, j = first, last
        while i <= j:
            while points[i, axis] < pivot:
                i += 1
            while points[j, axis] > pivot:
                j -= 1
            if i <= j:
                for k in range(3):
                    points[i, k], points[j, k] = points[j, k], points[i, k]
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            last = j
        elif middle >= i:
            first = i
        else:
            break


@kernel
def apart(tree, node, p):
    """Square of the distance of p from a node's box, never above that from a point in it, however
    both are rounded.
    """
    dx = max(tree.low[node, 0] - p[0], p[0] - tree.high[node, 0], 0.0)
    dy = max(tree.low[node, 1] - p[1], p[1] - tree.high[node, 1], 0.0)
    dz = max(tree.low[node, 2] - p[2], p[2] - tree.high[node, 2], 0.0)
    return dx * dx + dy * dy + dz * dz


@kernel
def reach(tree, node, p):
    """Square of its distance from that box's farthest corner, never below that from a point in
    it.
    """
    dx = max(tree.high[node, 0] - p[0], p[0] - tree.low[node, 0])
    dy = max(tree.high[node, 1] - p[1], p[1] - tree.low[node, 1])
    dz = max(tree.high[node, 2] - p[2], p[2] - tree.low[node, 2])
    return dx * dx + dy * dy + dz * dz


@kernel
def squared_distance(tree, i, p):
    """Square of the distance of p from point i of the tree."""
    dx = tree.points[i, 0] - p[0]
    dy = tree.points[i, 1] - p[1]
    dz = tree.points[i, 2] - p[2]
    return dx * dx + dy * dy + dz * dz


@kernel
def nearest(tree, p, squared, found):
    """Fill `found` with the tree's numbers of the points nearest to p, and `squared` with the
    squares of their distances: a heap, the farthest first.
    """
    leaves = tree.first.size // 2
    nodes, gaps = np.empty(DEPTH, np.int64), np.empty(DEPTH)
    nodes[0], gaps[0] = 1, 0.0
    waiting = 1
    squared[:] = np.inf
    while waiting > 0:
        waiting -= 1
        node = nodes[waiting]
        if gaps[waiting] >= squared[0]:
            continue
        if node < leaves:
            left = apart(tree, 2 * node, p)
            right = apart(tree, 2 * node + 1, p)
            nearer = 2 * node + (right < left)
            nodes[waiting], gaps[waiting] = 4 * node + 1 - nearer, max(left, right)
            nodes[waiting + 1], gaps[waiting + 1] = nearer, min(left, right)
            waiting += 2
            continue
        for i in range(tree.first[node], tree.end[node]):
            distance = squared_distance(tree, i, p)
            if distance < squared[0]:
                _replace_farthest(squared, found, distance, i)


@kernel
def _replace_farthest(squared, found, distance, i):
    """Take point i into the heap for its farthest."""
    parent, child = 0, 1
    while child < squared.size:
        if child + 1 < squared.size and squared[child + 1] > squared[child]:
            child += 1
        if squared[child] <= distance:
            break
        squared[parent], found[parent] = squared[child], found[child]
        parent, child = child, 2 * child + 1
    squared[parent], found[parent] = distance, i
