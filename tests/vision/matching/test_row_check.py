"""Pairs that do not fit their rig, made from pairs that do."""

import numpy as np
import pytest

from breastscan.errors import PerceptionError
from breastscan.vision.matching.row_check import check_rows, measured
from experiments.depth_edges import edge_pair
from experiments.ray_cast_dome import DomeScene

PAIRS = {"dome": DomeScene().pair(), "room": edge_pair(width=640, height=448)}


@pytest.fixture(params=PAIRS)
def pair(request):
    return PAIRS[request.param]


def turned(image):
    return np.ascontiguousarray(image[::-1, ::-1])


def test_a_pair_of_its_rig_is_passed_and_its_rows_are_right_to_a_tenth_of_a_pixel(pair):
    check_rows(pair.left, pair.right)
    rows = measured(pair.left, pair.right)
    assert rows.error_px < 0.1
    assert rows.beyond < 0.05


@pytest.mark.parametrize("shift", [-40, -5, 5, 40])
def test_rows_that_are_off_are_measured(pair, shift):
    shifted = np.roll(pair.right, shift, axis=0)
    assert measured(pair.left, shifted).error_px == pytest.approx(abs(shift), abs=0.1)
    with pytest.raises(PerceptionError, match=rf"{abs(shift)}\.0 px apart in height"):
        check_rows(pair.left, shifted)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda left, right: (right, left),
        lambda left, right: (turned(left), turned(right)),
        lambda left, right: (left[:, 130:], right[:, :-130]),
    ],
    ids=["exchanged", "upside down", "cropped unalike"],
)
def test_points_beyond_infinity_are_noticed(pair, wrong):
    with pytest.raises(PerceptionError, match="beyond infinity"):
        check_rows(*(np.ascontiguousarray(image) for image in wrong(pair.left, pair.right)))


def test_pictures_of_a_rig_on_its_side_are_noticed(pair):
    with pytest.raises(PerceptionError, match="apart in height"):
        check_rows(*(np.ascontiguousarray(np.rot90(image)) for image in (pair.left, pair.right)))


def test_of_pictures_that_have_nothing_in_common_nothing_is_said():
    rng = np.random.default_rng(0)
    left, right = rng.integers(0, 255, (2, 448, 640)).astype(np.uint8)
    assert measured(left, right) is None
    check_rows(left, right)
