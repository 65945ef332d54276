"""What programs import first: light, lazy, and the same in whatever order it is asked for."""

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import breastscan
import sim

PACKAGES = pytest.mark.parametrize(
    "package", [breastscan, sim], ids=lambda package: package.__name__
)


def python(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)


@PACKAGES
def test_type_checkers_are_shown_the_same_names(package):
    tree = ast.parse(Path(package.__file__).read_text(encoding="utf-8"))
    shown = {
        alias.asname: node.module
        for block in tree.body
        if isinstance(block, ast.If) and ast.unparse(block.test) == "TYPE_CHECKING"
        for node in block.body
        for alias in node.names
    }
    assert shown == {name: f"{package.__name__}.{home}" for name, home in package.HOMES.items()}


@PACKAGES
def test_every_name_is_what_its_module_holds(package):
    for name, home in package.HOMES.items():
        module = import_module(f"{package.__name__}.{home}")
        assert getattr(package, name) is vars(module)[name]
        assert name in dir(package)


@PACKAGES
def test_a_name_that_is_not_there_is_told(package):
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = package.nothing


@pytest.mark.parametrize(
    "before",
    [
        "",
        "import breastscan.scan",
        "from breastscan.scan import ScanConfig",
        "import breastscan.commands.scan",
        "from breastscan import scan; import breastscan.scan",
    ],
)
def test_scan_is_the_function_whatever_was_imported_before(before):
    code = (
        "from breastscan import scan; from breastscan.scan import scan as same; print(scan is same)"
    )
    child = python(f"{before}\n{code}")
    assert child.stdout.strip() == "True", child.stderr


def test_importing_the_packages_loads_nothing_heavy():
    heavy = {"numpy", "cv2", "numba", "polars", "mujoco", "dm_control"}
    child = python(f"import sys, breastscan, sim; print({heavy} & sys.modules.keys())")
    assert child.stdout.strip() == "set()", child.stderr


def test_a_broken_opencv_is_told_as_such():
    child = python("import sys; sys.modules['cv2'] = None; import breastscan; breastscan.scan")
    assert "import of cv2 halted" in child.stderr
