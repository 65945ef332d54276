"""The picture of a disparity shows what is known, in colours whose scale stands beside it."""

import cv2
import numpy as np

from breastscan.vision.disparity_picture import disparity_picture

BRIGHTEST, DARKEST = (
    tuple(cv2.applyColorMap(np.full((1, 1), grey, np.uint8), cv2.COLORMAP_VIRIDIS)[0, 0])
    for grey in (255, 0)
)


def ramp(rows: int = 200, columns: int = 300) -> np.ndarray:
    return np.linspace(100, 140, rows * columns, dtype=np.float32).reshape(rows, columns)


def test_it_is_black_exactly_where_nothing_is_known():
    disparity = ramp()
    disparity[5:9, 5:9] = np.nan
    picture = disparity_picture(disparity)[:, :300]
    np.testing.assert_array_equal((picture == 0).all(axis=2), np.isnan(disparity))


def test_where_nothing_at_all_is_known_there_is_no_scale():
    picture = disparity_picture(np.full((4, 5), np.nan, np.float32))
    assert picture.shape == (4, 5, 3)
    assert not picture.any()


def test_a_few_chance_matches_do_not_change_the_colours():
    disparity = ramp()
    clean = disparity_picture(disparity)
    disparity[:2, :100] = 5.0
    spoilt = disparity_picture(disparity)
    apart = np.abs(spoilt[10:, :300].astype(int) - clean[10:, :300].astype(int))
    assert apart.max() < 10


def test_the_scale_runs_from_the_nearest_on_top_to_the_farthest():
    scale = disparity_picture(ramp())[:, 300:]
    column = scale[:, 6]  # through the bar, which is 4 px wide
    drawn = column[column.any(axis=1)]
    assert tuple(drawn[0]) == BRIGHTEST
    assert tuple(drawn[-1]) == DARKEST
    assert (scale == scale[..., :1]).all(axis=2).mean() > 0.5, "labels are grey on black"


def test_one_disparity_everywhere_makes_a_picture_too():
    assert disparity_picture(np.full((40, 40), 7.0, np.float32)).any()
