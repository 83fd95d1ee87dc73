"""Dynamic point resampling on the GPU (Laurent 2018, chapter 5): a pass over all triangles, one over the parts of large ones.

Pass 1, vertex and geometry shader: a triangle no larger than one point's area is dropped or becomes one point; larger ones go into
a buffer, cut into four until the tessellator's largest level is enough. Pass 2, tessellation and geometry shader, an indirect draw
of that buffer: each part is treated as a triangle of its own. Points go into a buffer in no fixed order. Every OpenGL 4.3 has these
stages.

The CPU twin is `renderers.transport.resampling.points.resample`, with the same numbers: the same points where the tessellator has
the same diagonals (see `transport/resampling/pattern.py`), and points of the same law anywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple, SupportsInt

import numpy as np
from numpy.typing import NDArray

from renderers.gl import passes
from renderers.gl.context import check, context
from renderers.gl.programs import assign, source
from renderers.gl.upload import upload
from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Lambert
from renderers.scene.world import World

POINT = np.dtype(
    [("triangle", "u4"), ("numbers", "u4", 2), ("chance", "f4"), ("weight", "f4"), ("u", "f4"), ("v", "f4"), ("unused", "f4")]
)
HEAD = 32
PATCH_BYTES = 32
POINTS, PATCHES = 6, 7
# Patches of one instance of the second pass. llvmpipe numbers the vertices that tessellation makes of an instance with 16 bits, and
# draws wrong triangles beyond them, without an error; a patch of level 64 makes 3169 of them.
GROUP = 16
ROOM = 1 << 16


class Drawn(NamedTuple):
    """Points in no fixed order: triangle int64 (N,), u, v float32 (N,), numbers uint64 (N, 2), chance, weight float32 (N,)."""

    triangle: NDArray[np.int64]
    u: NDArray[np.float32]
    v: NDArray[np.float32]
    numbers: NDArray[np.uint64]
    chance: NDArray[np.float32]
    weight: NDArray[np.float32]


def resample(
    world: World,
    area: float,
    keys: Sequence[SupportsInt],
    shift: tuple[int, int] = (0, 0),
    *,
    even: bool = True,
    carry: bool = True,
    indirect: bool = True,
    patches: int | None = None,
) -> Drawn:
    """Points of one per `area` (World units²) on average.

    keys, shift: 32-bit integers, see `transport.resampling`. even, carry: False shows what the thesis's rules lose. indirect: the
    second pass draws as many patches as the first one counted, without the CPU. patches: room for so many; the triangles that don't
    fit get one point each, with all their weight (on a GPU, which ones these are is a race). Raises ValueError unless area > 0,
    GLError.
    """
    if not area > 0:
        raise ValueError(f"the area of one point must be positive, got {area}")
    uniforms = {
        "keys": tuple(int(k) for k in keys),
        "shift": shift,
        "inverse_area": float(np.float32(1 / area)),
        "even": even,
        "carry": carry,
    }
    capacity, room = ROOM, ROOM if patches is None else patches
    while True:
        found, wanted, rows = _run(world, uniforms, capacity, room, indirect)
        if found <= capacity and (wanted <= room or patches is not None):
            return Drawn(
                rows["triangle"].astype(np.int64), rows["u"].copy(), rows["v"].copy(), rows["numbers"].astype(np.uint64),
                rows["chance"].copy(), rows["weight"].copy(),
            )  # fmt: skip
        capacity, room = max(capacity, found), max(room, wanted)


@cache
def warm_up() -> None:
    """Compile the shaders of both passes, by drawing two large triangles and a small one; once a process."""
    b = SceneBuilder("warm-up")
    material = b.material(Lambert())
    b.quad([(-1, 0, 1), (1, 0, 1), (1, 0, -1), (-1, 0, -1)], material)
    b.node(meshes=(b.mesh([(0, 0, 0), (0.1, 0, 0), (0, 0, 0.1)], [[0, 1, 2]], material),))
    b.camera((0, 1, 0), (0, 0, 0), 1.0, up=(0, 0, 1))
    resample(b.build().world(), 0.1, (0, 0))


def _run(world: World, uniforms: dict[str, Any], capacity: int, room: int, indirect: bool) -> tuple[int, int, NDArray[Any]]:
    """Both passes: points found, patches wanted, and the points that fitted."""
    ctx, (whole, parts) = context(), _programs()
    uploaded, target = upload(world), passes.accumulator((1, 1))
    points = ctx.buffer(_head(0, capacity) + bytes(POINT.itemsize * capacity))
    patches = ctx.buffer(_head(3 * GROUP, 0, 0, 0, 0, room) + bytes(PATCH_BYTES * (room + GROUP)))
    points.bind_to_storage_buffer(POINTS)
    patches.bind_to_storage_buffer(PATCHES)
    for program in (whole, parts):
        assign(program, **uniforms)
    passes.draw(target, uploaded.vertex_array(whole, "in_position"), "resample", vertices=3 * uploaded.triangles)
    ctx.memory_barrier()
    _draw_patches(target, ctx.vertex_array(parts, []), patches, indirect)
    ctx.memory_barrier()
    found, wanted = _word(points, 0), _word(patches, 4)
    kept = min(found, capacity)
    rows = np.frombuffer(points.read(POINT.itemsize * kept, offset=HEAD), POINT) if kept else np.empty(0, POINT)
    for buffer in (points, patches):
        buffer.release()
    passes.release(target, *target.color_attachments)
    return found, wanted, rows


def _draw_patches(target: Any, geometry: Any, patches: Any, indirect: bool) -> None:
    """The second pass: as many instances as the second word of `patches` says."""
    import moderngl

    ctx = context()
    ctx.patch_vertices = 3
    if indirect:
        target.use()
        geometry.render_indirect(patches, mode=moderngl.PATCHES, count=1)
        check(ctx, "resample parts")
        return
    if groups := _word(patches, 1):
        passes.draw(target, geometry, "resample parts", mode=moderngl.PATCHES, vertices=3 * GROUP, instances=groups)


def _word(buffer: Any, index: int) -> int:
    return int(np.frombuffer(buffer.read(4, offset=4 * index), np.uint32)[0])


def _source(name: str) -> str:
    return source(name, "", (f"GROUP {GROUP}u",))


def _head(*words: int) -> bytes:
    """The first HEAD bytes of a buffer."""
    return np.array([*words, *[0] * (HEAD // 4 - len(words))], np.uint32).tobytes()


@cache
def _programs() -> tuple[Any, Any]:
    """Both passes' programs. Nothing is ever rasterised, but a program must have a fragment shader."""
    nothing = source("nothing.frag.glsl")
    whole = context().program(
        vertex_shader=_source("resample.vert.glsl"), geometry_shader=_source("resample.geom.glsl"), fragment_shader=nothing
    )
    parts = context().program(
        vertex_shader=_source("resample_patch.vert.glsl"),
        tess_control_shader=_source("resample_patch.tesc.glsl"),
        tess_evaluation_shader=_source("resample_patch.tese.glsl"),
        geometry_shader=_source("resample_patch.geom.glsl"),
        fragment_shader=nothing,
    )
    return whole, parts
