from pathlib import Path

import pytest

from breastscan.commands import doctor
from breastscan.errors import ConfigError
from breastscan.vision.matching import lanes


def test_rendering_works_here_or_the_cure_names_the_packages(monkeypatch):
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    rendering = doctor.examine()[0]
    assert rendering.works, rendering.cure


def test_a_machine_without_opengl_is_told_what_to_install(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    rendering = doctor.examine()[0]
    assert not rendering.works
    with pytest.raises(ConfigError, match="libegl1"):
        doctor.require_needed([rendering])


def test_what_a_scan_can_do_without_does_not_fail():
    doctor.require_needed(
        [doctor.Finding("Vulkan", False, "no loader", "install it", needed=False)]
    )


def test_the_cache_of_the_kernels_is_looked_for_where_numba_keeps_it(monkeypatch):
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    finding = next(f for f in doctor.examine() if "kernels" in f.what)
    beside = Path(lanes.__file__).parent / "__pycache__"
    assert finding.detail.endswith(str(beside))


def test_an_unwritable_cache_is_found_and_its_variable_named(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    finding = next(f for f in doctor.examine() if "kernels" in f.what)
    assert not finding.works
    assert "NUMBA_CACHE_DIR" in finding.cure


def test_a_version_that_does_not_fit_is_broken_though_all_else_works(monkeypatch):
    monkeypatch.setattr(doctor, "unsuited", lambda: ["numpy is 1.26, needed is >=2.0"])
    finding = next(f for f in doctor.examine() if f.what == "versions")
    with pytest.raises(ConfigError, match="versions does not work: pip install"):
        doctor.require_needed([finding])
