"""The stage of St-Amour's measurements: a model 6 units large under a square light, on a ground that receives shadows only.

Neither light position, field of view nor triangle count is published. Here the light hangs 12 units above the ground, and one
pyramid around all geometry holds everything. The model is a scanned one where the scene folder has it, else a knotted tube with a
rough skin.
"""

from __future__ import annotations

import ctypes
import gc
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jobs.claims.bench import Bench
from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Lambert, SceneError

if TYPE_CHECKING:
    from renderers.scene.world import World
    from renderers.transport.penumbra.emitters import Emitter
    from renderers.transport.penumbra.functions import PenumbraMap

SCANNED = "armadillo"
SIZE, HEIGHT, GROUND = 6.0, 12.0, 14.0
LIGHT = 5.0
BIAS = 2.5e-4
F64 = NDArray[np.float64]


class Model(NamedTuple):
    """What stands on the ground: its name, vertices (V, 3) and triangles (T, 3)."""

    name: str
    vertices: F64
    triangles: NDArray[np.integer]


@dataclass(frozen=True, eq=False)
class Stage:
    """A model on its ground, ready to build from. casters: bool (T,), the triangles of the model."""

    name: str
    world: World
    lamp: Emitter
    casters: NDArray[np.bool_]

    def build(self, samples: int, resolution: int, maps: int, counters: Counter[str] | None = None, **how: Any) -> PenumbraMap:
        """One penumbra deep shadow map, of the whole stage; `how` are fields of Construction."""
        from renderers.transport.penumbra.assemble import Construction
        from renderers.transport.penumbra.build import Slope, build, warm_up

        warm_up()
        made = build(
            self.world, self.lamp, self.lamp.points(samples, 0), resolution=resolution, map_resolution=maps,
            how=Construction(**{"bias": BIAS, **how}), slope=Slope(), casters=self.casters, counters=counters,
        )  # fmt: skip
        (one,) = made.maps
        return one


def stage_of(model: Model, side: float = LIGHT) -> Stage:
    """The stage of a model under a square light of `side` units."""
    from renderers.transport.penumbra.emitters import emitters_of

    low, high = model.vertices.min(axis=0), model.vertices.max(axis=0)
    middle = np.array([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
    b = SceneBuilder(model.name)
    ground, stone = b.material(Lambert("ground", (0.6, 0.6, 0.6))), b.material(Lambert("model", (0.7, 0.7, 0.7)))
    lamp = b.material(Lambert("lamp", (0.0, 0.0, 0.0), emission=(5.0, 5.0, 5.0), double_sided=False))
    g, h = GROUND / 2, side / 2
    b.quad([(-g, 0, g), (g, 0, g), (g, 0, -g), (-g, 0, -g)], ground)
    b.node(meshes=(b.mesh((model.vertices - middle) * (SIZE / (high - low).max()), model.triangles, stone),))
    b.quad([(-h, HEIGHT, -h), (h, HEIGHT, -h), (h, HEIGHT, h), (-h, HEIGHT, h)], lamp)
    b.camera((9.0, 9.0, 13.0), (0, 1.5, 0), 0.75)
    world = b.build().world()
    return Stage(model.name, world, emitters_of(world)[0], world.material == stone)


def scanned_model(bench: Bench) -> Model:
    """The scanned model of the scene folder, or the knotted tube."""
    try:
        world = bench.open(SCANNED).scene.world()
    except SceneError:
        return knot()
    instance = int(np.bincount(world.instance).argmax())
    rows = world.triangles[world.instance == instance]
    used, triangles = np.unique(rows, return_inverse=True)
    return Model(f"{SCANNED} (scanned)", world.positions[used].astype(np.float64), triangles.reshape(-1, 3))


def knot(segments: int = 1000, sides: int = 56) -> Model:
    """A trefoil tube with a rough skin, 2 · segments · sides triangles: dense, and full of its own shadow."""
    t = np.linspace(0, 2 * np.pi, segments, endpoint=False)[:, None]
    centre = np.concatenate([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -1.2 * np.sin(3 * t)], axis=1)
    along = np.roll(centre, -1, axis=0) - np.roll(centre, 1, axis=0)
    across = np.cross(along, centre + np.array([0.1, 0.2, 5.0]))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    up = np.cross(across, along)
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    a = np.linspace(0, 2 * np.pi, sides, endpoint=False)[None, :]
    radius = 0.55 + 0.04 * np.sin(11 * a + 60 * t) * np.sin(90 * t)
    ring = across[:, None] * (radius * np.cos(a))[..., None] + up[:, None] * (radius * np.sin(a))[..., None]
    i, j = (x.ravel() for x in np.meshgrid(np.arange(segments), np.arange(sides), indexing="ij"))
    after, beside = (i + 1) % segments, (j + 1) % sides
    quad = [p * sides + q for p, q in ((i, j), (after, j), (after, beside), (i, beside))]
    triangles = np.concatenate([np.stack([quad[0], quad[1], quad[2]], axis=1), np.stack([quad[0], quad[2], quad[3]], axis=1)])
    return Model("knotted tube (procedural)", (centre[:, None] + ring).reshape(-1, 3), triangles)


def foliage(bench: Bench) -> Model:
    """The tree of the built-in scene `leaves`, without its backdrop and lamp."""
    world = bench.open("leaves").scene.world()
    plain = world.material != world.material[world.emissive[0]]
    sizes = world.positions[world.triangles].astype(np.float64)
    # the backdrop's triangles are the widest things on stage
    wide = np.ptp(sizes, axis=1).max(axis=1)
    bark = plain & (wide < 0.2)
    used, triangles = np.unique(world.triangles[bark], return_inverse=True)
    return Model("leaves (built-in)", world.positions[used].astype(np.float64), triangles.reshape(-1, 3))


def ball(stacks: int = 64) -> Model:
    """A sphere."""
    from renderers.scene.shapes import sphere

    positions, _, triangles = sphere(1.0, 2 * stacks, stacks)
    return Model("sphere", positions.astype(np.float64), triangles)


def bytes_of_steps(made: PenumbraMap) -> int:
    """Bytes of an uncompressed map with one vertex a change, 8 bytes each, and 4 a pixel: in memory a change has two."""
    counts = np.diff(made.start)
    return int(8 * ((counts + 1) // 2).sum() + 4 * len(counts))


def peak_bytes(work: Callable[[], object]) -> int:
    """How far the resident memory of this process rises during a call, beyond what it held before."""
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    before = _status("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")
    result = work()
    peak = _status("VmHWM")
    del result
    return max(peak - before, 0)


def _status(field: str) -> int:
    """Bytes that the kernel reports for this process."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(field + ":"))
