import dataclasses

import cv2
import pytest

from breastscan.errors import ConfigError
from sim.cameras.video import VideoConfig, render_still, render_video
from sim.scene import HOME_Q
from tests.sim.tissue.closed_form_tissue import SpringTissue

SMALL = VideoConfig(width=240, height=160, fps=10.0, speed_up=2.0)


@pytest.fixture
def tissue(quiet_scene):
    return SpringTissue(height=0.0, stiffness=0.0, skin_S=quiet_scene.phantom.skin.vertices_S)


@pytest.fixture
def went(run):
    """A synthetic scan, as if it had taken .6 s."""
    return dataclasses.replace(
        run.trajectory, t=run.trajectory.t * 0.6 / run.trajectory.elapsed[-1]
    )


def test_video_has_one_frame_for_every_frame_time_of_the_scan(quiet_scene, tissue, went, tmp_path):
    path = tmp_path / "scan.mp4"
    fractions = []
    render_video(
        quiet_scene, tissue, went, path, SMALL, lambda fraction, _: fractions.append(fraction)
    )
    film = cv2.VideoCapture(str(path))
    frames = []
    while (frame := film.read())[0]:
        frames.append(frame[1])
    assert len(frames) == 3
    assert frames[0].shape == (160, 240, 3)
    assert frames[0].std() > 20
    assert fractions[-1] == pytest.approx(1)


def test_a_film_that_cannot_be_written_is_refused(quiet_scene, tissue, went, tmp_path):
    with pytest.raises(ConfigError, match="folder that exists"):
        render_video(quiet_scene, tissue, went, tmp_path / "nowhere" / "scan.mp4", SMALL)


def test_still_has_the_asked_size_and_is_well_exposed(quiet_scene, tissue):
    image = render_still(quiet_scene, tissue, HOME_Q, size_px=(320, 200))
    assert image.shape == (200, 320, 3)
    assert (image == 255).mean() < 0.01


@pytest.mark.parametrize("wrong", [{"fps": 0.0}, {"width": -1}, {"speed_up": 0.0}])
def test_impossible_films_are_refused(wrong):
    with pytest.raises(ConfigError):
        VideoConfig(**wrong)
