"""The documentation site shows every guide and every module (docs/site/pages.py says which)."""

import pkgutil
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = runpy.run_path(str(ROOT / "docs/site/pages.py"))


def walk(folder, dotted):
    """Every module as Python's own import system finds it, packages included."""
    yield dotted
    for module in pkgutil.iter_modules([str(folder)]):
        name = f"{dotted}.{module.name}"
        if module.ispkg:
            yield from walk(folder / module.name, name)
        elif module.name != "__main__":
            yield name


def leaves(contents):
    """Every page that a table of contents leads to."""
    if isinstance(contents, str):
        return [contents]
    inner = contents.values() if isinstance(contents, dict) else contents
    return [page for part in inner for page in leaves(part)]


def test_every_module_has_a_page_of_its_own():
    found = {name for top in PAGES["PACKAGES"] for name in walk(ROOT / top, top)}
    assert set(PAGES["modules"]()) == found
    shown = [text for text in PAGES["reference"]().values() if "\n::: " in text]
    assert len(shown) == len(found)
    assert all(sum(f"\n::: {name}\n" in text for text in shown) == 1 for name in found)


def test_the_contents_lead_to_every_page_once():
    pages = [page for top in PAGES["PACKAGES"] for page in leaves(PAGES["contents"](top))]
    assert sorted([PAGES["INDEX"], *pages]) == sorted(PAGES["reference"]())


def test_every_guide_and_every_page_of_the_project_is_there():
    assert PAGES["guides"]() == sorted(f"docs/{path.name}" for path in ROOT.glob("docs/*.md"))
    assert all((ROOT / page).is_file() for page in [PAGES["HOME"], *PAGES["PROJECT"]])


@pytest.mark.parametrize("module", PAGES["STABLE"])
def test_stable_names_exist(module):
    assert set(PAGES["STABLE"][module]) <= set(PAGES["public_names"](PAGES["modules"]()[module]))


def test_public_names_are_functions_classes_and_constants_of_the_module_itself(tmp_path):
    source = tmp_path / "module.py"
    source.write_text(
        "import os\nfrom re import sub\nA, B = 1, 2\nC: int = 3\n_D = [x for x in 'y']\n"
        "def f():\n    inner = 1\nasync def g(): ...\nclass H:\n    field = 1\ndef _i(): ...\n"
    )
    assert PAGES["public_names"](source) == ["A", "B", "C", "f", "g", "H"]
