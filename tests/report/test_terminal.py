"""The terminal's summary names what was measured and takes no text for markup."""

import io

from rich.console import Console

from breastscan.report import summary
from tests.run.synthetic_run import METRICS

SETTINGS = {
    "date": "2030-01-02T03:04:05+00:00",
    "command": "breastscan scan --out [bold]x",
    "commit": "0123abc",
    "seed": 7,
    "versions": {"breastscan": "1.2.3"},
}


def printed(metrics, settings=SETTINGS):
    console = Console(file=io.StringIO(), width=120)
    console.print(summary(metrics, settings))
    return console.file.getvalue()


def cells(line):
    return [cell.strip() for cell in line.strip("│").split("│")]


def test_the_summary_shows_quantity_value_unit_bar_and_verdict():
    line = next(line for line in printed(METRICS).splitlines() if "Surface error, RMS" in line)
    assert cells(line) == ["Surface error, RMS", "0.0812", "mm", "≤ 0.5 mm", "✓ holds"]


def test_a_missed_bar_is_said_in_a_word():
    line = next(line for line in printed({"force_peak_n": 9.0}).splitlines() if "highest" in line)
    assert cells(line)[-2:] == ["≤ 8 N", "✗ missed"]


def test_an_estimated_rig_is_held_to_its_own_bar():
    text = printed({"surface_rmse_mm": 0.4}, {"rig": "cell/rig.yaml"})
    assert "≤ 0.3 mm" in text
    assert "✗ missed" in text


def test_the_summary_says_where_its_numbers_come_from():
    text = printed(METRICS)
    for shown in (*map(str, [SETTINGS[key] for key in ("date", "command", "commit")]), "seed: 7"):
        assert shown in text
    assert "version: 1.2.3" in text


def test_what_the_settings_do_not_say_is_left_out():
    assert "commit" not in printed(METRICS, {"seed": 7})


def test_each_group_is_named_once():
    assert printed(METRICS).count("Execution") == 1


def test_names_in_brackets_are_shown_as_they_are():
    assert "gain[bold]x" in printed({"gain[bold]x": 1.0})
