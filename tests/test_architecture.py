"""The floors of the house and who may import whom, read from the sources."""

import ast
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
UNDER = {"geometry", "checks", "errors", "servo", "settings"}
"""What every room may import."""
STAGES = ("vision", "cloud", "planning", "tissue", "control", "robot", "camera")
"""Stages never import one another, but may the files of a run."""
ALL_STAGES = {*UNDER, *STAGES, "run"}
PRODUCT = {
    "errors": set(),
    "checks": {"errors"},
    "servo": {"errors"},
    "geometry": {"checks", "errors"},
    "run": UNDER,
    **dict.fromkeys(STAGES, UNDER | {"run"}),
    "settings": {"errors"},
    "cell": ALL_STAGES,
    "interruptions": set(),
    "exports": set(),
    "scan_log": ALL_STAGES,
    "approach": ALL_STAGES,
    "execution": ALL_STAGES | {"approach", "interruptions"},
    "skin_view": ALL_STAGES,
    "scan": ALL_STAGES | {"approach", "cell", "execution", "scan_log", "skin_view"},
    "report": UNDER | {"run"},
}
"""What each room of the product may import, itself aside."""
FLOORS = [set(PRODUCT) | {""}, {"sim"}, {"experiments"}, {"commands", "cli", "__main__"}]
"""From the ground up: each floor may import those below; the last alone imports lazily."""


def _modules() -> dict[str, Path]:
    """Every module by its dotted name, packages under their own."""
    files = sorted(
        path for top in ("breastscan", "sim", "experiments") for path in (ROOT / top).rglob("*.py")
    )
    names = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for path in files
    ]
    return dict(zip(names, files, strict=True))


MODULES = _modules()


def room(module: str) -> str:
    """The room a module lies in: below breastscan its first folder or file, else the top level
    itself.
    """
    top, _, rest = module.partition(".")
    return rest.partition(".")[0] if top == "breastscan" else top


def floor(module: str) -> int:
    return next(number for number, rooms in enumerate(FLOORS) if room(module) in rooms)


def imports(path: Path) -> list[tuple[str, bool]]:
    """Every module a file imports, the house's own by their full names, and whether only when a
    function runs.
    """
    found = []

    def visit(node: ast.AST, lazy: bool) -> None:
        if isinstance(node, ast.Import):
            found.extend((alias.name, lazy) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: no relative imports are used here"
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                found.append((whole if whole in MODULES else node.module, lazy))
        inner = lazy or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        for child in ast.iter_child_nodes(node):
            visit(child, inner)

    visit(ast.parse(path.read_text(encoding="utf-8")), False)
    return found


IMPORTS = {module: imports(path) for module, path in MODULES.items()}


@pytest.mark.parametrize("module", MODULES)
def test_every_module_lies_in_a_room_that_has_rules(module):
    assert any(room(module) in rooms for rooms in FLOORS)


@pytest.mark.parametrize("module", MODULES)
def test_a_floor_imports_only_those_below(module):
    for other, _ in IMPORTS[module]:
        if other in MODULES:
            assert floor(other) <= floor(module), f"{module} imports {other}"


@pytest.mark.parametrize("module", MODULES)
def test_rooms_of_the_product_import_only_what_lies_under_them(module):
    if room(module) in PRODUCT:
        for other, _ in IMPORTS[module]:
            if other in MODULES:
                assert room(other) in PRODUCT[room(module)] | {room(module)}, (
                    f"{module} imports {other}"
                )


@pytest.mark.parametrize("module", MODULES)
def test_only_commands_import_the_house_lazily(module):
    for other, lazy in IMPORTS[module]:
        if other in MODULES and room(module) not in FLOORS[-1]:
            assert not lazy, f"{module} imports {other} inside a function"


def test_no_imports_run_in_a_circle():
    graph = {
        module: {other for other, _ in IMPORTS[module] if other in MODULES} - {module}
        for module in MODULES
    }
    TopologicalSorter(graph).prepare()


@pytest.mark.parametrize("module", MODULES)
def test_the_product_never_imports_the_simulator(module):
    if floor(module) == 0:
        users = {
            other for other, _ in IMPORTS[module] if other.split(".")[0] in {"mujoco", "dm_control"}
        }
        assert not users, f"{module} imports {users}"


def test_only_one_file_imports_ur_rtde():
    libraries = ("rtde_", "ur_rtde", "dashboard_")
    users = {
        m
        for m, others in IMPORTS.items()
        if any(other.startswith(libraries) for other, _ in others)
    }
    assert users <= {"breastscan.robot.ur.rtde"}


@pytest.mark.parametrize("word", ["sim.truth", "truth_log", "true_"])
def test_perception_planning_and_control_never_read_the_truth(word):
    for module, path in MODULES.items():
        if floor(module) == 0 and room(module) not in {"report", "run"}:
            assert word not in path.read_text(encoding="utf-8"), f"{module} mentions {word}"


@pytest.mark.parametrize("module", MODULES)
def test_no_statement_hides_three_assignments(module):
    for node in ast.walk(ast.parse(MODULES[module].read_text(encoding="utf-8"))):
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple):
            targets = [t for t in node.targets if isinstance(t, ast.Tuple)]
            assert all(len(t.elts) < 3 for t in targets), f"{module}, line {node.lineno}"
