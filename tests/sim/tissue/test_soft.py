"""The tissue against closed forms, against full finite elements, and against the laws of
mechanics.
"""

import warnings
from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from breastscan.errors import ConfigError
from sim.tissue import compliance_cache
from sim.tissue import soft as soft_module
from sim.tissue.complementarity import MARGIN, Solved, solve_contact
from sim.tissue.compliance import SkinCompliance, compute_compliance
from sim.tissue.contact_kernel import GRAZING, find_gaps, find_near
from sim.tissue.contact_surface import contact_surface
from sim.tissue.half_space import add_discs, softness
from sim.tissue.layers import LayerConfig
from sim.tissue.phantom import Phantom, PhantomConfig
from sim.tissue.soft import SoftTissue
from sim.wrist.probe_face import ProbeFace, distance
from tests.sim.tissue.finite_element_contact import finite_element_force
from tests.sim.tissue.press_poses import REST, loop_pose

COARSE = 300
"""Finite-element vertices on the skin: half a second to solve, within 4 % of the converged
force."""


@pytest.fixture(scope="module")
def phantom() -> Phantom:
    return Phantom(PhantomConfig())


@pytest.fixture(scope="module")
def compliance(phantom) -> SkinCompliance:
    return compute_compliance(phantom, COARSE)


@pytest.fixture(scope="module")
def tissue(phantom, compliance) -> SoftTissue:
    return SoftTissue(phantom, compliance)


def axial_force(tissue: SoftTissue, phantom: Phantom, azimuth: float, depth: float) -> float:
    """Force that presses back on the probe along its axis [N]."""
    X_SP = loop_pose(phantom, azimuth, depth)
    return -float(tissue.press(X_SP, REST).force_S @ X_SP[:3, 2])


def test_a_sphere_on_a_half_space_presses_back_as_hertz_says():
    """F = 4/3 E* sqrt(R) d^1.5, on a triangular lattice of contact points."""
    spacing = 1e-3
    radius = 0.06
    depth = 1.5e-3
    compliance = softness(0.45) / 30e3
    rows, columns = np.mgrid[-14:15, -14:15].reshape(2, -1)
    points = spacing * np.stack(
        [columns + 0.5 * (rows % 2), rows * np.sqrt(0.75), 0 * rows], axis=1
    )
    areas = np.full(len(points), np.sqrt(0.75) * spacing**2)
    gap = (points**2).sum(axis=1) / (2 * radius) - depth
    flexibility, everyone = np.zeros((len(points), len(points))), np.arange(len(points))
    add_discs(flexibility, points, areas, compliance)
    force = solve_contact(flexibility, everyone, gap, Solved.nothing(len(points), len(points)))
    hertz = 4 / 3 / (np.pi * compliance) * np.sqrt(radius) * depth**1.5
    assert force.sum() == pytest.approx(hertz, rel=0.01)
    assert np.sum(force > 0) * areas[0] == pytest.approx(np.pi * radius * depth, rel=0.05)


def test_flexibility_is_reciprocal_and_stores_energy(phantom, compliance):
    """Maxwell's reciprocity (the elements' spread loads keep it to their order), and positive
    definiteness.
    """
    inward = -np.einsum("jic,ic->ij", compliance.response_S, compliance.normals_S)
    assert np.linalg.norm(inward - inward.T) < 0.15 * np.linalg.norm(inward)
    flexibility = contact_surface(phantom, compliance).flexibility
    np.testing.assert_array_equal(flexibility, flexibility.T)
    np.linalg.cholesky(flexibility)  # refuses what is not positive definite


def test_press_agrees_with_contact_solved_in_full_finite_elements(phantom):
    """A broad face, which wide finite elements can resolve; the tractions there follow the face,
    here the skin.
    """
    face = ProbeFace(elevation=0.04, edge_radius=0.015)
    X_SP = loop_pose(phantom, 0.7, 0.004)
    reference_S = finite_element_force(phantom, COARSE, face, X_SP)
    force_S = SoftTissue(phantom, compute_compliance(phantom, 500), face).press(X_SP, REST).force_S
    assert np.linalg.norm(force_S - reference_S) < 0.05 * np.linalg.norm(reference_S)


def test_a_coarser_finite_element_mesh_gives_nearly_the_same_force(phantom, tissue):
    coarser = SoftTissue(phantom, compute_compliance(phantom, COARSE // 2))
    for azimuth in (0.0, 2.0, 4.0):
        force = axial_force(tissue, phantom, azimuth, 0.005)
        assert axial_force(coarser, phantom, azimuth, 0.005) == pytest.approx(force, rel=0.05)


def test_force_scales_with_youngs_modulus_exactly(phantom, compliance, tissue):
    soft = Phantom(replace(phantom.config, young=phantom.config.young / 3))
    X_SP = loop_pose(phantom, 1.0, 0.005)
    contact, softer = tissue.press(X_SP, REST), SoftTissue(soft, compliance).press(X_SP, REST)
    np.testing.assert_allclose(softer.force_S, contact.force_S / 3, rtol=1e-12)
    np.testing.assert_allclose(softer.torque_S, contact.torque_S / 3, rtol=1e-9, atol=1e-12)
    assert softer.depth == contact.depth


def test_a_probe_off_the_skin_feels_nothing_even_when_it_moves(phantom, tissue):
    for height in (0.0001, 0.005, 0.3):
        contact = tissue.press(loop_pose(phantom, 1.0, -height), np.array([0.1, 0.0, -0.1]))
        assert contact.vertices == 0
        assert not contact.force_S.any()
        assert not contact.torque_S.any()
    np.testing.assert_array_equal(tissue.deformed_skin(), phantom.skin.vertices_S)


def test_five_newtons_indent_the_default_phantom_by_about_six_millimetres(phantom, tissue):
    for azimuth in np.linspace(0, 2 * np.pi, 8, endpoint=False):
        assert (
            axial_force(tissue, phantom, azimuth, 0.0045)
            < 5
            < axial_force(tissue, phantom, azimuth, 0.0075)
        )


def test_force_grows_with_depth_as_between_a_punch_and_hertz(phantom, tissue):
    """A line of contact gives about the first power of the depth, a point Hertz's 1.5."""
    depths = np.array([0.001, 0.002, 0.003, 0.004, 0.006, 0.008])
    force = np.array([axial_force(tissue, phantom, 0.7, depth) for depth in depths])
    powers = np.diff(np.log(force)) / np.diff(np.log(depths))
    assert np.all((powers > 1.1) & (powers < 1.6))


def test_a_square_press_pushes_back_along_the_axis_through_the_tip(phantom, tissue):
    X_SP = loop_pose(phantom, 0.7, 0.005)
    contact = tissue.press(X_SP, REST)
    force_P, torque_P = contact.force_S @ X_SP[:3, :3], contact.torque_S @ X_SP[:3, :3]
    assert np.linalg.norm(force_P[:2]) < 0.05 * abs(force_P[2])
    assert np.linalg.norm(torque_P) < 1e-3 * abs(force_P[2])
    assert np.linalg.norm(contact.centre_S - X_SP[:3, 3]) < 2e-3
    assert contact.depth == pytest.approx(0.005, abs=1e-4)


def test_a_closed_way_without_friction_costs_no_work(phantom, tissue):
    """A square of 4 mm by 4 mm, across and into the tissue, 3 to 7 mm deep."""
    X_SP = loop_pose(phantom, 0.7, 0.005)
    corners = 0.002 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    offsets = np.concatenate([np.linspace(a, b, 40, endpoint=False) for a, b in pairwise(corners)])
    places_S = X_SP[:3, 3] + offsets @ X_SP[:3, 1:3].T
    forces_S = np.array([tissue.press(_moved(X_SP, p_S), REST).force_S for p_S in places_S])
    steps_S = np.roll(places_S, -1, axis=0) - places_S
    work = np.einsum("nc,nc->n", (forces_S + np.roll(forces_S, -1, axis=0)) / 2, steps_S)
    assert abs(work.sum()) < 0.02 * np.abs(work).sum()


def test_force_is_continuous_over_micrometres(phantom, tissue):
    X_SP = loop_pose(phantom, 2.0, 0.0055)
    for axis in range(3):
        path_S = np.arange(200)[:, None] * 2e-6 * X_SP[:3, axis]
        force = np.array(
            [tissue.press(_moved(X_SP, X_SP[:3, 3] + step), REST).force_S for step in path_S]
        )
        assert np.linalg.norm(np.diff(force, axis=0), axis=1).max() < 0.01


@pytest.mark.parametrize("roll_deg", [0, 45, 75, 90])
def test_force_hardly_ripples_as_the_probe_slides_along_the_loop(phantom, tissue, roll_deg):
    """At constant depth the force follows the shape slowly; what is faster than 40 mm is the
    mesh.
    """
    rolled = np.eye(4)
    rolled[:3, :3] = Rotation.from_euler("z", roll_deg, degrees=True).as_matrix()
    azimuths = np.linspace(0, 2 * np.pi, 800, endpoint=False)
    poses = [loop_pose(phantom, azimuth, 0.0055) @ rolled for azimuth in azimuths]
    force = np.array([-tissue.press(X_SP, REST).force_S @ X_SP[:3, 2] for X_SP in poses])
    spectrum = np.fft.rfft(force)
    spectrum[:10] = 0
    assert np.fft.irfft(spectrum).std() < 0.03


def test_force_does_not_depend_on_the_presses_before(phantom, tissue):
    X_SP = loop_pose(phantom, 3.0, 0.004)
    tissue.reset()
    fresh = tissue.press(X_SP, REST).force_S
    for azimuth, depth in ((3.01, 0.006), (2.97, 0.003), (0.5, 0.008)):
        tissue.press(loop_pose(phantom, azimuth, depth), REST)
        np.testing.assert_allclose(tissue.press(X_SP, REST).force_S, fresh, atol=1e-9)


def test_gel_drags_against_sliding_by_its_friction_coefficient(phantom, tissue):
    X_SP = loop_pose(phantom, 0.7, 0.005)
    still = tissue.press(X_SP, REST).force_S
    across_S = np.cross(still, X_SP[:3, 0])
    across_S /= np.linalg.norm(across_S)
    dragged = tissue.press(X_SP, 0.025 * across_S).force_S - still
    assert dragged @ across_S == pytest.approx(
        -phantom.config.gel_friction * np.linalg.norm(still), rel=0.02
    )
    slow = tissue.press(X_SP, 1e-6 * across_S).force_S - still
    assert np.linalg.norm(slow) < 1e-3


def test_tissue_resists_indentation_and_never_pulls(phantom, tissue):
    X_SP = loop_pose(phantom, 0.7, 0.005)
    force = [
        -tissue.press(X_SP, v * X_SP[:3, 2]).force_S @ X_SP[:3, 2] for v in (-1.0, -0.02, 0.0, 0.02)
    ]
    assert np.all(np.diff(force) > 0)
    assert force[0] >= -0.1
    assert force[3] == pytest.approx(1.06 * force[2], rel=0.01)


def test_presses_beyond_what_was_validated_are_warned_of_once(phantom, compliance):
    tissue = SoftTissue(phantom, compliance)
    tissue.press(loop_pose(phantom, 0.7, 0.0078), REST)
    with pytest.warns(UserWarning, match=r"indented by 9\.\d mm"):
        tissue.press(loop_pose(phantom, 0.7, 0.0095), REST)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tissue.press(loop_pose(phantom, 0.7, 0.0095), REST)


def test_the_patch_carries_the_force_and_lies_on_the_face(phantom, tissue):
    X_SP = loop_pose(phantom, 0.7, 0.006)
    contact, patch = tissue.press(X_SP, REST), tissue.patch()
    assert patch.pressure @ patch.areas == pytest.approx(np.linalg.norm(contact.force_S), rel=0.03)
    off_the_face = [
        distance(ProbeFace().parameters(), *p)[0]
        for p in (patch.points_S - X_SP[:3, 3]) @ X_SP[:3, :3]
    ]
    assert np.abs(off_the_face).max() < 5e-4
    assert len(patch.areas) == contact.vertices


def test_gap_is_the_distance_along_the_skins_normal_to_the_face(phantom, compliance):
    """An oblique probe: walking along each normal, in steps of .05 mm, the face is met where the
    gap says.
    """
    surface = contact_surface(phantom, compliance)
    X_SP = loop_pose(phantom, 0.7, 0.005)
    tilt = np.radians(20)
    X_SP[:3, :3] = X_SP[:3, :3] @ [
        [1, 0, 0],
        [0, np.cos(tilt), -np.sin(tilt)],
        [0, np.sin(tilt), np.cos(tilt)],
    ]
    index = find_near(ProbeFace().parameters(), X_SP, surface.vertices_S, surface.balls_S)
    gap = find_gaps(
        ProbeFace().parameters(), X_SP, surface.vertices_S[index], surface.normals_S[index]
    )
    assert np.sum(gap < 0) > 30
    inward = np.arange(0.016, -MARGIN, -5e-5)
    for i, expected in zip(index[gap < 0], -gap[gap < 0], strict=True):
        path_P = (
            surface.vertices_S[i] - inward[:, None] * surface.normals_S[i] - X_SP[:3, 3]
        ) @ X_SP[:3, :3]
        met = next(
            k for k, p in enumerate(path_P) if distance(ProbeFace().parameters(), *p)[0] <= 0
        )
        steepness = -np.dot(
            distance(ProbeFace().parameters(), *path_P[met])[1:],
            surface.normals_S[i] @ X_SP[:3, :3],
        )
        if steepness > GRAZING:
            assert inward[met] == pytest.approx(expected, abs=6e-5)
        else:
            assert expected < inward[met] + 6e-5


def test_no_vertex_is_lost_with_a_ball_that_is_left_out(phantom, compliance):
    surface, face = contact_surface(phantom, compliance), ProbeFace().parameters()
    everywhere = np.tile([0.0, 0.0, 0.0, 1.0], (len(surface.balls_S), 1))
    for azimuth in np.linspace(0, 2 * np.pi, 40):
        X_SP = loop_pose(phantom, azimuth, 0.004)
        all_tried = find_near(face, X_SP, surface.vertices_S, everywhere)
        assert len(all_tried) > 100
        np.testing.assert_array_equal(
            find_near(face, X_SP, surface.vertices_S, surface.balls_S), all_tried
        )


def test_the_deformed_skin_wraps_the_probes_face(phantom, tissue):
    """Under the centre of the face, within the .2 mm that the skin moves sideways on a curved
    face.
    """
    X_SP = loop_pose(phantom, 0.7, 0.006)
    tissue.press(X_SP, REST)
    skin_P = (tissue.deformed_skin() - X_SP[:3, 3]) @ X_SP[:3, :3]
    under_the_face = (np.abs(skin_P) < [0.012, 0.003, 0.004]).all(axis=1)
    off_the_face = [distance(ProbeFace().parameters(), *p)[0] for p in skin_P[under_the_face]]
    assert under_the_face.sum() > 50
    assert np.abs(off_the_face).max() < 2.5e-4


def test_the_skin_far_from_the_probe_hardly_moves_and_its_border_not_at_all(phantom, tissue):
    tissue.press(loop_pose(phantom, 0.7, 0.006), REST)
    skin_S = phantom.skin.vertices_S
    moved = np.linalg.norm(tissue.deformed_skin() - skin_S, axis=1)
    assert moved.max() == pytest.approx(6e-3, abs=5e-4)
    assert moved[skin_S @ [np.cos(0.7), np.sin(0.7), 0] < -0.03].max() < 5e-4
    assert not moved[skin_S[:, 2] == 0].any()
    tissue.reset()
    np.testing.assert_array_equal(tissue.deformed_skin(), skin_S)


def test_compliance_is_computed_once_and_a_damaged_file_is_rebuilt(monkeypatch, tmp_path):
    monkeypatch.setattr(compliance_cache.platformdirs, "user_cache_path", lambda _name: tmp_path)
    monkeypatch.setattr(soft_module, "SKIN_POINTS", 60)
    phantom, told = Phantom(PhantomConfig(seed=5)), []
    first = SoftTissue.build(phantom, lambda fraction, _what: told.append(fraction))
    assert told[-1] == 1.0
    assert told == sorted(told)
    X_SP = loop_pose(phantom, 0.0, 0.004)
    again = SoftTissue.build(phantom, lambda *_: pytest.fail("computed again"))
    np.testing.assert_array_equal(again.press(X_SP, REST).force_S, first.press(X_SP, REST).force_S)
    (file,) = tmp_path.iterdir()
    file.write_bytes(file.read_bytes()[:1000])
    told.clear()
    SoftTissue.build(phantom, lambda fraction, _what: told.append(fraction))
    assert told[-1] == 1.0
    assert len(list(tmp_path.iterdir())) == 1


def test_computed_compliance_lies_in_memory_as_kept_one_does(monkeypatch, tmp_path):
    """Sums over another order differ in the last bit, and the scan's metrics with them."""
    monkeypatch.setattr(compliance_cache.platformdirs, "user_cache_path", lambda _name: tmp_path)
    phantom = Phantom(PhantomConfig(seed=5))
    computed, kept = (compliance_cache.cached_compliance(phantom, 60) for _ in range(2))
    for field in fields(computed):
        values, again = getattr(computed, field.name), getattr(kept, field.name)
        np.testing.assert_array_equal(values, again)
        assert values.strides == again.strides, field.name


HOMOGENEOUS = LayerConfig()
MASS = LayerConfig(mass_radius=0.009, mass_p_S=(0.0, 0.0, 0.04))
GLAND = LayerConfig(gland_fraction=0.6)


@pytest.mark.parametrize(
    ("layers", "others"),
    [
        (HOMOGENEOUS, MASS),
        (MASS, replace(MASS, mass_ratio=8.0)),
        (MASS, replace(MASS, mass_p_S=(0.001, 0.0, 0.04))),
        (GLAND, replace(GLAND, gland_fraction=0.62)),
    ],
)
def test_no_other_layers_compliance_is_taken_for_ones_own(monkeypatch, tmp_path, layers, others):
    """However coarse the elements: what differs lies between their corners."""
    monkeypatch.setattr(compliance_cache.platformdirs, "user_cache_path", lambda _name: tmp_path)
    for one in (layers, others):
        compliance_cache.cached_compliance(Phantom(PhantomConfig(layers=one)), 60)
    assert len(list(tmp_path.iterdir())) == 2


def test_a_mass_that_falls_between_the_elements_is_refused():
    tiny = LayerConfig(mass_radius=0.001, mass_p_S=(0.0, 0.0, 0.02))
    with pytest.raises(ConfigError, match="falls between the finite elements"):
        compute_compliance(Phantom(PhantomConfig(layers=tiny)), 60)


def _moved(X_SP: Float[np.ndarray, "4 4"], p_S: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    moved = X_SP.copy()
    moved[:3, 3] = p_S
    return moved
