"""One run of a sweep, and what is told of one that ends early."""

import cv2

from breastscan.errors import SafetyError
from experiments.sweep.scan_run import _told, scan_run
from experiments.sweep.spec import Run


def run(settings):
    return Run(4, 4, 0, settings, settings)


def test_a_world_that_cannot_be_is_refused_with_its_reason(tmp_path):
    record = scan_run(run({"scene.phantom.size": 9.0}), tmp_path)
    assert record["error"].startswith("ConfigError: the left camera sees")
    assert record["cause"] == (
        "ConfigError: the left camera sees # % of the breast's half-height loop, and a scan needs "
        "all of it"
    )
    assert (record["touched"], record["refused"], record["picture"]) == (False, True, None)


def test_a_breast_that_cannot_be_reached_is_pictured_as_it_was_seen(tmp_path):
    record = scan_run(run({"planning.joints.floor": 0.9}), tmp_path)
    assert record["error"].startswith("PlanningError: ")
    assert (record["touched"], record["refused"]) == (False, True)
    assert record["stages"]["stereo"] > 0
    assert cv2.imread(str(tmp_path / record["picture"])).shape == (360, 480, 3)


def test_the_kind_of_a_failure_is_what_the_twin_knows_of_it():
    error = SafetyError("the force jumped from 1.5 to 21.2 N, in which it came by .03 mm: look")
    assert _told(error)["cause"] == (
        "SafetyError: the force jumped from # to # N, in which it came by # mm"
    )
    error.add_note("In the twin, the probe's body touched the chest plate, first at 12.814 s")
    told = _told(error)
    assert told["cause"] == "SafetyError: the probe's body touched the chest plate"
    assert told["error"].endswith(": look. " + error.__notes__[0])
    assert _told(ZeroDivisionError("by 0"))["cause"] == "ZeroDivisionError (a bug): by #"
