"""The page is whole, stands alone, escapes what it shows, and says what a broken folder lacks."""

import json
import re
import shutil
from importlib.resources import files

import numpy as np
import pytest

from breastscan.errors import ConfigError
from breastscan.report import write
from breastscan.report.theme import CSS_VARIABLES
from breastscan.run.reading import REQUIRED_FILES
from breastscan.run.skin_map import MAP_FILE, SkinMap
from tests.page_reader import read
from tests.run.synthetic_run import write_run

SIZE_LIMIT_BYTES = 6_000_000


@pytest.fixture(scope="module")
def page(run_folder):
    return write(run_folder)


def test_the_page_has_every_section(page):
    headings = ["Summary", "Perception", "Path", "Joints", "Contact", "Time", "Settings"]
    assert read(page).headings == headings


def test_an_examination_has_a_map_of_the_skin_it_touched(run_folder, tmp_path):
    folder = shutil.copytree(run_folder, tmp_path / "run")
    points_B = np.random.default_rng(1).normal([0.5, 0.0, 0.1], 0.03, (60, 3))
    skin = SkinMap(points_B=points_B, strokes=np.arange(60) % 3, wanted=np.arange(60) > 9)
    skin.save(folder / MAP_FILE)
    assert "Coverage" in read(write(folder)).headings
    (folder / MAP_FILE).write_bytes(b"ply")
    with pytest.raises(ConfigError, match=MAP_FILE):
        write(folder)


def test_the_page_is_the_only_file_written_and_is_small(page, run_folder):
    assert {path.name for path in run_folder.iterdir()} == {*REQUIRED_FILES, "report.html"}
    assert page.stat().st_size < SIZE_LIMIT_BYTES


def test_the_page_refers_to_nothing_outside_itself(page):
    assert all(reference.startswith(("data:", "#")) for reference in read(page).references)
    assert "@import" not in page.read_text(encoding="utf-8").split("</style>")[0]


def test_the_3d_view_offers_no_upload(page):
    call = page.read_text(encoding="utf-8").rsplit("Plotly.newPlot(", 1)[1]
    assert "showSendToCloud: false" in call
    assert 'plotlyServerURL: ""' in call


def test_every_picture_has_a_description(page):
    images = read(page).images
    assert len(images) == 3
    assert all(image["alt"] for image in images)


def test_the_page_shows_metrics_settings_and_the_papers_figures(page):
    text = read(page).text
    for shown in (
        "0.0812",
        "scan.feedrate.speed",
        "versions.mujoco",
        "0.79",
        "0.49",
        "0.89",
        "1.04",
    ):
        assert shown in text


def test_the_page_shows_each_value_beside_its_bar_and_the_verdict_in_a_word(page):
    text = " ".join(read(page).text)
    assert "≤ 0.5 mm" in text
    assert "✓ holds" in text


def test_the_page_says_where_its_numbers_come_from(tmp_path):
    folder = write_run(tmp_path)
    settings = {"date": "2030-01-02", "command": "breastscan scan --x", "commit": "0123abc"}
    (folder / "config.json").write_text(json.dumps(settings))
    text = read(write(folder)).text
    assert all(value in text for value in settings.values())
    assert "seed" not in text


def test_a_missed_bar_is_said_in_a_word(tmp_path):
    folder = write_run(tmp_path)
    (folder / "metrics.json").write_text('{"force_rmse_n": 0.7}')
    assert "✗ missed" in read(write(folder)).text


def test_the_film_is_shown_where_there_is_one(tmp_path):
    folder = write_run(tmp_path)
    (folder / "scan.mp4").write_bytes(b"")
    assert "scan.mp4" in read(write(folder)).references


def test_text_from_the_folder_is_escaped(tmp_path):
    folder = write_run(tmp_path)
    hostile = "</td><script>alert(1)</script>"
    (folder / "metrics.json").write_text(json.dumps({hostile: hostile, "wall_s": {hostile: 1.0}}))
    (folder / "config.json").write_text(json.dumps({hostile: hostile}))
    page = write(folder).read_text(encoding="utf-8")
    assert "<script>alert" not in page
    assert page.count("&lt;script&gt;alert") >= 5


def test_a_scan_that_ended_before_its_loop_is_still_reported(tmp_path):
    reader = read(write(write_run(tmp_path, with_loop=False, with_truth=False)))
    assert "Path" not in reader.headings
    assert "Contact" in reader.headings


def test_a_run_without_any_metric_is_still_reported(tmp_path):
    folder = write_run(tmp_path)
    (folder / "metrics.json").write_text("{}")
    assert "Time" not in read(write(folder)).headings


@pytest.mark.parametrize("name", REQUIRED_FILES)
def test_a_missing_file_is_named_with_its_cure(tmp_path, name):
    folder = write_run(tmp_path)
    (folder / name).unlink()
    with pytest.raises(ConfigError, match=rf"lacks {re.escape(name)}: .*breastscan scan --out"):
        write(folder)


@pytest.mark.parametrize("name", REQUIRED_FILES)
def test_a_damaged_file_is_named(tmp_path, name):
    folder = write_run(tmp_path)
    (folder / name).write_bytes(b"not what it says")
    with pytest.raises(ConfigError, match=re.escape(name)):
        write(folder)


def test_a_folder_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(ConfigError, match="nowhere"):
        write(tmp_path / "nowhere")


@pytest.mark.parametrize("variable", CSS_VARIABLES.values())
def test_every_colour_of_the_figures_is_defined_for_light_dark_and_print(variable):
    style = files("breastscan.report").joinpath("page.css").read_text(encoding="utf-8")
    assert style.count(f"{variable}: #") == 3


def test_settings_that_do_not_say_the_set_point_make_a_page_without_it(tmp_path):
    folder = write_run(tmp_path)
    (folder / "config.json").write_text('{"seed": 1}')
    assert "Contact" in read(write(folder)).headings
