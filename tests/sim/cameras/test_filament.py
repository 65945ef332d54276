from contextlib import closing

import numpy as np
import pytest

from sim.cameras import filament
from sim.cameras.picture import Picture
from sim.cameras.video import CLOSE_UP
from sim.scene import HOME_Q

needs_vulkan = pytest.mark.skipif(filament.unusable() is not None, reason=str(filament.unusable()))


def draw(scene, skin_S):
    with closing(Picture(scene, 240, 160, fine=True)) as picture:
        picture.arrange(HOME_Q, skin_S)
        return picture.draw(CLOSE_UP.camera()).copy()


@needs_vulkan
def test_the_fine_renderer_draws_the_skin_as_deformed(quiet_scene):
    skin_S = quiet_scene.phantom.skin.vertices_S
    round_one, flat_one = draw(quiet_scene, skin_S), draw(quiet_scene, skin_S * [1.0, 1.0, 0.2])
    assert round_one.shape == (160, 240, 3)
    assert round_one.std() > 20
    changed = np.abs(round_one.astype(float) - flat_one).max(axis=2) > 10
    assert 0.03 < changed.mean() < 0.3  # the breast, and nothing else


def test_a_missing_vulkan_is_said_with_its_cure(monkeypatch):
    filament.unusable.cache_clear()
    monkeypatch.setattr(filament.ctypes.util, "find_library", lambda name: None)
    assert "apt-get install libvulkan1" in str(filament.unusable())
    filament.unusable.cache_clear()


def test_a_driver_that_fails_is_a_reason_and_no_crash(monkeypatch):
    filament.unusable.cache_clear()
    monkeypatch.setattr(filament.ctypes.util, "find_library", lambda name: "libvulkan.so.1")
    monkeypatch.setattr(filament, "PROBE", "import os; os.abort()")
    assert "does not work" in str(filament.unusable())
    filament.unusable.cache_clear()
