"""The probe of Mitsuba's LLVM variant."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

from renderers.reference import variant


@pytest.fixture
def fresh(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("LUXMETER_HOME", str(tmp_path))
    variant.probe.cache_clear()
    return tmp_path


def answer(code: int, stderr: str = "") -> subprocess.CompletedProcess[str]:
    return subprocess.CompletedProcess([], code, "", stderr)


@pytest.mark.mitsuba
def test_a_good_answer_is_remembered(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = variant.probe()
    assert found.ok, found.message
    assert found.variant == "llvm_ad_rgb"
    variant.probe.cache_clear()
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: pytest.fail("asked twice"))
    assert variant.probe() == found


def test_an_aborting_llvm_is_named_with_the_fix_and_asked_again(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: answer(-6))
    found = variant.probe()
    assert not found.ok
    assert "signal 6" in found.message
    assert variant.FIX in found.message
    assert not list(fresh.iterdir())
    variant.mitsuba.cache_clear()
    with pytest.raises(variant.ReferenceUnavailable, match="libllvm19"):
        variant.mitsuba()
    variant.mitsuba.cache_clear()
    variant.probe.cache_clear()


@pytest.mark.parametrize(
    ("last", "fix"),
    [
        (
            'ImportError: jit_init_thread_state(): the LLVM shared library ("libLLVM.so") could not be found!',
            "apt-get install libllvm19",
        ),
        ("ImportError: libmitsuba.so: undefined symbol", "make install"),
    ],
)
def test_a_failure_shows_its_last_line_and_what_mends_it(fresh: Path, monkeypatch: pytest.MonkeyPatch, last: str, fix: str) -> None:
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: answer(1, f"Traceback\n{last}"))
    assert variant.probe().message == f"Mitsuba's llvm_ad_rgb does not run: {last}; fix: {fix}"
    variant.probe.cache_clear()


@pytest.mark.parametrize("missing", ["mitsuba", "drjit"])
def test_a_missing_package_is_named_whatever_was_remembered(fresh: Path, monkeypatch: pytest.MonkeyPatch, missing: str) -> None:
    (fresh / "mitsuba-variant.json").write_text(json.dumps({"key": "old", "probe": {}}))
    found = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == missing else found(name))
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: pytest.fail("asked in vain"))
    assert variant.probe().message == f"Mitsuba's llvm_ad_rgb does not run: Python can't find {missing}; fix: make install"
    variant.probe.cache_clear()


def test_a_probe_that_hangs_is_an_answer(fresh: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def hang(*args: object, **kwargs: object) -> None:
        raise subprocess.TimeoutExpired("python", 1)

    monkeypatch.setattr(subprocess, "run", hang)
    message = variant.probe().message
    assert "no answer within" in message
    assert "libllvm" not in message
    variant.probe.cache_clear()


@pytest.mark.mitsuba
@pytest.mark.parametrize("content", ["", "{", json.dumps({"key": "old", "probe": {}}), json.dumps([1])])
def test_a_damaged_or_outdated_file_is_asked_anew(fresh: Path, content: str) -> None:
    (fresh / "mitsuba-variant.json").write_text(content)
    assert variant.probe().ok
    variant.probe.cache_clear()


def test_importing_the_package_loads_no_mitsuba() -> None:
    code = "import sys, renderers.reference, renderers.methods.pt; assert not {'mitsuba', 'drjit', 'scipy'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
