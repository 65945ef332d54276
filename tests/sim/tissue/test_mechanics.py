import pytest

from sim.tissue.contact import Mechanics
from sim.tissue.flex import FlexTissue
from sim.tissue.mechanics import build_mechanics
from sim.tissue.phantom import Phantom
from sim.tissue.phantom_config import PhantomConfig
from sim.tissue.printed import PrintedBreast
from sim.tissue.soft import SoftTissue


@pytest.mark.parametrize(
    ("name", "kind"), [("soft", SoftTissue), ("printed", PrintedBreast), ("flex", FlexTissue)]
)
def test_the_configuration_names_the_mechanics(name, kind):
    mechanics = build_mechanics(Phantom(PhantomConfig(mechanics=name)))
    assert isinstance(mechanics, kind)
    assert isinstance(mechanics, Mechanics)
