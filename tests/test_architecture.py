"""The import rules of the house, read from the sources."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PRODUCT = sorted((ROOT / "breastscan").rglob("*.py"))
LAYERS = {
    "geometry": set(),
    **{name: {"geometry"} for name in ("vision", "cloud", "planning", "control", "robot", "report")},
}
"""What a package inside breastscan may import, errors and itself aside."""


def imports(path: Path) -> list[tuple[str, bool]]:
    """Every module a file imports, and whether only when a function runs."""
    found = []

    def visit(node: ast.AST, lazy: bool) -> None:
        if isinstance(node, ast.Import):
            found.extend((alias.name, lazy) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative imports go only one way up at most; none are used here"
            found.append((node.module or "", lazy))
            found.extend((f"{node.module}.{alias.name}", lazy) for alias in node.names)
        inner = lazy or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        for child in ast.iter_child_nodes(node):
            visit(child, inner)

    visit(ast.parse(path.read_text(encoding="utf-8")), False)
    return found


@pytest.mark.parametrize("path", PRODUCT, ids=lambda p: str(p.relative_to(ROOT)))
def test_the_product_never_imports_the_simulator(path):
    for module, lazy in imports(path):
        if module.split(".")[0] in {"mujoco", "dm_control", "sim", "experiments"}:
            assert path.name == "cli.py", f"{path.name} imports {module}"
            assert lazy, f"cli.py must import {module} inside a function"


@pytest.mark.parametrize("path", PRODUCT, ids=lambda p: str(p.relative_to(ROOT)))
def test_packages_import_only_the_layers_below(path):
    package = path.relative_to(ROOT / "breastscan").parts[0]
    if package not in LAYERS:
        return
    allowed = LAYERS[package] | {package, "errors"}
    for module, _ in imports(path):
        parts = module.split(".")
        if parts[0] == "breastscan" and len(parts) > 1:
            assert parts[1] in allowed, f"{path.name} imports {module}"


def test_only_one_file_imports_ur_rtde():
    users = {
        p.name for p in PRODUCT for m, _ in imports(p) if m.split(".")[0].startswith(("rtde_", "ur_rtde", "dashboard_"))
    }
    assert users <= {"rtde.py"}


@pytest.mark.parametrize("word", ["sim.truth", "truth_log", "true_"])
def test_perception_and_planning_never_read_the_truth(word):
    for path in PRODUCT:
        if path.relative_to(ROOT / "breastscan").parts[0] not in {"report"}:
            assert word not in path.read_text(encoding="utf-8"), f"{path.name} mentions {word}"


def test_only_the_command_line_and_tests_import_experiments():
    for path in (ROOT / "sim").rglob("*.py"):
        assert not any(module.split(".")[0] == "experiments" for module, _ in imports(path)), path.name
