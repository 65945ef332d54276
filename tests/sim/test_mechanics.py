import pytest

from sim.contact import Mechanics
from sim.flex import FlexTissue
from sim.mechanics import build_mechanics
from sim.phantom import Phantom
from sim.phantom_config import PhantomConfig
from sim.printed import PrintedBreast
from sim.tissue import SoftTissue


@pytest.mark.parametrize(("name", "kind"), [("soft", SoftTissue), ("printed", PrintedBreast), ("flex", FlexTissue)])
def test_the_configuration_names_the_mechanics(name, kind):
    mechanics = build_mechanics(Phantom(PhantomConfig(mechanics=name)))
    assert isinstance(mechanics, kind)
    assert isinstance(mechanics, Mechanics)
