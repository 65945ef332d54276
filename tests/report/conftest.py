"""One synthetic run, written once for all tests of the report that only read it."""

import pytest

from breastscan.run.reading import Run
from tests.report.synthetic_run import write_run


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory):
    return write_run(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="session")
def run(run_folder):
    return Run.load(run_folder)
