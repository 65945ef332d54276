"""The pages of the documentation site, as a hook of ProperDocs (`make docs`).

The tree's own Markdown files keep their paths, so that their links hold in both places, and every
module of the packages has a page of its own, which mkdocstrings fills from the source.
"""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]
HOME = "README.md"
PROJECT = ["CONTRIBUTING.md", "CHANGELOG.md", "REFERENCES.md", "SECURITY.md"]
PACKAGES = ("breastscan", "sim")
API = "api"
INDEX = f"{API}/index.md"
STABLE = {
    "breastscan.vision.stereo": ["disparity_map", "StereoConfig"],
    "breastscan.vision.camera": ["StereoRig"],
    "breastscan.vision.board": ["Board", "find_corners"],
    "breastscan.geometry.nurbs": ["Nurbs"],
    "breastscan.geometry.kinematics": ["forward", "inverse", "jacobian"],
    "breastscan.planning.feedrate": ["interpolate", "FeedrateLimits"],
    "breastscan.robot.interface": ["Robot"],
    "sim.scene": ["SceneConfig"],
    "sim.robot": ["SimRobot"],
    "sim.truth": ["Truth"],
}
"""What programs of others may rely on: the names that stay where they are, by module."""


def guides() -> list[str]:
    """Every page of docs/, as a path in the tree."""
    return [path.relative_to(ROOT).as_posix() for path in sorted((ROOT / "docs").glob("*.md"))]


def modules() -> dict[str, Path]:
    """Every module with a page in the reference: its file by its dotted name, packages by their
    own.
    """
    files = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    names = [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in files]
    found = {name.removesuffix(".__init__"): path for name, path in zip(names, files, strict=True)}
    return {name: found[name] for name in sorted(found) if not name.endswith("__main__")}


def public_names(path: Path) -> list[str]:
    """The public names that a module defines at its top: functions, classes, constants."""
    names = []
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            names.append(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            target = node.target if isinstance(node, ast.AnnAssign) else node.targets[0]
            names += [part.id for part in ast.walk(target) if isinstance(part, ast.Name)]
    return [name for name in names if not name.startswith("_")]


def is_package(path: Path) -> bool:
    """Whether a module's file makes its folder a package."""
    return path.name == "__init__.py"


def page_of(module: str, path: Path) -> str:
    """Where the page of a module lies in the site."""
    place = f"{API}/{module.replace('.', '/')}"
    return f"{place}/index.md" if is_package(path) else f"{place}.md"


def summary(path: Path) -> str:
    """First paragraph of a module's docstring, on one line."""
    docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return " ".join(docstring.partition("\n\n")[0].split())


def inside(package: str) -> dict[str, Path]:
    """The modules and packages that lie in a package, but not deeper."""
    return {name: path for name, path in modules().items() if name.rpartition(".")[0] == package}


def page_text(module: str) -> str:
    """The order to mkdocstrings to show a module; for a package also what lies in it."""
    rows = [
        f"- [`{name}`][{name}]" + f": {summary(path)}" * bool(summary(path))
        for name, path in inside(module).items()
    ]
    return "\n".join(["---", f"title: {module}", "---", "", f"::: {module}", "", *rows, ""])


def contents(package: str) -> list:
    """The table of contents of a package: its own page, its modules, its packages."""
    rows = inside(package).items()
    return [
        page_of(package, modules()[package]),
        *({name.rpartition(".")[2]: page_of(name, p)} for name, p in rows if not is_package(p)),
        *({name.rpartition(".")[2]: contents(name)} for name, p in rows if is_package(p)),
    ]


def reference_index() -> str:
    """The first page of the reference: the stable names."""
    links = {
        module: ", ".join(f"[`{name}`][{module}.{name}]" for name in names)
        for module, names in STABLE.items()
    }
    return "\n".join(
        [
            "# API reference",
            "",
            "These names stay where they are and keep their meaning; where one must change, the",
            "[changelog](../CHANGELOG.md) says so. The rest may move between versions.",
            "",
            "| module | names |",
            "|---|---|",
            *(f"| [`{module}`][{module}] | {names} |" for module, names in links.items()),
            "",
            "Arrays carry their shape in the type, as jaxtyping writes it: "
            '`Float[np.ndarray, "n 3"]` is n points.',
            "Frames and units: [`breastscan.geometry.se3`][].",
            "",
        ]
    )


def reference() -> dict[str, str]:
    """Every page of the reference, by its path in the site."""
    pages = {page_of(module, path): page_text(module) for module, path in modules().items()}
    return {INDEX: reference_index(), **pages}


def on_config(config):
    """Give the site its table of contents."""
    config.nav = [
        {"Home": HOME},
        {"Guides": guides()},
        {"API reference": [INDEX, *({package: contents(package)} for package in PACKAGES)]},
        {"Project": PROJECT},
    ]
    return config


def on_files(files, config):
    """Put the tree's files under their own paths, and the reference's pages beside them."""
    from properdocs.structure.files import File, Files

    images = [path.relative_to(ROOT).as_posix() for path in (ROOT / "docs/images").iterdir()]
    shown = [HOME, *PROJECT, *guides(), *images]
    themes = [file for file in files if file.src_dir != config.docs_dir]
    kept = [File(name, str(ROOT), config.site_dir, config.use_directory_urls) for name in shown]
    written = [File.generated(config, name, content=text) for name, text in reference().items()]
    return Files([*themes, *kept, *written])


def on_post_build(config):
    """Refuse a reference in which a public name is missing."""
    from properdocs.exceptions import PluginError

    missing = []
    for module, path in modules().items():
        page = Path(config.site_dir, page_of(module, path)).with_suffix(".html")
        anchors = page.read_text(encoding="utf-8")
        names = [f"{module}.{name}" for name in public_names(path)]
        missing += [name for name in names if f'id="{name}"' not in anchors]
    if missing:
        raise PluginError(f"the reference lacks {', '.join(missing)}")
