"""What a user meets at the prompt: help, errors that help, exit status."""

import pytest

from breastscan import cli
from breastscan.errors import PlanningError


def run(capsys, *arguments):
    with pytest.raises(SystemExit) as caught:
        cli.main(list(arguments))
    captured = capsys.readouterr()
    return caught.value.code, captured.out, captured.err


def test_help_lists_every_command(capsys):
    status, out, _ = run(capsys, "--help")
    assert status == 0
    assert all(name in out for name in cli.COMMANDS)


def test_no_command_prints_the_help_and_fails(capsys):
    status, out, _ = run(capsys)
    assert status == 2
    assert "usage" in out


def test_an_unknown_command_names_those_that_exist(capsys):
    status, _, err = run(capsys, "sacn")
    assert status == 1
    assert "sacn" in err
    assert "scan" in err


def test_an_expected_error_ends_in_one_line_and_status_one(capsys, monkeypatch):
    def command():
        def fail() -> None:
            raise PlanningError("point 3 lies 40 mm out of reach: move the phantom closer", 3)

        return fail

    monkeypatch.setitem(cli.COMMANDS, "doctor", cli.Command("", command))
    status, _, err = run(capsys, "doctor")
    assert status == 1
    assert err.strip() == "PlanningError: point 3 lies 40 mm out of reach: move the phantom closer"


def test_ctrl_c_ends_with_the_status_of_an_interrupt(capsys, monkeypatch):
    def command():
        def interrupted() -> None:
            raise KeyboardInterrupt

        return interrupted

    monkeypatch.setitem(cli.COMMANDS, "doctor", cli.Command("", command))
    status, _, err = run(capsys, "doctor")
    assert status == 130
    assert "Interrupted" in err


@pytest.mark.parametrize("command", ["scan", "view", "reconstruct", "plan", "compare", "study", "doctor"])
def test_every_command_has_its_help(capsys, command):
    status, out, _ = run(capsys, command, "--help")
    assert status == 0
    assert f"breastscan {command}" in out


def test_a_wrong_option_is_refused_with_a_hint(capsys):
    status, _, err = run(capsys, "scan", "--sed", "3")
    assert status != 0
    assert "--seed" in err
