"""One run of a sweep, and what is told of one that ends early."""

import cv2

from experiments.sweep.scan_run import scan_run
from experiments.sweep.spec import Run


def run(settings):
    return Run(4, 4, 0, settings, settings)


def test_a_world_that_cannot_be_is_refused_with_its_reason(tmp_path):
    record = scan_run(run({"scene.phantom.size": 9.0}), tmp_path)
    assert record["error"].startswith("ConfigError: the left camera sees")
    assert (
        record["cause"] == "ConfigError: the left camera sees # % of the breast's half-height loop"
    )
    assert (record["touched"], record["refused"], record["picture"]) == (False, True, None)


def test_a_breast_that_cannot_be_reached_is_pictured_as_it_was_seen(tmp_path):
    record = scan_run(run({"planning.joints.floor": 0.9}), tmp_path)
    assert record["error"].startswith("PlanningError: ")
    assert (record["touched"], record["refused"]) == (False, True)
    assert record["stages"]["stereo"] > 0
    assert cv2.imread(str(tmp_path / record["picture"])).shape == (360, 480, 3)
