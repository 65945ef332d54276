"""What the tree says of itself in several files is the same in all of them."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LOCKS = ("requirements.lock", "docs/site/requirements.lock")
PIN = re.compile(r"^([\w.-]+)==([\w.]+)$")


def text(name):
    return (ROOT / name).read_text(encoding="utf-8")


def canonical(name):
    return re.sub(r"[-_.]+", "-", name).lower()


def pins(lock):
    """Locked versions by package."""
    matches = [PIN.match(line) for line in text(lock).splitlines()]
    return {canonical(match[1]): match[2] for match in matches}


def required(*requirements):
    return {canonical(re.match(r"[\w.-]+", requirement)[0]) for requirement in requirements}


@pytest.mark.parametrize("lock", LOCKS)
def test_a_lock_holds_names_and_versions_only(lock):
    assert [line for line in text(lock).splitlines() if not PIN.match(line)] == []


def test_the_locks_hold_what_the_project_asks_for():
    extras = PROJECT["optional-dependencies"]
    assert required(*PROJECT["dependencies"], *extras["test"]) <= set(pins(LOCKS[0]))
    assert required(*extras["docs"]) <= set(pins(LOCKS[1]))


def test_both_locks_hold_the_same_versions():
    ours, docs = map(pins, LOCKS)
    assert {name: docs[name] for name in docs if name in ours} == {
        name: ours[name] for name in docs if name in ours
    }


def test_pre_commit_runs_the_locked_ruff():
    revision = re.search(r"ruff-pre-commit\n\s+rev: v(\S+)", text(".pre-commit-config.yaml"))[1]
    assert revision == pins(LOCKS[0])["ruff"]


@pytest.mark.parametrize("field", ["version", "license"])
def test_the_citation_agrees_with_the_package(field):
    assert re.search(rf"^{field}: (\S+)$", text("CITATION.cff"), re.MULTILINE)[1] == PROJECT[field]


def test_the_citation_names_the_package_and_its_authors():
    citation = text("CITATION.cff")
    assert f"\ntitle: {PROJECT['name']}\n" in citation
    assert f"\nabstract: {PROJECT['description']}.\n" in citation
    assert all(f"\n  - name: {author['name']}\n" in citation for author in PROJECT["authors"])
    assert all(f"\n  - {keyword}\n" in citation for keyword in PROJECT["keywords"])
