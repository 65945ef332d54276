"""`breastscan study`: sweeps of breasts that no camera sees, which are refused at once."""

import json

import polars
import pytest

from breastscan import cli
from breastscan.commands import study as command
from breastscan.errors import ConfigError

SPEC = {"vary": {"scene.phantom.size": {"values": [7.0, 9.0]}}, "seeds": [0]}


@pytest.fixture
def spec(tmp_path):
    path = tmp_path / "spec.json"
    path.write_text(json.dumps(SPEC))
    return path


def test_a_sweep_leaves_its_table_and_page_and_goes_on_where_it_ended(spec, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = ["study", "sweep", str(spec), "--out", str(out), "--workers", "2"]
    cli.main(arguments)
    frame = polars.read_parquet(out / "sweep.parquet")
    assert frame["scene.phantom.size"].to_list() == [7.0, 9.0]
    assert frame["refused"].to_list() == [True, True]
    assert all("move the phantom" in error for error in frame["error"])
    assert (out / "report.html").is_file()
    record = out / "runs" / "000000.json"
    record.write_text(record.read_text().replace("move the phantom", "kept"))
    (out / "runs" / "000001.json").unlink()
    cli.main(arguments)
    again = polars.read_parquet(out / "sweep.parquet")
    assert ["kept" in error for error in again["error"]] == [True, False]
    (out / "report.html").unlink()
    cli.main(["study", "report", str(out / "sweep.parquet")])
    assert (out / "report.html").is_file()


def test_a_folder_takes_one_sweep(spec, tmp_path):
    command.study("sweep", spec, out=tmp_path / "out", workers=1)
    with pytest.raises(ConfigError, match="another seed"):
        command.study("sweep", spec, out=tmp_path / "out", workers=1, seed=1)
    spec.write_text(json.dumps({**SPEC, "seeds": [1]}))
    with pytest.raises(ConfigError, match="another spec"):
        command.study("sweep", spec, out=tmp_path / "out", workers=1)


@pytest.mark.parametrize(
    ("name", "options", "told"),
    [
        ("sweep", {}, "takes a file"),
        ("report", {}, "takes a file"),
        ("joints", {"count": 3}, "a population's"),
        ("population", {"samples": 3}, "a budget's"),
        ("budget", {"samples": 0}, "samples should be a whole number from 1, got 0"),
        ("budget", {"count": 0}, "count should be a whole number from 1, got 0"),
        ("budget", {"samples": 2000}, "28521 scans were not begun"),
        ("weights", {"workers": 3}, "for many scans"),
        ("population", {"workers": 0}, "1 at least, got 0"),
        ("population", {"workers": 2, "engine": "dask://a:1"}, "brings its own"),
        ("population", {"engine": "ray://a:1"}, "give dask://HOST:PORT"),
        ("population", {"engine": "dask://a"}, "give dask://HOST:PORT"),
        ("population", {"count": 20_000}, "20000 scans were not begun"),
        ("population", {"count": 0}, "from 1"),
        ("sweeps", {}, "sweep"),
    ],
)
def test_what_a_study_has_no_use_for_is_refused(name, options, told, tmp_path):
    with pytest.raises(ConfigError, match=told):
        command.study(name, out=tmp_path, **options)
    assert not list(tmp_path.iterdir())


def test_a_file_for_a_study_that_takes_none_is_refused(spec):
    with pytest.raises(ConfigError, match="takes no file"):
        command.study("weights", spec)
