"""Light of a `LightTree` at every pixel: backward cuts, with or without shadow rays. World units."""

from __future__ import annotations

from collections import Counter
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.scene.world import World
from renderers.transport.gather import Pixels, one_receiver, pixels_of
from renderers.transport.kernels import Receivers
from renderers.transport.light_tree import LightTree, build
from renderers.transport.raycast import RayCaster, segments_blocked
from renderers.transport.sampling import generator
from renderers.transport.tree_kernels import add_listed, solid_angle_cut, stochastic_cut
from renderers.transport.vpl import Vpls

F32 = NDArray[np.float32]
PAIRS = 1 << 20
NOTHING = np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros(0)


def gather_solid_angle(
    gbuffer: GBuffer,
    world: World,
    tree: LightTree,
    area: float,
    threshold: float,
    eps_b: float,
    counters: Counter[str],
    caster: RayCaster | None = None,
) -> F32:
    """Each pixel's cut by solid angle, float32 (H, W, 3). area: of one light; threshold: ε_Ω in sr.

    With a caster each node's mean position is tested for occlusion. counters: adds `light_evaluations` (nodes of cuts),
    `nodes_visited` and `rays`.
    """
    return _walked(gbuffer, world, tree, (area, threshold), eps_b, counters, False, caster)


def gather_stochastic(
    gbuffer: GBuffer,
    world: World,
    tree: LightTree,
    cut_size: int,
    tolerance: float,
    seed: int,
    eps_b: float,
    counters: Counter[str],
    caster: RayCaster | None = None,
) -> F32:
    """One sampled light for each node of each pixel's cut, float32 (H, W, 3); caster and counters as above, of lights."""
    key = int(generator(seed, "stochastic lightcuts").integers(1 << 63))
    return _walked(gbuffer, world, tree, (cut_size, tolerance, np.uint64(key)), eps_b, counters, True, caster)


@cache
def warm_up() -> None:
    """Compile (or load from numba's cache) tree building and both walks; once a process."""
    one = np.array([[0, 0, 1.0]], np.float32)
    tree = build(Vpls(np.concatenate([one, one]), np.concatenate([one, one]), np.ones((2, 3), np.float32), np.arange(2), 2))
    pixels, tail = doubled(one_receiver()), (0, 0, *NOTHING, 1e-4, np.zeros((0, 3)), np.zeros((0, 2), np.int64))
    solid_angle_cut(pixels, tree, 1.0, 0.1, *tail)
    stochastic_cut(pixels, tree, 4, 0.1, np.uint64(1), *tail)
    add_listed(pixels, tree, *tail[:-1])


def doubled(pixels: Receivers) -> Receivers:
    """Receivers as the walks read them: position and normal in float64."""
    return pixels._replace(position=pixels.position.astype(np.float64), normal=pixels.normal.astype(np.float64))


def _walked(
    gbuffer: GBuffer,
    world: World,
    tree: LightTree,
    arguments: tuple[float | np.uint64, ...],
    eps_b: float,
    counters: Counter[str],
    stochastic: bool,
    caster: RayCaster | None,
) -> F32:
    pixels = pixels_of(gbuffer, world)
    count = len(pixels.rows)
    total, work = np.zeros((count, 3)), np.zeros((count, 2), np.int64)
    kernel: Any = stochastic_cut if stochastic else solid_angle_cut
    receivers = doubled(pixels.receivers)
    if caster is None or not stochastic:
        # lists of cuts that go by solid angle are as long as this says
        kernel(receivers, tree, *arguments, 0, count, *NOTHING, float(eps_b), total, work)
    if caster is not None:
        total[:] = 0
        longest = int(arguments[0]) + len(tree.roots)
        lengths = np.full(count, longest) if stochastic else work[:, 0].copy()
        ends = np.concatenate([[0], np.cumsum(lengths)])
        begin = 0
        while begin < count:
            end = max(begin + 1, int(np.searchsorted(ends, ends[begin] + PAIRS, "right")) - 1)
            places = ends - ends[begin]
            listed, factors = np.full(places[end], -1, np.int32), np.ones(places[end])
            kernel(receivers, tree, *arguments, begin, end, places, listed, factors, float(eps_b), total, work)
            own = np.repeat(np.arange(begin, end), lengths[begin:end])
            counters["rays"] += _drop_blocked(caster, pixels, tree, own, listed)
            add_listed(receivers, tree, begin, end, places, listed, factors, float(eps_b), total)
            begin = end
    counters["light_evaluations"] += int(work[:, 0].sum())
    counters["nodes_visited"] += int(work[:, 1].sum())
    image = np.zeros((gbuffer.triangle.size, 3), np.float32)
    image[pixels.rows] = total
    return image.reshape(*gbuffer.triangle.shape, 3)


def _drop_blocked(caster: RayCaster, pixels: Pixels, tree: LightTree, own: NDArray[np.int64], listed: NDArray[np.int32]) -> int:
    """Make -1 of those listed nodes (E,) that pixels `own` (E,) don't see; returns the number of rays, one for each facing pair."""
    pairs = np.flatnonzero(listed >= 0)
    towards = tree.position[listed[pairs]] - pixels.position[own[pairs]]
    faces = (np.einsum("ij,ij->i", towards, pixels.normal[own[pairs]]) > 0) & (
        np.einsum("ij,ij->i", towards, tree.normal[listed[pairs]]) < 0
    )
    pairs = pairs[faces]
    normal = tree.normal[listed[pairs]]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    pixel, target = own[pairs], tree.position[listed[pairs]]
    blocked = segments_blocked(caster, pixels.position[pixel], pixels.geometric[pixel], target, normal)
    listed[pairs[blocked]] = -1
    return len(pairs)
