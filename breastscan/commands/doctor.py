"""`breastscan doctor`: what works on this machine, and how to mend what does not.

Each check runs where it can do no harm: drivers that crash, crash a child process.
"""

import ctypes.util
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numba
import platformdirs
from rich.table import Table

from breastscan.commands.console import GL_PACKAGES, console
from breastscan.errors import ConfigError
from breastscan.run.provenance import unsuited
from breastscan.vision import matching

RENDER_PROBE = """
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='.1'/></worldbody></mujoco>")
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
renderer = mujoco.Renderer(model, 64, 64)
renderer.update_scene(data)
assert renderer.render().any()
"""


@dataclass(frozen=True)
class Finding:
    """One checked capability."""

    what: str
    works: bool
    detail: str
    cure: str = ""
    needed: bool = True


def doctor() -> None:
    """Say what works on this machine and how to mend what does not.

    Raises:
        ConfigError: What a scan needs does not work.
    """
    findings = examine()
    table = Table(box=None)
    for heading in ("", "what", "found", "cure"):
        table.add_column(heading, overflow="fold")
    for finding in findings:
        mark = (
            "[green]works[/]"
            if finding.works
            else "[red]broken[/]"
            if finding.needed
            else "[yellow]absent[/]"
        )
        table.add_row(mark, finding.what, finding.detail, "" if finding.works else finding.cure)
    console.print(table)
    require_needed(findings)


def examine() -> list[Finding]:
    """Run every check."""
    checks = (_opengl, _versions, _numba_cache, _phantom_cache, _video, _ur_rtde, _vulkan)
    return [check() for check in checks]


def _versions() -> Finding:
    found = unsuited()
    detail = "; ".join(found) or "as pyproject.toml asks"
    return Finding("versions", not found, detail, "pip install -r requirements.lock")


def _opengl() -> Finding:
    backend = os.environ.get("MUJOCO_GL") or "egl"  # the user's choice, else what needs no screen
    try:
        child = subprocess.run(
            [sys.executable, "-c", RENDER_PROBE],
            env={**os.environ, "MUJOCO_GL": backend}, capture_output=True, text=True, timeout=120,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return Finding("rendering", False, f"MUJOCO_GL={backend}: no answer in 120 s", _gl_cure())
    if child.returncode == 0:
        return Finding("rendering", True, f"MUJOCO_GL={backend}")
    last = (child.stderr.strip().splitlines() or [f"exit status {child.returncode}"])[-1]
    return Finding("rendering", False, f"MUJOCO_GL={backend}: {last}", _gl_cure())


def _gl_cure() -> str:
    return f"Debian/Ubuntu: apt-get install {GL_PACKAGES}; then unset MUJOCO_GL, or set it to egl"


def _writable(folder: Path) -> str | None:
    """None when a file can be made in `folder`, else the reason why not."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return None
    except OSError as error:
        return str(error.strerror)


def _numba_cache() -> Finding:
    beside = Path(matching.__file__).parent / "__pycache__"
    chosen = Path(os.environ.get("NUMBA_CACHE_DIR") or beside)
    problem = _writable(chosen)
    detail = f"numba {numba.__version__}, {chosen}"
    if problem is None:
        return Finding("compiled kernels' cache", True, detail)
    cure = (
        "set NUMBA_CACHE_DIR to a folder you can write; without it every run compiles for "
        "about a minute"
    )
    return Finding("compiled kernels' cache", False, f"{detail}: {problem}", cure, needed=False)


def _phantom_cache() -> Finding:
    folder = Path(platformdirs.user_cache_dir("breastscan"))
    problem = _writable(folder)
    if problem is None:
        return Finding("phantom's cache", True, str(folder))
    cure = (
        "set XDG_CACHE_HOME to a folder you can write; without it every run builds the phantom "
        "for a minute"
    )
    return Finding("phantom's cache", False, f"{folder}: {problem}", cure, needed=False)


def _video() -> Finding:
    import cv2

    with tempfile.TemporaryDirectory() as folder:
        writer = cv2.VideoWriter(
            str(Path(folder) / "probe.mp4"), cv2.VideoWriter.fourcc(*"vp09"), 25, (64, 64)
        )
        works = writer.isOpened()
        writer.release()
    cure = (
        "install opencv-python-headless from its wheel: a self-built OpenCV may lack FFmpeg's VP9"
    )
    return Finding("video (VP9 in MP4)", works, cv2.__version__, cure, needed=False)


def _ur_rtde() -> Finding:
    works = all(find_spec(name) is not None for name in ("rtde_control", "rtde_receive"))
    return Finding(
        "ur_rtde", works, "" if works else "not installed", "pip install ur-rtde", needed=False
    )


def _vulkan() -> Finding:
    library = ctypes.util.find_library("vulkan")
    cure = (
        "Debian/Ubuntu: apt-get install libvulkan1 mesa-vulkan-drivers (only for the "
        "better-looking renderer)"
    )
    return Finding(
        "Vulkan (better renderer)", library is not None, library or "no loader", cure, needed=False
    )


def require_needed(findings: list[Finding]) -> None:
    """Pass when all that a scan needs is there.

    Raises:
        ConfigError: Something is not, with its cure.
    """
    broken = [finding for finding in findings if finding.needed and not finding.works]
    if broken:
        raise ConfigError(f"{broken[0].what} does not work: {broken[0].cure}", broken)
