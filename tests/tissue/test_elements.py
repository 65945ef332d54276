"""The finite elements and their factors, against solutions that are known."""

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg

from breastscan.tissue.elements import (
    ClampedBody,
    node_unknowns,
    quadratic_elements,
    skin_facets,
    stiffness,
)
from breastscan.tissue.mesh import mesh_breast, skin_triangles
from breastscan.tissue.sparse_cholesky import SparseCholesky
from tests.tissue.shapes import HEIGHT, RADIUS, dome

MESH = mesh_breast(dome, 60)
BASIS = quadratic_elements(MESH)


def test_the_mesh_fills_the_shape():
    a, b, c, d = MESH.nodes[MESH.tetrahedra].transpose(1, 0, 2)
    volumes = (np.cross(b - a, c - a) * (d - a)).sum(axis=1) / 6
    assert volumes.min() > 0
    whole = 2 / 3 * np.pi * RADIUS**2 * HEIGHT
    assert volumes.sum() == pytest.approx(whole, rel=0.1)
    assert volumes.sum() < whole


def test_skin_facets_are_those_of_the_skin():
    assert len(skin_facets(BASIS, MESH)) == len(skin_triangles(MESH))


def test_forces_of_a_known_displacement_bring_it_about():
    """A shear that is clamped at the base, quadratic in height: the elements hold it exactly."""
    nodes = BASIS.doflocs[:, node_unknowns(BASIS)[:, 0]].T
    shear = np.outer(nodes[:, 2] + 5 * nodes[:, 2] ** 2, [0.3, -0.2, 0.1])
    by_unknown = np.empty(BASIS.N)
    by_unknown[node_unknowns(BASIS)] = shear
    K = stiffness(BASIS, 0.45)
    found = ClampedBody(BASIS, MESH, K).displace((K @ by_unknown)[:, None])[:, :, 0]
    np.testing.assert_allclose(found, shear, atol=1e-9 * np.abs(shear).max())


def test_a_stiffer_body_yields_by_as_much_less():
    force = np.random.default_rng(0).standard_normal((BASIS.N, 1))
    once, twice = (
        ClampedBody(BASIS, MESH, stiffness(BASIS, 0.3, ratio)).displace(force)
        for ratio in (1.0, 2.0)
    )
    np.testing.assert_allclose(once, 2 * twice, rtol=1e-9, atol=1e-12 * np.abs(once).max())


def test_factors_solve_as_scipys_do():
    rng = np.random.default_rng(3)
    points = rng.uniform(size=(150, 3))
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    graph = scipy.sparse.csr_array(np.where(apart < 0.25, rng.uniform(0.5, 1.0), 0.0))
    half = scipy.sparse.kron(graph, rng.standard_normal((3, 3)), format="csr")
    A = scipy.sparse.csr_array(half @ half.T + scipy.sparse.eye_array(450))
    right = rng.standard_normal((450, 4))
    expected = scipy.sparse.linalg.splu(A.tocsc()).solve(right)
    np.testing.assert_allclose(SparseCholesky(A, points).solve(right), expected, atol=1e-8)
