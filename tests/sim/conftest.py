import pytest

from sim.phantom import PhantomConfig
from sim.scene import Scene, SceneConfig
from sim.wrench_errors import WrenchSensorConfig


@pytest.fixture(scope="session")
def quiet_scene() -> Scene:
    """The default scene with a noiseless wrist sensor."""
    return Scene(SceneConfig(phantom=PhantomConfig(), wrist=WrenchSensorConfig(quality="ideal")))
