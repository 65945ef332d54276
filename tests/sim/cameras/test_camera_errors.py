import pytest

from breastscan.errors import ConfigError
from sim.cameras.camera_errors import CAMERA_CLASSES, CameraConfig


def test_a_class_sets_every_error():
    assert CameraConfig(quality="realistic").errors == CAMERA_CLASSES["realistic"]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("vignetting", 0.0),
        ("blur_px", 0.0),
        ("shot_noise", False),
        ("read_noise", 0.0),
        ("bits", 8),
    ],
)
def test_each_error_is_switched_by_itself(name, value):
    realistic, changed = (
        CAMERA_CLASSES["realistic"],
        CameraConfig(quality="realistic", **{name: value}).errors,
    )
    assert getattr(changed, name) == value
    assert {key for key in vars(realistic) if getattr(realistic, key) != getattr(changed, key)} == {
        name
    }


@pytest.mark.parametrize(
    "wrong",
    [
        {"read_noise": -1.0}, {"read_noise": float("nan")}, {"vignetting": -2.0},
        {"blur_px": float("inf")}, {"bits": 9}, {"exposure_time": 0.0}, {"gain": 0.5},
        {"motion_samples": 0}, {"supersampling": 0}, {"supersampling": 9},
    ],
)  # fmt: skip
def test_cameras_that_cannot_be_are_refused(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        CameraConfig(**wrong)
