"""The data set of a sweep: a row a run, every number a column."""

import json
import shlex

import polars
import pytest

from breastscan.errors import ConfigError
from experiments import study_population
from experiments.sweep import table
from experiments.sweep.engine import RECORDS
from experiments.sweep.spec import SweepSpec

SPEC = SweepSpec(vary={"contact.force": {"values": [3, 5]}}, seeds=[0, 1])
WENT = {
    "tracking_mean_abs_mm": [0.1, 0.2, 0.3],
    "joint_speed_peak_rad_s": [1, 2, 3, 4, 5, 6],
    "force_rmse_n": 0.07,
    "stages": {"stereo": 0.5},
    "error": None,
    "cause": None,
    "picture": None,
    "touched": True,
    "refused": False,
    "wall_s": 9.0,
    "cpu_s": 8.0,
}
FAILED = {"error": "SafetyError: no", "cause": "SafetyError", "picture": "000003.png"}


@pytest.fixture
def frame(tmp_path):
    (tmp_path / RECORDS).mkdir()
    for number, record in ((0, WENT), (1, WENT), (3, FAILED)):
        (tmp_path / RECORDS / f"{number:06}.json").write_text(json.dumps(record))
    return table.collected(SPEC.runs(0), tmp_path)


def test_every_number_has_a_column_and_every_record_a_row(frame):
    assert frame["run"].to_list() == [0, 1, 3]
    assert frame["design"].to_list() == [0, 0, 1]
    assert frame["seed"].to_list() == [0, 1, 1]
    assert frame["contact.force"].to_list() == [3, 3, 5]
    assert frame["tracking_mean_abs_mm_z"].to_list() == [0.3, 0.3, None]
    assert frame["joint_speed_peak_rad_s_6"].to_list() == [6, 6, None]
    assert frame["wall_s_stereo"].to_list() == [0.5, 0.5, None]
    assert frame["error"].to_list() == [None, None, "SafetyError: no"]
    assert frame["picture"][2] == f"{RECORDS}/000003.png"
    assert not any(isinstance(kind, polars.List | polars.Struct) for kind in frame.dtypes)


def test_each_row_tells_what_repeats_its_run(frame):
    words = shlex.split(frame["command"][2])
    assert words == ["breastscan", "scan", "--seed=1", "--set=contact.force=5"]


def test_a_file_says_what_it_is(frame, tmp_path):
    table.write(tmp_path / "a.parquet", frame, SPEC, 7)
    again, told = table.read(tmp_path / "a.parquet")
    assert again.equals(frame)
    assert told["varied"] == ["contact.force"]
    assert json.loads(told["spec"])["seeds"] == [0, 1]
    assert json.loads(told["seed"]) == 7


def test_other_files_are_refused(tmp_path):
    polars.DataFrame({"a": [1]}).write_parquet(tmp_path / "other.parquet")
    with pytest.raises(ConfigError, match="no data set of a sweep"):
        table.read(tmp_path / "other.parquet")
    (tmp_path / "text.parquet").write_text("a")
    for name in ("text.parquet", "missing.parquet"):
        with pytest.raises(ConfigError, match="no Parquet file"):
            table.read(tmp_path / name)


WELL = {
    "error": None,
    "cause": None,
    "contact_fraction": 1.0,
    "force_min_n": 4.5,
    "force_peak_n": 5.5,
    "force_any_peak_n": 6.0,
    "clearance_body_min_mm": 5.0,
    "surface_density": 0.96,
    "executed_truth_rms_mm": 1.4,
}


@pytest.mark.parametrize(
    ("changed", "cause"),
    [
        ({}, None),
        ({"force_min_n": 3.9}, "Missed: force_min_n"),
        ({"force_any_peak_n": 8.1, "force_peak_n": 6.1}, "Missed: force_peak_n, force_any_peak_n"),
        ({"contact_fraction": 0.999}, "Missed: contact_fraction"),
        ({"clearance_body_min_mm": -0.1}, "Missed: clearance_body_min_mm"),
        ({"surface_density": 0.94}, "Missed: surface_density"),
        ({"executed_truth_rms_mm": 1.6}, "Missed: executed_truth_rms_mm"),
        ({"executed_truth_rms_mm": None}, "Missed: executed_truth_rms_mm"),
        ({"error": "PlanningError: no", "cause": "PlanningError"}, "PlanningError"),
    ],
)
def test_a_scan_of_a_population_goes_well_only_if_nothing_is_missed(changed, cause):
    schema = {
        name: polars.String if name in ("error", "cause") else polars.Float64 for name in WELL
    }
    judged = study_population.judged(polars.DataFrame([{**WELL, **changed}], schema=schema))
    assert judged["success"].to_list() == [cause is None]
    assert judged["cause"].to_list() == [cause]


def test_what_was_never_measured_is_missed():
    judged = study_population.judged(polars.DataFrame({"error": [None], "cause": [None]}))
    assert judged["success"].to_list() == [False]
    assert judged["cause"][0].startswith("Missed: contact_fraction, force_min_n")


def test_the_tables_of_a_population_count_what_was_judged():
    rows = [
        {**WELL, "touched": True, "refused": False},
        {**WELL, "touched": True, "refused": False, "executed_truth_rms_mm": 2.5},
        {**WELL, "touched": False, "refused": True, "error": "PlanningError: no", "cause": "A"},
        {**WELL, "touched": True, "refused": False, "error": "SafetyError: no", "cause": "B"},
    ]
    schema = {
        name: polars.String if name in ("error", "cause") else polars.Float64 for name in WELL
    }
    schema |= {"touched": polars.Boolean, "refused": polars.Boolean}
    told = study_population.tables(study_population.judged(polars.DataFrame(rows, schema=schema)))
    assert "| success | 1 | 25.0 % (4.6 … 69.9 %) |" in told  # Wilson's interval of 1 in 4
    assert "| refused before contact | 1 |" in told
    assert "| failed | 2 |" in told
    assert "| A | 1 | 1 |" in told
    assert "| Missed: executed_truth_rms_mm | 1 | 0 |" in told
    assert "| `executed_truth_rms_mm` | 3 | 1.4 |" in told
