import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from breastscan.errors import ConfigError
from sim.wrist.probe_face import ProbeFace, distance

FACE = ProbeFace()
COORDINATE = st.floats(-0.04, 0.04)


def test_the_tip_lies_on_the_face_and_z_leads_out_of_it():
    assert distance(FACE.parameters(), 0.0, 0.0, 0.0)[0] == pytest.approx(0, abs=1e-12)
    assert distance(FACE.parameters(), 0.0, 0.0, 0.002) == pytest.approx(
        (0.002, 0, 0, 1), abs=1e-12
    )


def test_the_face_is_an_arc_of_sixty_millimetres_radius_between_its_edges():
    x = np.linspace(-0.025, 0.025, 11)
    z = np.sqrt(0.06**2 - x**2) - 0.06
    assert [
        distance(FACE.parameters(), *p)[0] for p in zip(x, 0 * x, z, strict=True)
    ] == pytest.approx(0 * x, abs=1e-12)


def test_the_probe_is_as_wide_as_its_elevation_and_no_longer_than_its_arc():
    assert distance(FACE.parameters(), 0.0, 0.0065, -0.01)[0] == pytest.approx(0, abs=1e-12)
    half_chord = 0.06 * np.sin(0.5)
    assert distance(FACE.parameters(), half_chord + 5e-4, 0.0, -0.008)[0] > 0
    assert distance(FACE.parameters(), half_chord - 2e-3, 0.0, -0.010)[0] < 0


@given(x=COORDINATE, y=COORDINATE, z=st.floats(-0.03, 0.03))
def test_moving_down_the_gradient_by_the_distance_reaches_the_face(x, y, z):
    d, *gradient = distance(FACE.parameters(), x, y, z)
    foot = np.array([x, y, z]) - d * np.array(gradient)
    assert np.linalg.norm(gradient) == pytest.approx(1, abs=1e-9)
    if d > 0:
        assert distance(FACE.parameters(), *foot)[0] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(
    "wrong", [{"edge_radius": 0.0}, {"edge_radius": 0.02}, {"arc": 0.2}, {"arc": 0.001}]
)
def test_impossible_faces_are_refused(wrong):
    with pytest.raises(ConfigError):
        ProbeFace(**wrong)
