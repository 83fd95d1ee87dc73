"""Where numba keeps compiled kernels: a folder named after the sources that they are made of.

numba compiles a kernel again when the kernel's own file changed, not when a function that it calls from another file did, nor when
a constant it imports did. After an upgrade in place it would go on with old code. So the folder's name is a hash over every source
that has a kernel and over all that these import, step by step; a change in one of them starts an empty folder.
"""

from __future__ import annotations

import atexit
import hashlib
import os
import re
import shutil
import sys
import tempfile
from pathlib import Path

PACKAGE = Path(__file__).parent
ROOT = PACKAGE.parents[1]
KEPT = 3
IMPORT = re.compile(r"^\s*(?:from (renderers[\w.]*) import (\([^)]*\)|[^\n]*)|import (renderers[\w.]*))", re.MULTILINE)
KERNELS = re.compile(r"^\s*(?:import numba|from numba)", re.MULTILINE)


def use() -> None:
    """Point numba to the folder of these sources, unless the user chose one; may be called before or after numba's import."""
    chosen = os.environ.get("NUMBA_CACHE_DIR", "")
    if chosen and Path(chosen).parent not in _places():
        return
    folder = _folder(sources_hash())
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = str(folder)


def sources_hash(package: Path = PACKAGE, root: Path = ROOT) -> str:
    """Hash of the sources below `package` that have kernels, and of the modules of `renderers`, found below `root`, they import."""
    texts = dict[Path, str]()
    wanted = [path for path in package.rglob("*.py") if KERNELS.search(path.read_text(encoding="utf-8"))]
    while wanted:
        path = wanted.pop()
        if path not in texts:
            texts[path] = path.read_text(encoding="utf-8")
            wanted += _imported(texts[path], root)
    digest = hashlib.sha256()
    for path, text in sorted(texts.items()):
        digest.update(f"{path.relative_to(root).as_posix()}\0{text}\0".encode())
    return digest.hexdigest()[:16]


def _imported(text: str, root: Path) -> list[Path]:
    """Files of the modules that a source imports, wherever in it; names that are no modules have no file and drop out."""
    modules = list[str]()
    for base, names, plain in IMPORT.findall(text):
        modules += [plain] if plain else [base, *(f"{base}.{name}" for name in re.findall(r"\w+", names))]
    stems = [root.joinpath(*module.split(".")) for module in modules]
    return [path for stem in stems for path in (stem.with_suffix(".py"), stem / "__init__.py") if path.is_file()]


def _places() -> tuple[Path, ...]:
    """Folders that may hold kernels, the best first: beside the sources, or the user's own where those can't be written."""
    own = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return PACKAGE / "__pycache__" / "kernels", own / "luxmeter" / "kernels"


def _folder(name: str) -> Path:
    """The folder of that name in the first place that can be written, where the latest others stay; or one of this process."""
    for place in _places():
        folder = place / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
            os.utime(folder)
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError:
            continue
        _tidy(place)
        return folder
    folder = Path(tempfile.mkdtemp(prefix="luxmeter-kernels-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def _tidy(place: Path) -> None:
    """Keep the folders used last: another version of the sources may be running beside this one."""
    for old in sorted(place.iterdir(), key=lambda path: path.stat().st_mtime)[:-KEPT]:
        shutil.rmtree(old, ignore_errors=True)
