"""Which scans a budget is made of: one factor at a time, everything else the same."""

import json
from dataclasses import replace

import numpy as np
import pytest

from breastscan.errors import ConfigError
from breastscan.settings import names
from breastscan.vision.camera import StereoRig
from experiments.budget import design
from experiments.budget.design import (
    ALL,
    FIRST,
    IDEAL,
    NONE,
    REALISTIC,
    SECOND,
    TRUE_RIG,
    all_but,
    alone,
    exchanged,
)
from experiments.budget.rigs import composed
from experiments.sweep.spec import RunConfig
from sim.cameras.camera_errors import CAMERA_CLASSES

COUNT, SAMPLES = 5, 8
TIED = "all, of one cell"


@pytest.fixture(scope="module")
def spec(tmp_path_factory):
    return design.load(COUNT, SAMPLES, tmp_path_factory.mktemp("budget"))


@pytest.fixture(scope="module")
def scans(spec):
    return spec.scans(3)


def settings(scans, name):
    return [scans.runs[number].settings for number in scans.sets[name]]


def own_settings(spec, source):
    """Names of what a source sets."""
    found = {*spec.sources[source].realistic, *spec.sources[source].ideal}
    return {"rig" if name.startswith("rig.") else name for name in found}


def test_the_twelve_sources_are_there(spec):
    assert list(spec.sources) == [
        "intrinsics", "extrinsics", "image noise", "disparity", "hand-eye", "kinematics",
        "servo lag", "wrist sensor", "tissue stiffness", "tissue drag", "breathing", "shape",
    ]  # fmt: skip


def test_every_scan_has_settings_that_there_are(spec, scans):
    """And every one of them is taken: a source with a mistyped name would be nothing."""
    scans.write_rigs()
    known = set(names(RunConfig()))
    for run in scans.runs:
        assert set(run.settings) <= known
        run.config()


def test_each_set_changes_its_source_and_nothing_else(spec, scans):
    for source in spec.sources:
        own = own_settings(spec, source)
        (nothing,) = settings(scans, NONE)
        pairs = [(nothing, one) for one in settings(scans, alone(source))]
        pairs += zip(settings(scans, ALL), settings(scans, all_but(source)), strict=True)
        pairs += zip(settings(scans, FIRST), settings(scans, exchanged(source)), strict=True)
        for one, other in pairs:
            both = set(one) | set(other)
            assert {name for name in both if one.get(name) != other.get(name)} <= own
        for one, other in pairs[: 2 * COUNT]:
            assert one != other


def test_rows_have_their_draws_in_common(spec, scans):
    assert scans.sets[ALL] == scans.sets[FIRST][:COUNT]
    for source in spec.sources:
        own = own_settings(spec, source) - {"rig"}
        for name, partner in ((alone(source), ALL), (exchanged(source), SECOND)):
            for one, other in zip(settings(scans, name), settings(scans, partner), strict=True):
                assert {n: one[n] for n in own} == {n: other[n] for n in own}


def test_the_columns_say_which_sources_are_realistic(spec, scans):
    for source in spec.sources:
        for name, others in ((alone(source), IDEAL), (all_but(source), REALISTIC)):
            own = {IDEAL: REALISTIC, REALISTIC: IDEAL}[others]
            for number in scans.sets[name]:
                told = scans.runs[number].varied
                assert told[source] == own
                assert {told[other] for other in spec.sources if other != source} == {others}


def test_one_calibration_gives_its_four_draws_together(spec, scans):
    seen = []
    for one in settings(scans, TIED):
        intrinsics, extrinsics, hand_eye = scans.rigs[one["rig"]]
        assert intrinsics == extrinsics == hand_eye
        assert intrinsics.stem == str(one["scene.arm.seed"])
        seen.append(intrinsics.stem)
    assert len(set(seen)) > 1
    assert any(len(set(parts)) > 1 for parts in scans.rigs.values())


def test_no_scan_is_done_twice(spec, scans):
    told = [json.dumps(run.settings, sort_keys=True) for run in scans.runs]
    assert len(set(told)) == len(told) < spec.size
    assert len(scans.sets[NONE]) == 1
    assert spec.size == 1 + COUNT * (2 * 12 + 1 + 1) + SAMPLES * (12 + 2)
    assert len(set(scans.sets[alone("servo lag")])) == 2  # its transport has two values
    assert sorted({n for numbers in scans.sets.values() for n in numbers}) == [
        run.number for run in scans.runs
    ]


def test_the_whole_takes_three_hours_at_most(tmp_path):
    """At 7 s a scan on two cores."""
    assert 7 * len(design.load(None, None, tmp_path).runs(0)) < 3 * 3600


def test_draws_are_repeatable_and_the_seeds_own(spec):
    assert spec.runs(3) == spec.runs(3)
    assert spec.runs(3) != spec.runs(4)


def test_more_pairs_than_groups_are_possible(spec):
    scans = replace(spec, count=9, samples=4).scans(0)
    assert (len(scans.sets[ALL]), len(scans.sets[FIRST])) == (9, 4)


def test_ideal_is_without_error(spec):
    """Of what the settings themselves can say."""
    (nothing,) = settings(spec.scans(0), NONE)
    assert "rig" not in nothing
    assert nothing["scene.camera.quality"] == "ideal"
    assert vars(CAMERA_CLASSES["ideal"])["read_noise"] == 0.0
    assert nothing["scene.breathing.amplitude"] == 0.0
    assert nothing["scene.servo.lag"] is False


def test_rigs_are_written_where_the_scans_look(spec, scans):
    scans.write_rigs()
    for run in scans.runs:
        if "rig" in run.settings:
            parts = composed(TRUE_RIG, *scans.rigs[run.settings["rig"]])
            found = StereoRig.load(run.settings["rig"])
            np.testing.assert_allclose(found.X_BL, parts.X_BL, atol=1e-12)
            np.testing.assert_allclose(found.left.K, parts.left.K)


def test_a_folder_that_cannot_be_is_told(tmp_path):
    (tmp_path / "rigs").write_text("a file")
    with pytest.raises(ConfigError, match="choose another --out"):
        design.load(1, 1, tmp_path).scans(0).write_rigs()
