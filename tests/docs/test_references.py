"""Sources cited in code and documents stand in REFERENCES.md."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
REFERENCES = (ROOT / "REFERENCES.md").read_text(encoding="utf-8")
KEYS = set(re.findall(r"^\| ([A-Z][\w -]*) \|", REFERENCES, re.MULTILINE))
SOURCES = "\n".join(
    path.read_text(encoding="utf-8")
    for folder in ("breastscan", "sim", "experiments", "tests", "docs")
    for path in sorted((ROOT / folder).rglob("*"))
    if path.suffix in {".py", ".md"}
)


def test_every_citation_of_a_part_of_a_source_is_known():
    parts = re.findall(r"\[([A-Z][\w -]+),\s(?:Eq|Fig|Sec|Table)", SOURCES)
    assert set(parts) <= KEYS


def test_every_citation_of_a_makers_page_is_known():
    assert set(re.findall(r"\[(UR-[\w-]+)", SOURCES)) <= KEYS


def test_every_citation_with_a_year_is_known():
    assert set(re.findall(r"\[([A-Z][a-z]+ (?:19|20)\d\d)", SOURCES)) <= KEYS
