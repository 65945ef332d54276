"""A cloud in no order by rows and columns, against the surface that it was drawn from."""

import numpy as np
import pytest

from breastscan.cloud.laid_out import PIXEL, LaidOut
from breastscan.geometry import se3
from tests.cloud.clouds import bump, cloud, tilted


@pytest.mark.parametrize("tilt", [0.0, 0.7])
def test_a_pixel_sees_the_surface_that_the_points_lie_on(tilt):
    X_BS = tilted(tilt, 1.0)
    view = LaidOut.along(X_BS[:3, 2], cloud(X_BS=X_BS).points_B)
    seen_B = se3.transform(view.X_AC, view.points[np.isfinite(view.points[..., 2])])
    seen_S = se3.transform(se3.inverse(X_BS), seen_B)
    off = seen_S[:, 2] - bump(*seen_S[:, :2].T)
    assert np.sqrt(np.mean(off**2)) < 0.2e-3
    assert len(seen_S) * PIXEL**2 == pytest.approx(0.26**2, rel=0.02)


def test_holes_stay_holes():
    drawn = cloud()
    away = np.linalg.norm(drawn.along - [0.09, 0.0], axis=1)
    view = LaidOut.along(np.array([0.0, 0, 1]), drawn.where(away > 0.02).points_B)
    points_B = se3.transform(view.X_AC, view.points[np.isfinite(view.points[..., 2])])
    assert np.linalg.norm(points_B[:, :2] - [0.59, 0.0], axis=1).min() > 0.016


def test_what_lies_under_other_skin_is_not_seen():
    """A second sheet 40 mm below."""
    drawn = cloud()
    both = np.concatenate([drawn.points_B, drawn.points_B - [0, 0, 0.04]])
    seen = LaidOut.along(np.array([0.0, 0, 1]), both).points[..., 2]
    alone = LaidOut.along(np.array([0.0, 0, 1]), drawn.points_B).points[..., 2]
    assert np.ptp(seen[np.isfinite(seen)]) == pytest.approx(np.nanmax(alone) - np.nanmin(alone))


def test_points_before_and_behind_a_mask_are_told():
    drawn = cloud()
    view = LaidOut.along(np.array([0.0, 0, 1]), drawn.points_B)
    everything = np.ones(view.points.shape[:2], bool)
    assert view.inside(everything, drawn.points_B).all()
    assert not view.inside(everything, drawn.points_B + np.array([1.0, 0, 0])).any()
    assert not view.inside(~everything, drawn.points_B).any()
