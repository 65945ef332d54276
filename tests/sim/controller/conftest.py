import pytest

from sim.scene import Scene
from tests.sim.controller.programs import switched_on


@pytest.fixture(scope="module")
def scene():
    return Scene()


@pytest.fixture
def controller(scene):
    return switched_on(scene)
