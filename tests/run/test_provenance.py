"""A run says when, by which command and from which commit it came, and is never lost for that."""

import shutil
import subprocess
from datetime import datetime, timedelta

import pytest

from breastscan.run import provenance

needs_git = pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed")


def git(folder, *arguments):
    identity = ("-c", "user.name=A", "-c", "user.email=a@example.org")
    command = ["git", "-C", str(folder), *identity, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


@pytest.fixture
def checkout(tmp_path):
    git(tmp_path, "init", "--quiet")
    (tmp_path / "code.py").write_text("a = 1\n")
    git(tmp_path, "add", "code.py")
    git(tmp_path, "commit", "--quiet", "--message", "First")
    return tmp_path


def test_the_date_is_now_with_its_offset_from_utc():
    date = datetime.fromisoformat(provenance.provenance()["date"])
    assert date.tzinfo is not None
    assert abs(datetime.now().astimezone() - date) < timedelta(minutes=1)


@pytest.mark.parametrize(
    ("argv", "typed"),
    [
        (["/venv/bin/breastscan", "scan", "--out", "my run"], "breastscan scan --out 'my run'"),
        (["/tree/breastscan/__main__.py", "scan"], "breastscan scan"),
        (["examples/scan_the_twin.py"], "examples/scan_the_twin.py"),
        (["other/__main__.py"], "other/__main__.py"),
    ],
)
def test_the_command_is_what_the_user_typed(argv, typed):
    assert provenance.command(argv) == typed


@needs_git
def test_the_commit_of_a_checkout_is_told_and_whether_it_was_changed(checkout):
    head = git(checkout, "rev-parse", "HEAD")
    git(checkout, "tag", "v1")
    assert provenance.commit(checkout) == head
    (checkout / "code.py").write_text("a = 2\n")
    assert provenance.commit(checkout) == f"{head}-dirty"


@needs_git
def test_the_commit_of_a_second_work_tree_is_its_own(checkout, tmp_path_factory):
    other = tmp_path_factory.mktemp("trees") / "other"
    git(checkout, "worktree", "add", "--quiet", str(other))
    assert provenance.commit(other) == git(checkout, "rev-parse", "HEAD")


@needs_git
def test_an_installed_package_inside_anothers_repository_has_no_commit(checkout):
    installed = checkout / ".venv" / "site-packages"
    installed.mkdir(parents=True)
    assert provenance.commit(installed) is None


@needs_git
def test_the_repository_that_the_environment_names_is_not_asked(checkout, tmp_path, monkeypatch):
    monkeypatch.setenv("GIT_DIR", str(tmp_path / "nowhere"))
    assert provenance.commit(checkout) is not None


def test_without_git_there_is_no_commit_and_no_failure(tmp_path, monkeypatch):
    (tmp_path / ".git").mkdir()
    assert provenance.commit(tmp_path) is None
    monkeypatch.setenv("PATH", "")
    assert provenance.commit(tmp_path) is None
