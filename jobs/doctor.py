"""What this machine offers of what luxmeter needs. Graphics libraries are asked in child processes: a bad driver or LLVM aborts."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from jobs.process import child_environment
from jobs.store import Store

PROBE_S = 150
GIB = 2**30
GL = """
from renderers.gl.context import context
info = context().info
code = context().version_code
assert code >= 430, f"OpenGL {code // 100}.{code // 10 % 10} is too old, 4.3 is needed"
print(info["GL_RENDERER"], "·", info["GL_VERSION"])
"""
MITSUBA = """
from renderers.reference.variant import probe
found = probe()
if not found.ok:
    raise SystemExit(found.message)
print(found.variant, "·", found.llvm, "·", found.message)
"""
EMBREE = """
import embreex, numpy as np
from embreex.rtcore_scene import EmbreeScene
from embreex.mesh_construction import TriangleMesh
from importlib.metadata import version
scene = EmbreeScene()
TriangleMesh(scene, np.array([[[-1, -1, 0], [1, -1, 0], [0, 1, 0]]], np.float32))
hit = scene.run(np.array([[0, 0, 1]], np.float32), np.array([[0, 0, -1]], np.float32))
assert hit[0] == 0, "a ray missed its triangle"
print("embreex", version("embreex"))
"""
OPENEXR = """
import OpenEXR
from importlib.metadata import version
print("OpenEXR", version("OpenEXR"))
"""
PROBES = (
    ("OpenGL 4.3", GL, "apt-get install libegl1 libgl1 libgl1-mesa-dri libglvnd0 libx11-6"),
    ("Mitsuba and LLVM", MITSUBA, "apt-get install libllvm19"),
    ("Embree", EMBREE, "make install"),
    ("OpenEXR", OPENEXR, "make install"),
)


@dataclass(frozen=True)
class Check:
    """One requirement: whether it is met, what was found, and what to do where it isn't."""

    name: str
    ok: bool
    required: bool
    found: str
    fix: str


def check_all() -> list[Check]:
    """Every requirement in a fixed order; the child processes run beside one another."""
    with ThreadPoolExecutor(len(PROBES)) as pool:
        probes = list(pool.map(lambda probe: _probe(*probe), PROBES))
    return [
        _python(),
        *probes,
        Check("cores", True, True, f"{len(os.sched_getaffinity(0))}", ""),
        _memory(),
        _data_folder(),
        _chromium(),
    ]


def _python() -> Check:
    version = sys.version_info
    return Check("Python", (3, 11) <= version[:2] < (3, 14), True, sys.version.split()[0], "install Python 3.11, 3.12 or 3.13")


def _probe(name: str, program: str, fix: str) -> Check:
    """Run a small program that prints what it found, or fails with the reason on the last line of its standard error, which may
    name a fix of its own."""
    try:
        command = [sys.executable, "-P", "-c", program]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PROBE_S, env=child_environment(), check=False)
    except subprocess.TimeoutExpired:
        return Check(name, False, True, f"no answer within {PROBE_S} s", fix)
    lines = (done.stdout if done.returncode == 0 else done.stderr).strip().splitlines()
    found = lines[-1] if lines else ""
    if done.returncode < 0:
        found = f"killed by signal {-done.returncode}" + (f": {found}" if found else "")
    found, _, own = found.partition("; fix: ")
    return Check(name, done.returncode == 0, True, found, own or fix)


def _memory() -> Check:
    total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / GIB
    return Check("memory", total >= 2, True, f"{total:.1f} GiB", "2 GiB are the least that references need")


def _data_folder() -> Check:
    store = Store()
    return _attempt("data folder", str(store.home), store.check_writable, "set LUXMETER_HOME to a folder you can write")


def _attempt(name: str, found: str, action: Callable[[], None], fix: str) -> Check:
    try:
        action()
    except OSError as error:
        return Check(name, False, True, f"{found}: {error.strerror or error}", fix)
    return Check(name, True, True, found, fix)


def _chromium() -> Check:
    path = shutil.which("chromium") or shutil.which("google-chrome")
    return Check(
        "Chromium", path is not None, False, str(Path(path)) if path else "not found", "apt-get install chromium (page tests only)"
    )
