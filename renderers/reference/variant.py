"""Which Mitsuba variant runs here: `llvm_ad_rgb`, proved in a child process before it is loaded.

An LLVM that is too old (Debian's 15 and 16) does not raise an exception on the first kernel: it aborts the whole process. So the
first question is asked in a child process, and its answer is kept, per process and in a small file keyed by the versions involved.
There is no fall-back to `scalar_rgb`: scalar variants can't trace wavefronts of chosen rays (paths through pixel centres), and
materials defined in Python are 17 times slower there. Where Mitsuba can't run, the error names the cause and what mends it.
"""

from __future__ import annotations

import ctypes.util
import importlib.util
import json
import os
import platform
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

VARIANT = "llvm_ad_rgb"
FIX = "apt-get install libllvm19"
INSTALL = "make install"
PACKAGES = ("mitsuba", "drjit")
PROBE_SECONDS = 120
QUESTION = """
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
import drjit as dr
x = dr.minimum(dr.arange(mi.Float, 8), 3)
assert dr.sum(x + dr.fma(x, x, 1))[0] == 76
"""


class ReferenceUnavailable(RuntimeError):
    """Mitsuba can't run on this machine; the message names the fix."""


@dataclass(frozen=True)
class Probe:
    """Answer of the probe. ok: references can be rendered. llvm: the library found. message: one line, with the fix."""

    ok: bool
    variant: str
    llvm: str
    message: str


@cache
def probe() -> Probe:
    """Ask a child process whether `llvm_ad_rgb` compiles and runs a kernel; never imports Mitsuba here and never raises."""
    if missing := [name for name in PACKAGES if importlib.util.find_spec(name) is None]:
        return _refused("", f"Python can't find {' and '.join(missing)}", INSTALL)
    path = _cache_file()
    known = _known(path)
    if known is not None:
        return known
    found = _asked()
    if found.ok:
        _remember(path, found)
    return found


@cache
def mitsuba() -> Any:
    """The module `mitsuba` with its variant set. Raises ReferenceUnavailable with the fix when this machine can't run it."""
    found = probe()
    if not found.ok:
        raise ReferenceUnavailable(found.message)
    import mitsuba as mi

    mi.set_variant(VARIANT)
    mi.set_log_level(mi.LogLevel.Error)
    return mi


def _asked() -> Probe:
    llvm = os.environ.get("DRJIT_LIBLLVM_PATH") or ctypes.util.find_library("LLVM") or "libLLVM found by Dr.Jit"
    try:
        done = subprocess.run([sys.executable, "-c", QUESTION], capture_output=True, text=True, timeout=PROBE_SECONDS, check=False)
    except subprocess.TimeoutExpired:
        return _refused(llvm, f"no answer within {PROBE_SECONDS} s", "try again when the machine has less to do")
    if done.returncode == 0:
        return Probe(True, VARIANT, llvm, f"Mitsuba {metadata.version('mitsuba')} runs {VARIANT}")
    if done.returncode < 0:
        return _refused(llvm, f"the LLVM found here is too old (killed by signal {-done.returncode})", FIX)
    reason = (done.stderr.strip().splitlines() or ["no message"])[-1]
    return _refused(llvm, reason, FIX if "llvm" in reason.lower() else INSTALL)


def _refused(llvm: str, reason: str, fix: str) -> Probe:
    return Probe(False, "", llvm, f"Mitsuba's {VARIANT} does not run: {reason}; fix: {fix}")


def _cache_file() -> Path:
    home = os.environ.get("LUXMETER_HOME")
    return (Path(home) if home else Path.home() / ".local" / "share" / "luxmeter") / "mitsuba-variant.json"


def _key() -> str:
    libraries = sorted(f"{p.resolve()}:{p.stat().st_size}" for p in Path("/usr/lib").glob("*/libLLVM*.so*") if p.exists())
    parts = [metadata.version("mitsuba"), metadata.version("drjit"), platform.platform(), os.environ.get("DRJIT_LIBLLVM_PATH", "")]
    return "|".join([*parts, *libraries])


def _known(path: Path) -> Probe | None:
    """The stored answer, if it was given for the very same versions; a file that can't be read counts as none."""
    try:
        stored = json.loads(path.read_text())
        return Probe(**stored["probe"]) if stored["key"] == _key() else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _remember(path: Path, found: Probe) -> None:
    """Keep a good answer. A data folder that can't be written costs a second probe, nothing else."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=path.parent, delete=False) as file:
            json.dump({"key": _key(), "probe": asdict(found)}, file)
        os.replace(file.name, path)
    except OSError:
        return
