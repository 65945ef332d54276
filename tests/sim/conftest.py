import pytest

from sim.phantom import PhantomConfig
from sim.scene import Scene, SceneConfig
from sim.wrench_sensor import WrenchSensorConfig


@pytest.fixture(scope="session")
def quiet_scene() -> Scene:
    """The default scene with a noiseless wrist sensor."""
    return Scene(SceneConfig(phantom=PhantomConfig(), wrist=WrenchSensorConfig(force_noise=0.0, torque_noise=0.0)))
