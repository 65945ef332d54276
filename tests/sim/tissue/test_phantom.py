from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh

from breastscan.errors import ConfigError
from sim.tissue.breast import SHAPES
from sim.tissue.layers import LayerConfig
from sim.tissue.phantom import TEXTURE_RIM, TEXTURE_SIZE_PX, Phantom
from sim.tissue.phantom_config import PhantomConfig
from sim.tissue.texture import BANDWIDTH, band_noise

CAMERA_PIXEL = 0.8e-3
"""Size of a camera's pixel on the skin at working distance [m]."""


@pytest.fixture(scope="module")
def phantom() -> Phantom:
    return Phantom(PhantomConfig())


@pytest.fixture(scope="module")
def skin_texture(phantom) -> np.ndarray:
    return phantom.texture_image()


def test_the_skin_stands_on_the_chest_plate_and_reaches_the_configured_height(phantom):
    skin = phantom.skin
    mesh = trimesh.Trimesh(skin.vertices_S, skin.triangles, process=False)
    rim = mesh.edges_sorted[trimesh.grouping.group_rows(mesh.edges_sorted, require_count=1)]
    assert np.all(skin.vertices_S[rim, 2] == 0.0)
    assert len(np.unique(rim)) == np.sum(skin.vertices_S[:, 2] == 0.0)
    assert skin.vertices_S[:, 2].max() == pytest.approx(0.055, abs=1e-9)
    assert 0.14 < np.ptp(skin.vertices_S[:, 0]) < 0.16


def test_the_fine_mesh_follows_the_smooth_surface_to_a_hundredth_of_a_millimetre(phantom):
    skin = phantom.skin
    normals = trimesh.Trimesh(skin.vertices_S, skin.triangles, process=False).face_normals
    assert (normals * skin.normals_S[skin.triangles[:, 0]]).sum(axis=1).min() > 0.98
    sag = np.abs(phantom.level(skin.vertices_S[skin.triangles].mean(axis=1))) * phantom.radius
    assert np.median(sag) < 1e-5
    assert sag.max() < 1e-4


def test_normals_are_the_gradient_of_the_implicit_function(phantom):
    p_S, step = phantom.skin.vertices_S[::50], 1e-7
    gradient = np.stack(
        [phantom.level(p_S + step * e) - phantom.level(p_S - step * e) for e in np.eye(3)], axis=1
    )
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    np.testing.assert_allclose(phantom.skin.normals_S[::50], gradient, atol=1e-6)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_inverse_map_inverts_embed_throughout_the_volume(seed):
    phantom = Phantom(PhantomConfig(seed=seed))
    ball = np.random.default_rng(seed).uniform(-1, 1, (2000, 3))
    ball = ball[np.linalg.norm(ball, axis=1) <= 1] * [1, 1, 0.5] + [0, 0, 0.25]
    np.testing.assert_allclose(phantom.inverse_map(phantom.embed(ball)), ball, atol=1e-12)


def test_the_half_height_loop_is_a_level_ring_that_leans_as_a_supine_breast_does(phantom):
    loop_S = phantom.level_loop(phantom.height / 2, 720)
    np.testing.assert_allclose(loop_S[:, 2], 0.0275, atol=1e-12)
    np.testing.assert_allclose(phantom.level(loop_S), 0, atol=1e-12)
    tilt_deg = np.degrees(np.arccos(phantom.normal(phantom.inverse_map(loop_S))[:, 2]))
    assert 35 < tilt_deg.min() < tilt_deg.max() < 60
    with pytest.raises(ValueError, match="no contour"):
        phantom.level_loop(0.06, 100)


def test_the_seed_varies_the_shape_a_little_and_repeatably():
    one, same, other = (Phantom(PhantomConfig(seed=seed)).skin.vertices_S for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert 1e-4 < np.abs(one - other).max() < 5e-3


def test_the_texture_follows_the_shapes_seed_unless_it_has_its_own():
    follows, same, own = (
        Phantom(PhantomConfig(seed=seed, texture_seed=texture))
        for seed, texture in ((3, None), (3, 3), (3, 4))
    )
    for looks in (Phantom.texture_image, Phantom.plate_texture):
        np.testing.assert_array_equal(looks(follows), looks(same))
        assert (looks(follows) != looks(own)).any()
    np.testing.assert_array_equal(follows.skin.vertices_S, own.skin.vertices_S)
    with pytest.raises(ConfigError, match="texture_seed must be a whole number"):
        PhantomConfig(texture_seed=-1)


def volume_of(shape):
    """Without nipple and areola, in closed form [m^3]."""
    height = shape.height - shape.nipple_height - shape.areola_height
    return (
        np.pi * shape.radius**2 * (1 - shape.elongation**2) * height * (0.5 + shape.roundness / 6)
    )


@pytest.mark.parametrize("breast", list(SHAPES))
def test_every_class_has_the_volume_of_victres_breast_laid_on_its_back(breast):
    """The mesh's volume against the closed form's, to which nipple and areola add a little."""
    phantom = Phantom(PhantomConfig(breast=breast, asymmetry=0.0, ptosis=0.0))
    skin = phantom.skin
    a, b, c = skin.vertices_S[skin.triangles].transpose(1, 0, 2)
    volume = np.einsum("nc,nc->n", a, np.cross(b, c)).sum() / 6
    assert volume == pytest.approx(volume_of(SHAPES[breast]), rel=0.03)
    assert 0.6 < phantom.height / phantom.radius < 0.8


def test_classes_grow_with_fat_as_victres_do():
    """Volumes in ml of superellipsoids with VICTRE's half axes, by sampling."""
    ball = np.random.default_rng(0).uniform(0, 1, (200_000, 3))
    for breast, (a1, a2, a3, e1) in {
        "dense": (1.0, 1.0, 1.0, 1.2),
        "heterogeneous": (1.2, 1.0, 1.55, 1.2),
        "scattered": (1.4, 1.2, 2.0, 1.2),
        "fatty": (1.4, 1.4, 2.75, 1.1),
    }.items():
        inside = (np.hypot(ball[:, 0], ball[:, 1]) ** (2 / e1) + ball[:, 2] ** (2 / e1) < 1).mean()
        victre = 4 * inside * 35e-3**3 * (a1 * a2 * a3) ** e1
        assert volume_of(SHAPES[breast]) == pytest.approx(victre, rel=0.01)


def test_size_scales_the_whole_shape():
    one, twice = (
        Phantom(PhantomConfig(breast="scattered", size=size, seed=3)).skin for size in (0.6, 1.2)
    )
    np.testing.assert_allclose(twice.vertices_S, 2 * one.vertices_S, atol=1e-12)
    np.testing.assert_allclose(twice.normals_S, one.normals_S, atol=1e-8)


def test_without_asymmetry_and_ptosis_the_base_is_an_ellipse_and_the_nipple_over_its_middle():
    phantom = Phantom(PhantomConfig(breast="heterogeneous", asymmetry=0.0, ptosis=0.0))
    loop_S = phantom.level_loop(0.0, 360)
    np.testing.assert_allclose(loop_S.mean(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(
        phantom.embed(np.array([[0.0, 0.0, 1.0]]))[0], [0, 0, phantom.height], atol=1e-12
    )


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        ({"young": -1.0}, "positive"),
        ({"young": 0.0}, "positive"),
        ({"poisson": 0.5}, "poisson"),
        ({"size": 0.0}, "size"),
        ({"size": np.nan}, "size"),
        ({"gel_friction": -0.1}, "gel_friction"),
        ({"asymmetry": 12.0}, "folds"),
        ({"ptosis": 12.0}, "beside the base"),
        ({"projection": 0.2}, "too flat"),
        ({"layers": LayerConfig(mass_radius=0.01, mass_p_S=(0.08, 0.0, 0.02))}, "outside"),
    ],
)
def test_impossible_phantoms_are_refused(wrong, why):
    with pytest.raises(ConfigError, match=why):
        Phantom(replace(PhantomConfig(), **wrong))


@pytest.mark.parametrize(
    "wrong",
    [
        {"gland_fraction": 1.0},
        {"gland_ratio": -3.0},
        {"mass_ratio": 0.0},
        {"mass_radius": -0.01},
        {"skin_ratio": np.nan},
    ],
)
def test_impossible_tissues_are_refused(wrong):
    with pytest.raises(ConfigError):
        LayerConfig(**wrong)


@pytest.mark.parametrize("wavelength", [5.0, 18.0, 300.0])
def test_noise_is_what_the_whole_spectrum_would_give(wavelength):
    size = 256
    frequency = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size)[None, :])
    gain = np.exp(-0.5 * ((frequency * wavelength - 1) / BANDWIDTH) ** 2)
    gain[0, 0] = 0.0
    white = np.random.default_rng(2).standard_normal((size, size))
    whole = np.fft.irfft2(np.fft.rfft2(white) * gain, s=(size, size))
    noise = band_noise(np.random.default_rng(2), size, wavelength)
    np.testing.assert_allclose(noise, whole / whole.std(), atol=1e-10)


def test_every_matching_window_of_the_skin_has_contrast(skin_texture):
    seen = _as_seen_by_the_camera(skin_texture)
    mean = cv2.blur(seen, (9, 7))
    contrast = np.sqrt(np.maximum(cv2.blur(seen * seen, (9, 7)) - mean**2, 0))
    rows, columns = np.indices(seen.shape) / len(seen) - 0.5
    on_the_breast = np.hypot(rows, columns) < TEXTURE_RIM
    assert np.quantile(contrast[on_the_breast], 0.001) > 8


def test_the_texture_holds_no_detail_finer_than_the_camera_can_see(skin_texture):
    grey = skin_texture.mean(axis=2) - skin_texture.mean()
    power = np.abs(np.fft.rfft2(grey)) ** 2
    frequency = np.hypot(np.fft.fftfreq(len(grey))[:, None], np.fft.rfftfreq(len(grey)))
    finer = frequency * 0.1e-3**-1 > 1 / (1.2 * CAMERA_PIXEL)
    assert power[finer].sum() < 0.01 * power.sum()


def test_the_areola_is_darker_than_the_skin_around_it(skin_texture):
    centre = TEXTURE_SIZE_PX // 2
    areola = skin_texture[centre - 50 : centre + 50, centre - 50 : centre + 50].mean()
    assert areola < skin_texture[:300].mean() - 30


def test_the_plate_has_the_tone_of_the_skin(phantom, skin_texture):
    plate = phantom.plate_texture()
    assert plate.dtype == np.uint8
    assert np.abs(plate.mean(axis=(0, 1)) - skin_texture[:300].mean(axis=(0, 1))).max() < 8


def _as_seen_by_the_camera(image: np.ndarray) -> np.ndarray:
    texel = 0.1e-3  # of the 100 mm from nipple to base over half the image
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
    return cv2.resize(
        grey, None, fx=texel / CAMERA_PIXEL, fy=texel / CAMERA_PIXEL, interpolation=cv2.INTER_AREA
    )
