"""Content-addressed folder of references that later calls continue.

`<key>.npz` holds the exact float64 sums (EXR has no float64), n and the mask; `<key>.exr` is the picture for people and other
programs: layers mean.*, variance.*, luminance_variance.Y, with n and all parts of the key as attributes. Both are written to a
temporary name and renamed, the EXR first, so whoever finds the sums finds the picture.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import zipfile
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import cast

import numpy as np

from renderers.images import write_exr
from renderers.method import Transport
from renderers.reference.image import PixelMode, Reference

# Raised with every change of the estimators, the export or the seeding: stored references of another version are never continued.
INTEGRATOR_VERSION = 1
SUMS = ("total", "squares", "squares_y", "surface")
SINCE = ("alternating",)  # sums that older files of the same version don't hold


def identity(
    scene_hash: str, frame: int, size: tuple[int, int], transport: Transport, pixel: PixelMode, spp: int, radius: float | None
) -> dict[str, str]:
    """Everything that decides a reference's bytes, except how many replicates there are; the parts of its key."""
    return {
        "scene": scene_hash,
        "frame": str(frame),
        "size": f"{size[0]}x{size[1]}",
        "transport": transport,
        "pixel": pixel,
        "spp": str(spp),
        "radius": "infinite" if radius is None else float(radius).hex(),
        "integrator": f"{INTEGRATOR_VERSION}, mitsuba {metadata.version('mitsuba')}, drjit {metadata.version('drjit')}",
    }


def key_of(parts: dict[str, str]) -> str:
    """SHA-256 (hex) of an identity."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def load(folder: Path, parts: dict[str, str]) -> Reference | None:
    """The stored reference of this identity, or None. A damaged file counts as none: it is rendered and written anew."""
    try:
        with open(folder / f"{key_of(parts)}.npz", "rb") as stream, np.load(stream, allow_pickle=False) as file:
            sums = {name: file[name] for name in SUMS}
            sums |= {name: file[name] for name in SINCE if name in file}
            n = int(file["n"])
            stored = json.loads(str(file["identity"]))
    except (FileNotFoundError, zipfile.BadZipFile, EOFError, KeyError, ValueError):
        return None
    if stored != parts or n < 2:
        return None
    return Reference(
        **sums,
        n=n,
        spp=int(parts["spp"]),
        scene_hash=parts["scene"],
        transport=cast(Transport, parts["transport"]),
        pixel=cast(PixelMode, parts["pixel"]),
        frame=int(parts["frame"]),
    )


def save(folder: Path, parts: dict[str, str], reference: Reference) -> Path:
    """Write a reference, unless the folder holds one of this identity with at least as many replicates. Returns the EXR's path."""
    folder.mkdir(parents=True, exist_ok=True)
    key = key_of(parts)
    picture = folder / f"{key}.exr"
    stored = load(folder, parts)
    if stored is not None and stored.n >= reference.n and picture.is_file():
        return picture
    layers = {"mean": reference.image, "variance": reference.variance, "luminance_variance": reference.luminance_variance}
    _replace(picture, lambda path: write_exr(path, layers, default="mean", n=str(reference.n), **parts))
    sums = {name: value for name in (*SUMS, *SINCE) if (value := getattr(reference, name)) is not None}
    _replace(
        folder / f"{key}.npz",
        lambda path: np.savez(path, n=np.int64(reference.n), identity=np.array(json.dumps(parts)), allow_pickle=False, **sums),
    )
    return picture


def _replace(path: Path, write: Callable[[Path], None]) -> None:
    """Write beside `path` and rename: readers see the old file or the whole new one."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}.", suffix=path.suffix)
    os.close(handle)
    temporary = Path(name)
    try:
        write(temporary)
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
