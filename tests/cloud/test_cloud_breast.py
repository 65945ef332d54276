"""The breast and its chest in clouds, against the ones that they were drawn from."""

import numpy as np
import pytest

from breastscan.cloud.cloud_breast import breast_in, breast_over
from breastscan.errors import PerceptionError
from breastscan.geometry.plane import Plane
from tests.cloud.clouds import HEIGHT, STANDING, bump, cloud, cylinder, flat, tilted


def off_half_height(drawn, breast) -> float:
    """Largest error of the chest's heights along the true loop [m]: of the loop about as much."""
    return np.abs(breast.chest.heights(drawn.loop_B) - HEIGHT / 2).max()


def found(drawn):
    return breast_in(drawn.points_B, drawn.normals_B)


@pytest.mark.parametrize("tilt_deg", [0.0, 5.0, 15.0, 60.0])
@pytest.mark.parametrize("azimuth", [0.0, 2.0])
def test_heights_count_from_a_chest_that_is_tilted(tilt_deg, azimuth):
    drawn = cloud(X_BS=tilted(np.radians(tilt_deg), azimuth))
    breast = found(drawn)
    assert off_half_height(drawn, breast) < 0.2e-3
    assert not breast.by_rim
    high = bump(*drawn.along.T) > 2e-3
    assert breast.skin[high].mean() > 0.99
    assert breast.skin[bump(*drawn.along.T) == 0].mean() < 0.01


@pytest.mark.parametrize("X_BS", [tilted(0.0), tilted(0.26, 1.0), STANDING])
@pytest.mark.parametrize("radius", [0.15, 0.6])
def test_heights_count_from_a_chest_that_is_bent(radius, X_BS):
    """A parabola stands for the circle: it is off by most of this on 150 mm."""
    drawn = cloud(cylinder(radius), X_BS)
    assert off_half_height(drawn, found(drawn)) < 1e-3


def test_a_cloud_that_ends_with_the_breast_counts_from_its_rim():
    drawn = cloud(X_BS=tilted(0.26))
    breast = found(drawn.where(bump(*drawn.along.T) > 0))
    assert breast.by_rim
    assert off_half_height(drawn, breast) < 0.7e-3


def test_a_rim_that_is_no_plane_is_refused():
    drawn = cloud(cylinder(0.15))
    with pytest.raises(PerceptionError, match=r"rim, which is off a plane by [3-9]\.\d mm"):
        found(drawn.where(bump(*drawn.along.T) > 0))


def test_several_breasts_are_refused_with_their_places():
    drawn = cloud(heights=lambda u, v: bump(u, v, -0.08) + bump(u, v, 0.08), width=0.4)
    with pytest.raises(PerceptionError, match=r"found 2 \(near \[(49|50)\d, -?[78]\d, 1\d\d\]"):
        found(drawn)
    with pytest.raises(PerceptionError, match=r"found 2 \(near"):
        breast_over(drawn.points_B, Plane(normal=np.array([0.0, 0, 1]), offset=0.1))


def test_a_chest_without_a_breast_is_refused():
    with pytest.raises(PerceptionError, match="expected a breast 60 to 250 mm wide on a chest"):
        found(cloud(heights=lambda u, v: 0 * u))


def test_a_chest_that_is_not_smooth_is_refused():
    """It drops by 6 mm where the breast ends on one side."""

    def stepped(u, v):
        p, n = flat(u, v)
        return p - 0.006 * (np.abs(v) > 0.078)[..., None] * n, n

    with pytest.raises(PerceptionError, match=r"of one smooth chest|own rim"):
        found(cloud(stepped))


def test_a_bent_chest_of_which_a_side_is_missing_is_refused_with_the_side():
    drawn = cloud(cylinder(0.25))
    with pytest.raises(PerceptionError, match=r"over 1\d\d degrees .* towards \[-1\.0, -?0\.\d"):
        found(drawn.where(drawn.along[:, 0] > 0.02))


def test_normals_that_point_inwards_are_refused():
    drawn = cloud()
    with pytest.raises(PerceptionError, match="its normals outwards"):
        breast_in(drawn.points_B, -drawn.normals_B)


def test_normals_to_all_sides_are_refused():
    drawn = cloud()
    both = np.where(np.arange(len(drawn.points_B))[:, None] % 2, 1, -1)
    with pytest.raises(PerceptionError, match="expected normals that face one side"):
        breast_in(drawn.points_B, both * drawn.normals_B)


def test_millimetres_are_refused():
    drawn = cloud()
    with pytest.raises(PerceptionError, match="give them in metres"):
        breast_in(1e3 * drawn.points_B, drawn.normals_B)


def test_a_given_plate_overrides_the_chest():
    drawn = cloud()
    plate = Plane(normal=np.array([0.0, 0, 1]), offset=0.09)
    assert breast_over(drawn.points_B, plate).chest is plate
    with pytest.raises(PerceptionError, match="give a lower plate"):
        breast_over(drawn.points_B, Plane(normal=plate.normal, offset=0.3))


def test_hardly_any_points_are_refused():
    drawn = cloud(count=50)
    with pytest.raises(PerceptionError, match="100 points or more, got 50"):
        found(drawn)
