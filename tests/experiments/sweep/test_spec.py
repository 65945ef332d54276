"""What a sweep's file asks for, and what it cannot."""

import numpy as np
import pytest
import scipy.stats
import yaml

from breastscan.errors import ConfigError
from experiments import study_population
from experiments.sweep.spec import LISTED, SweepSpec, load, parsed

YOUNG, FORCE, BREAST = "scene.phantom.young", "contact.force", "scene.phantom.breast"
SEED = "scene.arm.seed"


def test_a_grid_has_every_combination_under_every_seed():
    spec = SweepSpec(
        vary={FORCE: {"values": [3, 5]}, YOUNG: {"range": [20e3, 40e3, 3]}},
        settings={BREAST: "dense"},
        seeds=[4, 7],
    )
    runs = spec.runs(0)
    assert len(runs) == spec.size == 12
    assert [run.number for run in runs] == list(range(12))
    told = {(run.varied[FORCE], run.varied[YOUNG], run.seed) for run in runs}
    assert told == {(f, e, s) for f in (3, 5) for e in (20e3, 30e3, 40e3) for s in (4, 7)}
    config = runs[-1].config()
    assert (config.contact.force, config.scene.phantom.young) == (5.0, 40e3)
    assert config.scene.phantom.breast == "dense"


@pytest.mark.parametrize("design", ["lhs", "sobol"])
def test_what_is_drawn_has_the_distribution_that_was_asked_for(design):
    count = 512
    spec = SweepSpec(
        design=design,
        count=count,
        vary={
            "safety.force": {"uniform": [9.0, 12.0]},
            YOUNG: {"log": [10e3, 40e3]},
            FORCE: {"normal": [5.0, 0.5]},
            SEED: {"integer": [3, 7]},
            BREAST: {"choice": ["standard", "dense", "fatty", "scattered"]},
        },
    )
    runs = spec.runs(3)
    assert len(runs) == spec.size == count
    columns = {name: [run.varied[name] for run in runs] for name in spec.vary}
    for name, law in {
        "safety.force": scipy.stats.uniform(9, 3),
        YOUNG: scipy.stats.loguniform(10e3, 40e3),
        FORCE: scipy.stats.norm(5.0, 0.5),
    }.items():
        distance = scipy.stats.kstest(columns[name], law.cdf).statistic
        assert distance < 0.01  # drawn independently: .04 in the middle of cases
    _, counts = np.unique(columns[BREAST], return_counts=True)
    assert np.ptp(counts) <= 2
    numbers, counts = np.unique(columns[SEED], return_counts=True)
    assert (numbers.tolist(), np.ptp(counts) <= 2) == ([3, 4, 5, 6], True)
    assert spec.runs(3) == runs
    assert spec.runs(4) != runs
    assert len({run.seed for run in runs}) == count


def test_settings_that_belong_together_change_together():
    together = [{"scene.arm.seed": 1, "rig": "a.yaml"}, {"scene.arm.seed": 2, "rig": "b.yaml"}]
    runs = SweepSpec(vary={"cell": {"values": together}}, repetitions=2).runs(0)
    assert [run.varied["cell"] for run in runs] == ["0", "0", "1", "1"]
    assert [run.config().scene.arm.seed for run in runs] == [1, 1, 2, 2]
    assert str(runs[-1].config().rig) == "b.yaml"
    assert len({run.seed for run in runs}) == 4


def test_a_range_of_whole_numbers_gives_whole_numbers():
    assert LISTED["range"]([8, 64, 8]) == [8, 16, 24, 32, 40, 48, 56, 64]
    assert LISTED["range"]([0, 1, 3]) == [0.0, 0.5, 1.0]


def test_files_lie_beside_the_file_that_names_them(tmp_path):
    (tmp_path / "a.yaml").write_text("")
    spec = tmp_path / "spec.yaml"
    spec.write_text(yaml.dump({"settings": {"rig": "a.yaml"}, "vary": {FORCE: {"values": [3]}}}))
    assert load(spec).settings == {"rig": str(tmp_path / "a.yaml")}


def test_the_population_is_as_large_as_it_is_asked_for_and_every_breast_has_its_cell():
    spec = study_population.spec(40)
    runs = spec.runs(0)
    assert len(runs) == 40
    assert {run.varied["cell"] for run in runs} == set("0123456789")
    assert {run.varied[BREAST] for run in runs} == {
        "standard", "dense", "heterogeneous", "scattered", "fatty",
    }  # fmt: skip
    for run in runs:
        config = run.config()
        assert config.rig.is_file()
        assert str(config.scene.arm.seed) == run.varied["cell"]


def test_breasts_with_layers_are_the_population_with_a_gland_and_a_skin():
    population = study_population.spec(None)
    spec = load(study_population.SPEC.with_name("layers.yaml"))
    layers = {name: kinds for name, kinds in spec.vary.items() if name not in population.vary}
    assert set(layers) == {
        "scene.phantom.layers.gland_fraction", "scene.phantom.layers.skin_ratio",
    }  # fmt: skip
    assert {**population.vary, **layers} == spec.vary
    assert spec.settings == population.settings
    for run in spec.runs(0):
        assert 7.0 <= run.config().scene.phantom.layers.skin_ratio <= 69.0


def test_breasts_that_are_examined_are_the_population():
    population = study_population.spec(None)
    spec = load(study_population.SPEC.with_name("examination.yaml"))
    assert spec.vary == population.vary
    assert spec.settings == {"planning.pattern.kind": "loops", **population.settings}
    assert all(run.config().planning.pattern.kind == "loops" for run in spec.runs(0))


REFUSED = {
    "unknown setting": ({"vary": {"contact.forse": {"values": [3]}}}, "did you mean contact.force"),
    "unknown fixed": (
        {"vary": {FORCE: {"values": [3]}}, "settings": {"phantom.young": 3e4}},
        "did you mean scene.phantom.young",
    ),
    "empty": ({"vary": {FORCE: {"values": []}}}, "varies over nothing"),
    "empty range": (
        {"vary": {FORCE: {"uniform": [5, 3]}}, "design": "lhs", "count": 3},
        r"uniform takes \[low, high\], low < high, got \[5, 3\]",
    ),
    "no steps": ({"vary": {FORCE: {"range": [3, 5, 0]}}}, "how many"),
    "log from nought": (
        {"vary": {FORCE: {"log": [0, 3]}}, "design": "lhs", "count": 3}, "0 < low < high",
    ),
    "halves of a whole number": (
        {"vary": {SEED: {"integer": [0, 2.5]}}, "design": "lhs", "count": 3}, "of whole numbers",
    ),
    "drawn in a grid": ({"vary": {FORCE: {"uniform": [3, 5]}}}, "choose design: lhs or sobol"),
    "grid when drawn": (
        {"vary": {FORCE: {"values": [3, 5]}}, "design": "sobol", "count": 4},
        "choose design: grid",
    ),
    "unknown kind": ({"vary": {FORCE: {"gauss": [3, 5]}}}, "'gauss', unknown"),
    "unknown design": ({"vary": {FORCE: {"values": [3]}}, "design": "random"}, "grid, lhs, sobol"),
    "no count": ({"vary": {FORCE: {"uniform": [3, 5]}}, "design": "lhs"}, "takes the count"),
    "count of a grid": ({"vary": {FORCE: {"values": [3]}}, "count": 3}, "as many points as it has"),
    "count of none": (
        {"vary": {FORCE: {"uniform": [3, 5]}}, "design": "lhs", "count": 0}, "from 1",
    ),
    "seeds and repetitions": (
        {"vary": {FORCE: {"values": [3]}}, "seeds": [1], "repetitions": 2}, "not both",
    ),
    "seeds below": ({"vary": {FORCE: {"values": [3]}}, "seeds": [-1]}, "whole numbers from 0"),
    "twice": (
        {"vary": {FORCE: {"values": [3]}}, "settings": {FORCE: 3}}, "both fixed and varied",
    ),
    "several kinds": (
        {"vary": {FORCE: {"values": [3], "range": [1, 2, 2]}}}, "takes one kind",
    ),
    "no kind": ({"vary": {FORCE: [3, 5]}}, "takes one kind"),
    "word": ({"vary": {FORCE: {"values": ["much"]}}}, "contact.force should be a number"),
    "something else": ({"vary": {FORCE: {"values": [3]}}, "colour": 3}, "hold vary and any of"),
    "nothing varied": ({"settings": {FORCE: 3}}, "hold vary"),
}  # fmt: skip


@pytest.mark.parametrize(("content", "told"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_is_refused_with_what_was_expected(content, told):
    with pytest.raises(ConfigError, match=told):
        parsed(content, "spec.yaml").runs(0)


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [("spec.txt", "", "ends in"), ("spec.yaml", "- a", "by name"), ("spec.yaml", "a: [", "is no")],
)
def test_files_that_hold_no_sweep_are_refused(tmp_path, name, text, told):
    (tmp_path / name).write_text(text)
    with pytest.raises(ConfigError, match=told):
        load(tmp_path / name)
    with pytest.raises(ConfigError, match="cannot read"):
        load(tmp_path / "missing.yaml")
