from dataclasses import replace

import numpy as np
import pytest

from breastscan.errors import ConfigError, PlanningError
from breastscan.geometry.plane import Plane
from breastscan.geometry.skin import REACH
from breastscan.planning import coverage, pattern
from breastscan.planning.coverage import Band, CoverageConfig, Patch, Track
from tests.skins import ellipsoid

RADIUS = 0.070
CENTRE_B = np.array([0.5, 0.05, 0.08])
PLATE = Plane(normal=np.array([0.0, 0.0, 1.0]), offset=0.08)
PATCH = Patch(length=0.033, width=0.012)
CONFIG = CoverageConfig()
BALL = ellipsoid(np.full(3, RADIUS), CENTRE_B)
"""Half a ball on the plate."""


def everywhere(X_BP):
    return np.ones(len(X_BP), bool)


def above(height):
    return lambda X_BP: X_BP[:, 2, 3] - CENTRE_B[2] > height


def band(clear=everywhere, config=CONFIG):
    return Band.reached(BALL, PLATE, config, PATCH.width, clear)


def strokes(kind, spacing=0.0108):
    lain = band()
    return [lain.path(track) for track in coverage.tracks(kind, lain, spacing)]


def polar(points_B):
    from_centre = points_B - CENTRE_B
    return np.arccos(from_centre[..., 2] / np.linalg.norm(from_centre, axis=-1))


def azimuth(points_B):
    from_centre = points_B - CENTRE_B
    return np.unwrap(np.arctan2(from_centre[..., 1], from_centre[..., 0]))


def test_a_band_keeps_half_a_swath_from_both_margins():
    """Lengths along a meridian of a ball are angles times its radius."""
    lain = band()
    chord = 2 * np.arcsin(CONFIG.nipple_margin / 2 / RADIUS)
    assert abs(lain.first - (RADIUS * chord + PATCH.width / 2)) * 1e3 < 0.5
    low = np.arccos(CONFIG.base_margin / RADIUS)
    assert np.abs(lain.last - (RADIUS * low - PATCH.width / 2)).max() * 1e3 < 0.6


def test_a_band_ends_where_the_probe_would_come_too_near_to_the_body():
    heights = RADIUS * np.cos(band(clear=above(0.03)).last / RADIUS)
    assert heights.min() * 1e3 > 30.0
    assert heights.max() * 1e3 < 31.0


def test_places_are_told_by_length_and_azimuth_as_they_were_laid():
    lain = band()
    around = np.linspace(-3.0, 3.0, 12)
    path = lain.path(Track(np.full(12, 0.4), around))
    s, found = lain.located(path.points_B)
    expected = lain.first + 0.4 * (lain.lowest(around) - lain.first)
    np.testing.assert_allclose(s, expected, atol=2e-5)
    np.testing.assert_allclose(found, around, atol=1e-6)


def test_loops_are_nested_no_farther_apart_than_asked_for_and_alternate():
    paths = strokes("loops")
    angles = np.array([polar(path.points_B).mean() for path in paths])
    steps = -np.diff(angles) * RADIUS  # from the chest up
    assert (steps > 0).all()
    assert steps.max() * 1e3 < 10.8 + 0.1
    turns = [np.sign(azimuth(path.points_B)[-1] - azimuth(path.points_B)[0]) for path in paths]
    assert turns == [(-1) ** k for k in range(len(paths))]
    assert all(path.closed and path.array_along for path in paths)


def test_the_turns_of_a_spiral_begin_where_the_one_before_ends_between_two_whole_ones():
    tracks = coverage.tracks("spiral", band(), 0.0108)
    assert all(track.array_along and not track.closed for track in tracks)
    outward = [track if k % 2 == 0 else track.reversed for k, track in enumerate(tracks)]
    fractions = np.concatenate([track.fraction for track in outward])
    assert (np.diff(fractions) <= 0.0).all()
    for track in outward:
        assert track.azimuth[-1] - track.azimuth[0] == pytest.approx(2 * np.pi)
    for margin, track in ((1.0, tracks[0]), (0.0, tracks[-1])):
        assert (track.fraction == margin).all()
    ends = np.array([(track.fraction[0], track.fraction[-1]) for track in outward])
    np.testing.assert_allclose(ends[1:, 0], ends[:-1, 1], atol=1e-12)
    assert np.abs(ends[:, 0] - ends[:, 1]).max() * band().depth * 1e3 < 10.8


def test_radial_strokes_are_antiradial_ones_with_the_array_along():
    radial, antiradial = (coverage.tracks(kind, band(), 0.025) for kind in ("radial", "antiradial"))
    for one, other in zip(radial, antiradial, strict=True):
        assert one.array_along
        np.testing.assert_array_equal(one.azimuth, other.azimuth)


@pytest.mark.parametrize(
    ("kind", "along", "across"),
    [("loops", 0.012, 0.012), ("radial", 0.033, 0.012), ("antiradial", 0.012, 0.033)],
)
def test_what_a_stroke_touches_along_the_meridian_and_beside_itself(kind, along, across):
    assert coverage.depth(kind, PATCH) == along
    assert coverage.swath(kind, PATCH) == across


def test_to_touch_everything_twice_loops_at_the_margins_are_followed_back():
    once, twice = (coverage.tracks("loops", band(), 0.0108, twice=twice) for twice in (False, True))
    assert [track.back for track in twice] == [True, *[False] * (len(twice) - 2), True]
    assert not any(track.back for track in once)
    angles = np.array([polar(band().path(track).points_B).mean() for track in twice])
    assert np.abs(np.diff(angles)).max() * RADIUS * 1e3 < 0.8 * 10.8 + 0.1


def test_to_touch_everything_twice_meridians_lie_half_as_far_apart():
    once, twice = (
        coverage.tracks("antiradial", band(), 0.025, twice=twice) for twice in (False, True)
    )
    assert 2 * len(once) - 1 <= len(twice) <= 2 * len(once)


def test_a_way_back_is_the_same_way():
    lain = band()
    track = coverage.tracks("loops", lain, 0.02, twice=True)[0]
    assert not track.reversed.back
    points_B = [lain.path(one).points_B for one in (track, track.reversed)]
    np.testing.assert_allclose(points_B[0], points_B[1][::-1], atol=1e-12)


def test_antiradial_strokes_lie_on_meridians_a_spacing_apart_at_the_chest():
    paths = strokes("antiradial", spacing=0.025)
    lowest = max(polar(path.points_B).max() for path in paths)
    assert 2 * np.pi * RADIUS * np.sin(lowest) / len(paths) * 1e3 < 25.1
    for path in paths:
        assert np.degrees(np.ptp(azimuth(path.points_B))) < 0.1
        assert not path.array_along
    outwards = [np.sign(np.diff(polar(path.points_B)).mean()) for path in paths]
    assert outwards[:2] == [1, -1]


def test_a_raster_goes_to_and_fro_and_leaves_the_nipple_out():
    lain = band()
    ways = []
    for track in coverage.tracks("raster", lain, 0.025):
        s, around = lain.located(lain.path(track).points_B)
        assert (s > lain.first - 1e-4).all()
        assert (s < lain.lowest(around) + 1e-3).all()
        x, y = s * np.cos(around), s * np.sin(around)
        assert np.ptp(y) * 1e3 < 1.0  # straight in the map
        ways.append((y.mean(), np.sign(x[-1] - x[0])))
    asides = np.unique(np.round([aside for aside, _ in ways], 3))
    assert np.diff(asides).max() * 1e3 < 26.0
    first_ways = [next(way for y, way in ways if abs(y - aside) < 1e-3) for aside in asides]
    assert (np.diff(first_ways) != 0).all()


@pytest.mark.parametrize("kind", ["loops", "spiral", "radial", "antiradial", "raster"])
def test_strokes_lie_on_the_skin_with_its_normals(kind):
    for path in strokes(kind, spacing=0.02):
        from_centre = path.points_B - CENTRE_B
        distance = np.linalg.norm(from_centre, axis=1)
        assert np.abs(distance - RADIUS).max() * 1e3 < 1e-3
        cosine = np.sum(from_centre / distance[:, None] * path.normals_B, axis=1)
        assert np.degrees(np.arccos(np.minimum(cosine, 1.0))).max() < 0.01


def test_pieces_of_a_loop_make_up_the_whole():
    lain = band()
    loop = coverage.tracks("loops", lain, 0.02)[0]
    first, second = loop.part(0.0, 0.3), loop.part(0.3, 1.0)
    whole = lain.path(loop).curve.length
    lengths = [lain.path(piece).curve.length for piece in (first, second)]
    assert not first.closed
    assert abs(sum(lengths) - whole) * 1e3 < 0.2
    assert lengths[0] / whole == pytest.approx(0.3, abs=0.01)


def test_a_breast_without_room_between_the_margins_is_refused_with_the_place():
    with pytest.raises(PlanningError, match=r"no room for a stroke 12 mm wide.*mm away from it"):
        band(config=CoverageConfig(nipple_margin=0.06, base_margin=0.04))


def test_skin_that_was_not_seen_is_not_crossed():
    """Of a breast whose top alone was seen, with the band of one that was seen whole."""
    lain = band()
    side = len(BALL.support)
    middle = np.hypot(*(np.indices((side, side)) - side / 2 + 0.5)) < 0.2 * side
    half_seen = replace(lain, skin=replace(BALL, support=BALL.support & middle))
    with pytest.raises(PlanningError, match="no skin was seen over"):
        half_seen.path(Track(np.ones(12), np.linspace(0.0, 6.0, 12)))


def unseen_between(lain, begin, end):
    """The band, no skin seen between two azimuths [rad], the robot's side being 0."""
    side = len(BALL.support)
    cells = (np.moveaxis(np.indices((side, side)), 0, -1) + 0.5) / side * 2 * REACH - REACH
    out = (cells - lain.top_ab) @ pattern.towards_robot(BALL).T
    azimuths = np.arctan2(out[..., 1], out[..., 0])
    hidden = (azimuths > begin) & (azimuths < end)
    return replace(lain, skin=replace(BALL, support=BALL.support & ~hidden))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_loop_over_unseen_skin_is_cut_there_and_goes_all_around(way):
    lain = band()
    loop = coverage.tracks("loops", lain, 0.02)[0]
    loop = replace(loop, azimuth=way * np.abs(loop.azimuth))
    (piece,) = unseen_between(lain, 0.5, 0.8).seen(loop)
    assert not piece.closed
    azimuths = np.mod(piece.azimuth, 2 * np.pi)
    assert ((azimuths > 0.75) | (azimuths < 0.55)).all()
    assert np.abs(np.diff(piece.azimuth)).max() < 0.5
    assert np.ptp(piece.azimuth) == pytest.approx(2 * np.pi - 0.3, abs=0.1)
    unseen_between(lain, 0.5, 0.8).path(piece)  # all of it was seen


def test_an_open_stroke_over_unseen_skin_falls_into_pieces():
    lain = band()
    stroke = Track(np.full(40, 0.5), np.linspace(-1.0, 2.0, 40))
    first, second = unseen_between(lain, 0.5, 0.8).seen(stroke)
    assert first.azimuth[0] == pytest.approx(-1.0, abs=0.02)
    assert 0.4 < first.azimuth[-1] < 0.55
    assert 0.75 < second.azimuth[0] < 0.9
    assert second.azimuth[-1] == pytest.approx(2.0, abs=0.02)


def test_a_stroke_that_was_seen_stays_whole_and_one_that_was_not_goes():
    lain = band()
    loop = coverage.tracks("loops", lain, 0.02)[0]
    assert lain.seen(loop) == [loop]
    assert unseen_between(lain, -4.0, 4.0).seen(loop) == []


@pytest.mark.parametrize("wrong", [{"overlap": 0.9}, {"overlap": -0.1}, {"nipple_margin": 0.0}])
def test_margins_and_overlap_have_bounds(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        CoverageConfig(**wrong)
