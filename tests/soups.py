"""Worlds of plain triangles, for what reads positions and triangles alone."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

import renderers
from renderers.scene.shapes import sphere
from renderers.scene.world import World


@cache
def _room() -> World:
    return renderers.load_scene("empty-room").world()


def soup(positions: ArrayLike, triangles: ArrayLike) -> World:
    """A World of these triangles, of one material, degenerate ones included."""
    p, t = np.asarray(positions, np.float32), np.asarray(triangles, np.int32)
    up = np.tile(np.float32([0, 1, 0]), (len(p), 1))
    none = np.zeros(len(t), np.int32)
    return replace(_room(), positions=p, normals=up, uvs=up[:, :2], triangles=t, material=none, instance=none)


def apart(corners: ArrayLike) -> World:
    """Triangles (T, 3, 3) with three vertices of their own each."""
    p = np.asarray(corners, np.float32).reshape(-1, 3)
    return soup(p, np.arange(len(p)).reshape(-1, 3))


def equal_triangles(count: int, area: float = 1.0) -> World:
    """Separate right triangles of one area, all in one place."""
    side = (2 * area) ** 0.5
    return apart(np.tile([[[0, 0, 0], [side, 0, 0], [0, side, 0]]], (count, 1, 1)))


def ellipsoid(segments: int, rings: int) -> World:
    """A closed mesh of unequal triangles: 2 · segments · (rings - 1) of them."""
    positions, _, triangles = sphere(0.5, segments, rings, exact_area=False)
    return soup(positions * np.float32([1.0, 1.6, 0.6]), triangles)


def mixed(fine: int = 128) -> World:
    """A sphere of very many triangles in a box of twelve."""
    ball, _, faces = sphere(0.25, fine, fine // 2)
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    walls = np.array([[q[0], q[1], q[2]] for q in quads] + [[q[0], q[2], q[3]] for q in quads])
    return soup(np.concatenate([ball, corners]), np.concatenate([faces, walls + len(ball)]))


def positions_of(world: World, points: object) -> np.ndarray:
    """Where resampled points lie, float64 (N, 3)."""
    p = world.positions[world.triangles[points.triangle]].astype(np.float64)  # type: ignore[attr-defined]
    u, v = points.u[:, None].astype(np.float64), points.v[:, None].astype(np.float64)  # type: ignore[attr-defined]
    return np.asarray(p[:, 0] + u * (p[:, 1] - p[:, 0]) + v * (p[:, 2] - p[:, 0]))
