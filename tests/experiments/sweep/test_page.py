"""The page of a sweep opens whatever the runs did, and its numbers are those of the data set."""

import cv2
import numpy as np
import polars as pl
import pytest

from breastscan.report.catalogue import number
from experiments.sweep import figures, page, statistics
from experiments.sweep.page import Meta
from experiments.sweep.statistics import percent
from tests.chromium import Page
from tests.experiments.sweep.synthetic_sweep import CAUSES, VARIED, data_set
from tests.page_reader import read

SIZE_LIMIT_BYTES = 8_000_000
SECTIONS = [
    "Metrics",
    "Main effects",
    "Runs over the settings",
    "Parallel axes",
    "Failures",
    "Specification",
]


@pytest.fixture(autouse=True)
def few_resamples(monkeypatch):
    monkeypatch.setattr(statistics, "RESAMPLES", 99)


def write(frame, folder, varied=VARIED):
    meta = Meta(
        title="Sweep <of> breasts",
        varied=tuple(varied),
        version="0.1.0",
        commit="0123abc",
        spec="vary:\n  cell: <any>",
        pictures=folder,
    )
    page.write(frame, meta, folder)
    return folder / "report.html"


@pytest.fixture(scope="module")
def sweep():
    return data_set(80)


@pytest.fixture(scope="module")
def written(sweep, tmp_path_factory):
    folder = tmp_path_factory.mktemp("sweep")
    (folder / "pictures").mkdir()
    for name in CAUSES:
        image = np.full((30, 40, 3), 90, np.uint8)
        cv2.imwrite(str(folder / "pictures" / f"{name}.png"), image)
    return write(sweep, folder)


@pytest.fixture(scope="module")
def reader(written):
    return read(written)


def test_the_page_has_every_section_and_refers_to_nothing_outside_itself(reader):
    assert reader.headings == SECTIONS
    assert all(reference.startswith(("data:", "#")) for reference in reader.references)


def test_the_headline_counts_the_runs(reader, sweep):
    n, succeeded = len(sweep), sweep["error"].null_count()
    refused = sweep["refused"].sum()
    assert f"success: {succeeded} of {n}" in reader.text
    for count in (succeeded, refused, n - succeeded - refused):
        assert any(percent(count, n) in text for text in reader.text)


@pytest.mark.parametrize("column", ["executed_truth_rms_mm", "force_any_peak_n"])
def test_a_median_and_what_95_percent_of_the_runs_keep_are_those_of_the_data_set(
    reader, sweep, column
):
    values = sweep[column].drop_nulls()
    assert number(values.median()) in reader.text
    unit = column.rsplit("_", 1)[1].replace("n", "N")
    p95 = number(values.quantile(0.95, "linear"))
    assert any(f"95 %: ≤ {p95} {unit}" in text for text in reader.text)


def test_every_metric_has_a_row_with_its_count_mean_and_deviation(reader, sweep):
    text = "|".join(part for part in reader.text if part.strip())
    for key, label, scale in (
        ("force_rmse_n", "Contact force about the set-point, RMS [N]", 1),
        ("surface_density", "Skin that has a reconstructed point [%]", 100),
        ("wall_s_plan", "Wall time, plan [s]", 1),
        ("joint_speed_peak_rad_s_6", "Peak joint speed, 6 [°/s]", np.degrees(1)),
    ):
        values = sweep[key].drop_nulls() * scale
        row = text.split(f"{label}|")[1].split("|")
        assert row[:2] == [str(len(values)), number(values.mean())]
        assert row[3] == number(values.std())


def test_runs_that_keep_a_bar_are_counted(reader, sweep):
    values = sweep["executed_truth_rms_mm"].drop_nulls()
    kept = int((values <= 1.5).sum())
    share = f"{100 * kept / len(values):.1f} % ({percent(kept, len(values))})"
    assert share in reader.text


def test_every_cause_has_its_count_a_picture_the_error_and_the_command(reader, sweep):
    counts = sweep["cause"].drop_nulls().value_counts()
    assert [image["alt"] for image in reader.images] != []
    assert len(reader.images) == len(counts)
    for cause, count in counts.rows():
        first = sweep.filter(pl.col("cause") == cause).row(0, named=True)
        assert percent(count, len(sweep)) in reader.text
        assert first["error"] in "".join(reader.text)
        assert first["command"] in reader.text


def test_texts_of_the_data_set_are_escaped(written):
    text = written.read_text(encoding="utf-8")
    assert "<script>on a plate" not in text
    assert "<of>" not in text
    assert "<any>" not in text


def test_the_parallel_axes_are_drawn_without_a_network(written, tmp_path):
    with Page(written.as_uri(), tmp_path, 1200, 900) as view:
        count = "document.querySelectorAll('#parallel .y-axis').length"
        drawn = f"new Promise(done => setInterval(() => {count} && done({count}), 100))"
        shown = view.send("Runtime.evaluate", expression=drawn, awaitPromise=True)
    assert shown["result"]["value"] == figures.MAX_AXES


@pytest.mark.parametrize(
    ("frame", "varied", "lacking"),
    [
        pytest.param(data_set(1, failed=0), VARIED, {*SECTIONS[2:4]}, id="one run"),
        pytest.param(data_set(2, failed=1), VARIED, set(), id="two runs"),
        pytest.param(data_set(12, failed=1), VARIED, set(), id="all failed"),
        pytest.param(data_set(12, failed=0), VARIED, set(), id="none failed"),
        pytest.param(data_set(24, repeats=6), VARIED, set(), id="repeated"),
        pytest.param(data_set(12, varied=VARIED[:1]), VARIED[:1], set(), id="one number"),
        pytest.param(data_set(12, varied=VARIED[3:4]), VARIED[3:4], {SECTIONS[2]}, id="words"),
        pytest.param(data_set(12, varied=()), (), {SECTIONS[2]}, id="nothing varied"),
    ],
)
def test_the_page_opens_whatever_the_runs_did(frame, varied, lacking, tmp_path):
    found = read(write(frame, tmp_path, varied))
    assert set(SECTIONS) - set(found.headings) == lacking


def test_a_data_set_without_any_metric_is_still_reported(tmp_path):
    frame = pl.DataFrame({"run": [0, 1], "design": [0, 1], "error": None, "refused": None})
    assert "success: 2 of 2" in read(write(frame, tmp_path, ())).text


def test_a_failure_without_cause_picture_or_command_is_named_by_its_error(tmp_path):
    frame = data_set(6, failed=1).drop("cause", "picture", "command", "touched")
    text = read(write(frame, tmp_path)).text
    assert any(part in ("SafetyError", "NoBreastError", "PlanningError") for part in text)


def test_a_failure_that_raised_nothing_is_told(tmp_path):
    frame = data_set(3, failed=0).with_columns(pl.Series("success", [True, True, False]))
    assert "no cause given" in read(write(frame, tmp_path)).text


def test_of_many_runs_some_are_drawn_and_the_page_stays_small(tmp_path):
    path = write(data_set(10_000, varied=VARIED[:2]), tmp_path, VARIED[:2])
    assert path.stat().st_size < SIZE_LIMIT_BYTES
    drawn = "Of the 10,000 runs 2,000 are drawn"
    assert any(drawn in text for text in read(path).text)


def test_a_sweep_is_drawn_alike_every_time(sweep):
    assert figures.sample(sweep).equals(sweep)
    many = data_set(figures.MAX_POINTS + 1)
    assert figures.sample(many).equals(figures.sample(many))
    assert len(figures.sample(many)) == figures.MAX_POINTS
