"""Additive splatting: each item reaches the pixels whose surface lies inside its sphere, and adds what a GLSL snippet says.

Three compute passes: bounds around what tiles of 8 × 8 pixels see, and around blocks of 4 × 4 tiles; lists of the items that may
reach a block, and of those the ones that may reach a tile; then each pixel adds up the list of its tile in registers. Bounds lie in
the World, so an item behind the camera, around it or half off the screen needs no special case. Items are added in their order:
the bytes don't depend on threads.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.gl import passes
from renderers.gl.context import check, context
from renderers.gl.gbuffer import ResidentGBuffer, on_gpu
from renderers.gl.programs import assign, compute
from renderers.scene.world import LAMBERT, World

SIDE, BLOCK = 8, 4
ROW = 1024
NODES, LISTS, ITEM_UNIT = 4, 5, 4
NODE = np.dtype([("ball", "f4", 4), ("facing", "f4", 4), ("floor", "f4"), ("count", "i4"), ("unused", "i4", 2)])
GROUP = (8, 4)
LIST_WORDS = 1 << 23
MOST, FEWEST = 8192, 64


class _Grids(NamedTuple):
    """Blocks and tiles of a picture, (columns, rows) each; blocks come first in the buffers."""

    blocks: tuple[int, int]
    tiles: tuple[int, int]

    @property
    def first_tile(self) -> int:
        return self.blocks[0] * self.blocks[1]

    @property
    def nodes(self) -> int:
        return self.first_tile + self.tiles[0] * self.tiles[1]


def splat(
    gbuffer: GBuffer | ResidentGBuffer,
    world: World,
    centres: NDArray[np.floating],
    radii: NDArray[np.floating],
    payload: NDArray[np.floating],
    snippet: str,
    uniforms: Mapping[str, Any] | None = None,
    defines: tuple[str, ...] = (),
) -> tuple[NDArray[np.float32], int]:
    """Sum over items of `contribution` in each pixel, float32 (H, W, 4), and the number of (pixel, item) pairs computed.

    centres (N, 3), radii (N,): World units. payload (N, K): floats, four of which are one `payload(item, k)`.
    snippet: GLSL with `struct Item`, `Item item_at(int item)`, `bool misses(Node node, int item)`, true only where the item brings
    nothing to a whole node, and `vec4 contribution(Receiver receiver, Item item)`, 0 outside the sphere. `item_texel(item, 0)` is
    centre and radius; shaders/receiver.glsl and tiles.glsl are in scope, and so are its own uniforms and `defines`. Raises
    moderngl.Error on bad GLSL, GLError.
    """
    with on_gpu(gbuffer, world) as resident:
        target = passes.accumulator(resident.size)
        pairs = 0
        if len(centres):
            programs = _programs(world, snippet, defines)
            for program in programs:
                resident.bind(program)
                assign(program, item_map=ITEM_UNIT, **(uniforms or {}))
            items = np.column_stack([centres, radii, payload]).astype(np.float32)
            pairs = _passes(resident.size, programs, items, target.color_attachments[0])
        image = passes.read(target.color_attachments[0]).copy()
        passes.release(target, *target.color_attachments)
    return image, pairs


def is_diffuse(world: World) -> bool:
    """Whether all surfaces are Lambertian, which takes a shader of its own."""
    return bool(np.all(world.materials.kind[np.unique(world.material)] == LAMBERT))


def _programs(world: World, snippet: str, defines: tuple[str, ...]) -> tuple[Any, Any, Any]:
    defines = defines if is_diffuse(world) else (*defines, "FULL_BRDF")
    return (
        compute("tile_bounds.comp.glsl"),
        compute("tile_lists.comp.glsl", snippet, defines),
        compute("splat.comp.glsl", snippet, defines),
    )


def _passes(size: tuple[int, int], programs: tuple[Any, Any, Any], items: NDArray[np.float32], sums: Any) -> int:
    """All passes over items (N, 4 + K), in batches whose lists fit into LIST_WORDS. Returns the number of pairs computed."""
    ctx, (bounds, lists, add) = context(), programs
    side = SIDE * BLOCK
    grids = _Grids((-(-size[0] // side), -(-size[1] // side)), (-(-size[0] // SIDE), -(-size[1] // SIDE)))
    capacity = min(MOST, max(FEWEST, LIST_WORDS // grids.nodes), len(items))
    nodes = ctx.buffer(reserve=NODE.itemsize * grids.nodes)
    room = ctx.buffer(reserve=4 * capacity * grids.nodes)
    nodes.bind_to_storage_buffer(NODES)
    room.bind_to_storage_buffer(LISTS)
    sums.bind_to_image(0, read=True, write=True)
    _run(bounds, grids.blocks, side=side, first=0)
    _run(bounds, grids.tiles, side=SIDE, first=grids.first_tile)
    pairs = 0
    for start in range(0, len(items), capacity):
        batch = items[start : start + capacity]
        texture, texels = _item_map(batch)
        texture.use(ITEM_UNIT)
        for program in (lists, add):
            assign(program, capacity=capacity, texels=texels)
        _run(lists, grids.blocks, first=0, parents=0, ratio=1, items=len(batch))
        _run(lists, grids.tiles, first=grids.first_tile, parents=grids.blocks[0], ratio=BLOCK)
        _run(add, grids.tiles, per_group=(1, GROUP[1]), first=grids.first_tile)
        counts = np.frombuffer(nodes.read(), NODE)["count"]
        pairs += SIDE * SIDE * int(counts[grids.first_tile :].sum(dtype=np.int64))
        texture.release()
    check(ctx, "splat")
    for buffer in (nodes, room):
        buffer.release()
    return pairs


def _run(program: Any, grid: tuple[int, int], *, per_group: tuple[int, int] = GROUP, **uniforms: Any) -> None:
    """Dispatch over all nodes of a grid, and wait for what it writes before what comes next reads it."""
    assign(program, grid=grid, **uniforms)
    program.run(-(-grid[0] // per_group[0]), -(-grid[1] // per_group[1]))
    context().memory_barrier()


def _item_map(items: NDArray[np.float32]) -> tuple[Any, int]:
    """RGBA32F texture ROW texels wide with items (n, F), each in so many texels, and that number.

    Its sides are powers of two: one compiled shader serves all on llvmpipe.
    """
    texels = -(-items.shape[1] // 4)
    rows = 1 << (-(-len(items) * texels // ROW) - 1).bit_length()
    padded = np.zeros((rows * ROW * 4), np.float32)
    padded[: len(items) * texels * 4].reshape(len(items), -1)[:, : items.shape[1]] = items
    return context().texture((ROW, rows), 4, padded.tobytes(), dtype="f4"), texels
