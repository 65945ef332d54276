"""A map of touched skin comes back as it was written, and other tools read it."""

import numpy as np
import pytest
import trimesh

from breastscan.run.skin_map import MAP_FILE, SkinMap

POINTS_B = np.random.default_rng(3).normal([0.5, 0.0, 0.1], 0.03, (40, 3))
STROKES = np.arange(40) % 4
WANTED = np.arange(40) % 5 > 0


@pytest.fixture
def written(tmp_path):
    skin = SkinMap(points_B=POINTS_B, strokes=STROKES, wanted=WANTED)
    skin.save(tmp_path / MAP_FILE)
    return tmp_path / MAP_FILE


def test_a_map_comes_back_as_it_was_written(written):
    skin = SkinMap.load(written)
    np.testing.assert_allclose(skin.points_B, POINTS_B, atol=1e-7)
    np.testing.assert_array_equal(skin.strokes, STROKES)
    np.testing.assert_array_equal(skin.wanted, WANTED)


def test_every_point_is_of_one_kind(written):
    parts = SkinMap.load(written).parts
    np.testing.assert_array_equal(np.sum(list(parts.values()), axis=0), 1)


def test_other_tools_see_points_colours_and_strokes(written):
    cloud = trimesh.load(written, process=False)
    np.testing.assert_allclose(cloud.vertices, POINTS_B, atol=1e-7)
    assert cloud.metadata["_ply_raw"]["vertex"]["data"]["strokes"].ravel().tolist() == list(STROKES)
    missed = WANTED & (STROKES == 0)
    assert (cloud.colors[missed][:, :3] == [0xD5, 0x5E, 0x00]).all()
    assert not (cloud.colors[~missed][:, :3] == [0xD5, 0x5E, 0x00]).all(axis=1).any()


def test_a_cloud_that_is_no_map_is_refused(tmp_path):
    bare = trimesh.PointCloud(POINTS_B)
    (tmp_path / "bare.ply").write_bytes(bare.export(file_type="ply"))
    with pytest.raises(ValueError, match="no property 'strokes'"):
        SkinMap.load(tmp_path / "bare.ply")
