import pytest

from sim.scene import Scene, SceneConfig
from sim.tissue.phantom import PhantomConfig
from sim.wrist.wrench_errors import WrenchSensorConfig


@pytest.fixture(scope="session")
def quiet_scene() -> Scene:
    """The default scene with a noiseless wrist sensor."""
    return Scene(SceneConfig(phantom=PhantomConfig(), wrist=WrenchSensorConfig(quality="ideal")))
