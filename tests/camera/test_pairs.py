"""Which pictures belong together, by the names that people give them."""

import pytest

from breastscan.camera.pairs import paired
from breastscan.errors import PerceptionError

NAMINGS = {
    "left1.png right1.png left2.png right2.png": {"1", "2"},
    "left01.jpg right01.jpg": {"01"},
    "left_01.png right_01.png": {"01"},
    "01_l.png 01_r.png 02_l.png 02_r.png": {"01", "02"},
    "L1.bmp R1.bmp": {"1"},
    "left/01.png right/01.png left/02.png right/02.png": {"01", "02"},
    "LEFT/a.JPG RIGHT/a.JPG": {"a"},
    "cam0/01.png cam1/01.png": {"01"},
    "cam0/data/15.png cam1/data/15.png": {"data_15"},
    "cam1_01.png cam2_01.png": {"01"},
    "img_left_3.pgm img_right_3.pgm": {"img_3"},
    "a-left.webp a-right.webp": {"a"},
    "im0.png im1.png": {"pair"},
    "view1.png view5.png": {"pair"},
    "image_0/000.png image_1/000.png image_0/001.png image_1/001.png": {"000", "001"},
    "left.png right.png": {"pair"},
    "calibration_left/left03.png calibration_left/right03.png": {"calibration_left_03"},
}


def made(folder, names):
    for name in names.split():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(b"")


@pytest.mark.parametrize("names", NAMINGS)
def test_pairs_are_found_by_their_names(names, tmp_path):
    made(tmp_path, names)
    found = paired(tmp_path)
    assert found.pairs.keys() == NAMINGS[names]
    assert found.alone == ()
    order = names.lower().split()
    for left, right in found.pairs.values():
        first, second = (str(path.relative_to(tmp_path)).lower() for path in (left, right))
        assert order.index(second) == order.index(first) + 1


def test_pictures_without_a_partner_are_named_on_either_side(tmp_path):
    made(tmp_path, "left1.png right1.png left2.png right3.png figure.png notes.txt")
    found = paired(tmp_path)
    assert found.pairs.keys() == {"1"}
    assert [path.name for path in found.alone] == ["left2.png", "right3.png"]


def test_a_folder_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(PerceptionError, match="no folder"):
        paired(tmp_path / "nowhere")
