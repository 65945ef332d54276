"""Which pairs are refused."""

import numpy as np
import pytest

from breastscan.errors import PerceptionError
from breastscan.vision.matching.pair_check import check_exchanged, check_exposure


def partly_known(fraction: float) -> np.ndarray:
    disparity = np.full((10, 100), np.nan, np.float32)
    disparity[:, : int(100 * fraction)] = 90.0
    return disparity


def test_pair_that_matches_better_the_other_way_round_is_called_exchanged():
    with pytest.raises(PerceptionError, match=r"exchanged: 30 % .* 80 % the other way round"):
        check_exchanged(partly_known(0.3), partly_known(0.8))


def test_pair_that_is_no_better_the_other_way_round_passes():
    check_exchanged(partly_known(0.3), partly_known(0.35))


@pytest.mark.parametrize(
    ("shade", "fault"), [(3, "black"), (255, "saturated"), (120, "no texture")]
)
def test_image_of_one_shade_is_refused_by_its_name(shade, fault):
    with pytest.raises(PerceptionError, match=rf"the left image .*{fault}"):
        check_exposure(np.full((20, 30), shade, np.uint8), "the left image")


def test_dim_scene_with_a_reflection_passes():
    image = np.random.default_rng(0).integers(5, 45, (60, 80)).astype(np.uint8)
    image[:10, :10] = 255
    check_exposure(image, "the left image")
