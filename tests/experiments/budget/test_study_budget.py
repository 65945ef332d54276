"""The study from its runs to its page, with scans that only compute."""

import re

import numpy as np
import polars as pl
import pytest

from experiments import study_budget, study_sweep
from experiments.budget import design
from experiments.budget.design import ALL, NONE, SPEC
from experiments.sweep.engine import here
from tests.experiments.budget import stubs

COUNT, SAMPLES = 6, 16


def run(out, monkeypatch, task, samples=SAMPLES):
    monkeypatch.setattr(study_sweep, "scan_run", task)
    spec = design.load(COUNT, samples, out)
    return study_budget.run(spec, out, seed=1, engine=here(2))


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    out = tmp_path_factory.mktemp("budget")
    with pytest.MonkeyPatch.context() as patch:
        return out, run(out, patch, stubs.additive)


def by_source(budget):
    return {c.source: c for c in budget.contributions}


def test_known_parts_are_found(done):
    loop = done[1]["executed_truth_rms_mm"]
    whole = loop.levels[ALL].value ** 2
    assert loop.levels[NONE].value == pytest.approx(stubs.FLOOR_MM)
    for name, one in by_source(loop).items():
        assert one.added.value == pytest.approx(one.saved.value, abs=1e-12)
        if name not in ("breathing", "tissue drag"):
            assert one.added.value == pytest.approx(0.0, abs=1e-12)
    drag = by_source(loop)["tissue drag"]
    assert drag.added.value == pytest.approx(stubs.DRAG_MM**2 / whole)
    assert drag.total.value == 0.0  # the same in every scan
    assert loop.largest("total", 5) == ["breathing"]


def test_the_forces_indices_are_those_of_an_additive_model(done):
    force = by_source(done[1]["force_rmse_n"])
    of_breath, of_stiffness = stubs.BREATH_N**2 / 12, stubs.STIFF_N**2 / 12
    assert force["breathing"].total.value == pytest.approx(
        of_breath / (of_breath + of_stiffness), abs=0.2
    )
    assert force["tissue stiffness"].total.value < 0.2
    assert force["shape"].total.value == 0.0
    assert force["tissue drag"].added.value == pytest.approx(0.0, abs=1e-12)


def test_figure_tables_and_page_are_left(done):
    out, _ = done
    assert (out / "budget.png").stat().st_size > 10_000
    assert (out / "budget.svg").read_text().startswith("<svg")
    page = (out / "budget.html").read_text()
    assert "http" not in re.sub(r'xmlns(:\w+)?="[^"]*"', "", page)
    assert "<svg" in page
    text = (out / "study.md").read_text()
    for source in design.load(None, None, out).sources:
        assert text.count(f"\n| {source} |") == 2
    assert f"{SAMPLES} of {SAMPLES} for Error of the loop" in text
    assert "nan" not in text.lower().replace("nance", "")
    assert "nan" not in page[page.index("</style>") :].lower()
    estimates = pl.read_csv(out / "estimates.csv")
    assert len(estimates) == 2 * (12 * 4 + 3)


def test_the_data_set_is_a_sweeps(done):
    out, _ = done
    frame = pl.read_parquet(out / "budget.parquet")
    assert len(frame) == len(design.load(COUNT, SAMPLES, out).runs(1))
    assert set(frame["breathing"].unique()) == {"ideal", "realistic"}
    assert (out / "report.html").is_file()
    study_sweep.write_page(out / "budget.parquet", out)


def test_failures_are_told_by_cause_and_left_out(tmp_path, monkeypatch):
    found = run(tmp_path, monkeypatch, stubs.fragile)
    frame = pl.read_parquet(tmp_path / "budget.parquet")
    loop = found["executed_truth_rms_mm"]
    assert 0 <= loop.groups < SAMPLES
    assert loop.levels[ALL].n < COUNT
    drag = by_source(loop)["tissue drag"]
    assert drag.added.value > 0
    text = (tmp_path / "study.md").read_text()
    refused = len(frame.filter(pl.col("refused")))
    assert f"| PlanningError: too low | {refused} | {refused} |" in text
    lost = len(frame.filter(pl.col("cause") == "SafetyError: lost"))
    assert f"| SafetyError: lost | {lost} | 0 |" in text
    assert f"{loop.groups} of {SAMPLES}" in text
    errors = study_budget.errors(frame, "executed_truth_rms_mm", {"": list(range(99))})[""]
    assert np.array_equal(np.isnan(errors), frame["error"][:99].is_not_null().to_numpy())


def test_where_nothing_ends_well_the_page_says_so(tmp_path, monkeypatch):
    found = run(tmp_path, monkeypatch, stubs.failing, samples=2)
    assert all(np.isnan(c.added.value) for c in found["force_rmse_n"].contributions)
    text = (tmp_path / "study.md").read_text()
    assert "0 of 2 for Error of the loop" in text
    assert (tmp_path / "budget.png").is_file()


def test_the_same_command_goes_on_where_it_ended(tmp_path, monkeypatch):
    run(tmp_path, monkeypatch, stubs.noting, samples=2)
    ran = (tmp_path / "log.txt").read_text().split()
    assert len(ran) == len(set(ran)) == len(design.load(COUNT, 2, tmp_path).runs(1))
    before = (tmp_path / "study.md").read_text()
    for number in ran[:3]:
        (tmp_path / "runs" / f"{int(number):06}.json").unlink()
    run(tmp_path, monkeypatch, stubs.noting, samples=2)
    again = (tmp_path / "log.txt").read_text().split()
    assert sorted(again[len(ran) :]) == sorted(ran[:3])
    assert (tmp_path / "study.md").read_text() == before


def test_the_guide_names_the_command_and_every_source():
    guide = (SPEC.parents[2] / "docs/budget.md").read_text()
    assert "breastscan study budget" in guide
    for source in design.load(1, 1, SPEC.parent).sources:
        assert f"| {source} |" in guide
