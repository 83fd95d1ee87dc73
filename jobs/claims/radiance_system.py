"""The Radiance lighting system, by the programs that the `pyradiance` package carries: a scene through `rpict`, and its cost."""

from __future__ import annotations

import os
import resource
import subprocess
import time
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.scene.radiance import view_arguments, write_radiance
from renderers.scene.world import World

# One ray a pixel, at its centre.
PIXELS = "-ps 1 -pt 0 -pj 0"
# Lights sampled at their centres, every shadow tested; no ambient light but what is computed; lights themselves invisible, since a
# bulb would be drawn into the pixels around it.
RAYS = "-dj 0 -ds 0 -dc 1 -dt 0 -dv- -lr 1 -av 0 0 0"
PHOTONS = "photons.pm"


class RadianceUnavailable(RuntimeError):
    """The programs of Radiance aren't installed."""


class Spent(NamedTuple):
    """CPU and wall seconds."""

    cpu: float
    wall: float


class RadianceScene:
    """A World exported into a folder, with its octree. Raises RadianceUnavailable, SceneError, CalledProcessError."""

    def __init__(self, world: World, folder: Path) -> None:
        package = find_spec("pyradiance")
        if package is None or package.origin is None:
            raise RadianceUnavailable("Radiance's programs are missing: install the package pyradiance")
        self._home, self._folder, self._world = Path(package.origin).parent, folder, world
        exported = write_radiance(world, folder)
        for mesh in exported.meshes:
            self._run("obj2mesh", mesh.name, mesh.with_suffix(".rtm").name)
        (folder / "scene.oct").write_bytes(self._run("oconv", exported.scene.name))

    def seconds(self, size: tuple[int, int], bounces: int, options: str = "") -> Spent:
        """What `rpict` takes for one picture with so many diffuse bounces (-ab), in one process of one thread, without `oconv`."""
        before, start = _children(), time.perf_counter()
        view = view_arguments(self._world.camera, size)
        self._run("rpict", *view, *PIXELS.split(), *RAYS.split(), "-ab", str(bounces), *options.split(), "scene.oct")
        return Spent(_children() - before, time.perf_counter() - start)

    def image(self, size: tuple[int, int], bounces: int, options: str = "") -> NDArray[np.float32]:
        """The same picture's radiance (H, W, 3) by `rtrace`, as floats: `rpict` writes 8 bits of mantissa, too few for the
        difference of two pictures. With `-af` it takes the records that `rpict` left in that file."""
        rays = self._run("vwrays", "-ff", *view_arguments(self._world.camera, size))
        shared = RAYS.split(), ["-ab", str(bounces)], options.split()
        values = self._run("rtrace", "-h", "-ff", *(text for texts in shared for text in texts), "scene.oct", piped=rays)
        return np.frombuffer(values, np.float32).reshape(size[1], size[0], 3)

    def trace_photons(self, photons: int, seed: int) -> Spent:
        """Trace a global photon map of about so many stored photons with `mkpmap`, for `gathered`; what it takes."""
        before, start = _children(), time.perf_counter()
        self._run("mkpmap", "-fo+", "-t", "0", "-apr", str(seed), "-apg", PHOTONS, str(photons), "scene.oct")
        return Spent(_children() - before, time.perf_counter() - start)

    def gathered(self, size: tuple[int, int], options: str = "", nearest: int = 50) -> tuple[NDArray[np.float32], Spent]:
        """Radiance (H, W, 3) with indirect light by final gathering from that map, `nearest` photons a look-up; what it takes."""
        before, start = _children(), time.perf_counter()
        image = self.image(size, 1, f"-ap {PHOTONS} {nearest} {options}")
        return image, Spent(_children() - before, time.perf_counter() - start)

    def _run(self, program: str, *arguments: str, piped: bytes = b"") -> bytes:
        environment = {**os.environ, "RAYPATH": os.pathsep.join([".", str(self._home / "lib")])}
        command = [str(self._home / "bin" / program), *arguments]
        done = subprocess.run(command, cwd=self._folder, env=environment, check=True, capture_output=True, input=piped)
        return done.stdout


def _children() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime
