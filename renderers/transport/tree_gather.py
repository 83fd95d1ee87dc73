"""Light of a `LightTree` at every pixel: backward cuts. Unoccluded; World units."""

from __future__ import annotations

from collections import Counter
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.scene.world import World
from renderers.transport.gather import pixels_of
from renderers.transport.light_tree import LightTree, build
from renderers.transport.sampling import generator
from renderers.transport.tree_kernels import solid_angle_cut, stochastic_cut
from renderers.transport.vpl import Vpls

F32 = NDArray[np.float32]


def gather_solid_angle(
    gbuffer: GBuffer, world: World, tree: LightTree, area: float, threshold: float, eps_b: float, counters: Counter[str]
) -> F32:
    """Each pixel's cut by solid angle, float32 (H, W, 3). area: of one light; threshold: ε_Ω in sr.

    counters: adds `light_evaluations` (nodes of cuts) and `nodes_visited`.
    """
    return _walked(gbuffer, world, tree, (area, threshold), eps_b, counters, False)


def gather_stochastic(
    gbuffer: GBuffer,
    world: World,
    tree: LightTree,
    cut_size: int,
    tolerance: float,
    seed: int,
    eps_b: float,
    counters: Counter[str],
) -> F32:
    """One sampled light for each node of each pixel's cut, float32 (H, W, 3); counters as above."""
    key = int(generator(seed, "stochastic lightcuts").integers(1 << 63))
    return _walked(gbuffer, world, tree, (cut_size, tolerance, np.uint64(key)), eps_b, counters, True)


@cache
def warm_up() -> None:
    """Compile (or load from numba's cache) tree building and both walks; once a process."""
    one = np.array([[0, 0, 1.0]], np.float32)
    tree = build(Vpls(np.concatenate([one, one]), np.concatenate([one, one]), np.ones((2, 3), np.float32), np.arange(2), 2))
    pixel = (np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, np.int32), np.zeros((0, 3)), np.zeros((0, 3)))
    tail = (1e-4, np.zeros((0, 3)), np.zeros((0, 2), np.int64))
    number = np.zeros(0)
    solid_angle_cut(*pixel, number, number, number, *tree, 1.0, 0.1, *tail)
    stochastic_cut(*pixel, number, number, number, *tree, 4, 0.1, np.uint64(1), *tail)


def _walked(
    gbuffer: GBuffer,
    world: World,
    tree: LightTree,
    arguments: tuple[float | np.uint64, ...],
    eps_b: float,
    counters: Counter[str],
    stochastic: bool,
) -> F32:
    pixels = pixels_of(gbuffer, world)
    total, work = np.zeros((len(pixels.rows), 3)), np.zeros((len(pixels.rows), 2), np.int64)
    kernel: Any = stochastic_cut if stochastic else solid_angle_cut
    position, normal = pixels.position.astype(np.float64), pixels.normal.astype(np.float64)
    kernel(position, normal, pixels.view, *pixels.materials, *tree, *arguments, float(eps_b), total, work)
    counters["light_evaluations"] += int(work[:, 0].sum())
    counters["nodes_visited"] += int(work[:, 1].sum())
    image = np.zeros((gbuffer.triangle.size, 3), np.float32)
    image[pixels.rows] = total
    return image.reshape(*gbuffer.triangle.shape, 3)
