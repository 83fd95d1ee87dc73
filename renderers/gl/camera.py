"""Matrices from World to GL's clip space, with depth reversed and far at infinity: depth = near / distance.

Reversed floating-point depth resolves a relative 6·10⁻⁸ at any distance, so there is no far plane to fit and near may be small.
"""

from __future__ import annotations

import numpy as np

from renderers.scene.world import F64, World


def perspective(tangents: tuple[float, float], near: float, *, zero_to_one: bool) -> F64:
    """Projection (4, 4) of a pinhole looking along -Z.

    `tangents`: of the half angles in x and y (negative turns the picture over).
    """
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[1, 1] = 1 / tangents[0], 1 / tangents[1]
    matrix[3, 2] = -1.0
    # Without clip control GL maps [-1, 1] to [0, 1]; either way the stored depth is near / distance.
    matrix[2, 2:] = (0.0, near) if zero_to_one else (1.0, 2 * near)
    return matrix


def orthographic(centre: F64, half: F64, depth: tuple[float, float], *, zero_to_one: bool) -> F64:
    """Projection (4, 4) of parallel rays along -Z over centre ± half in x and y; stored depth falls from 1 to 0 over `depth`."""
    near, far = depth
    matrix = np.eye(4)
    matrix[[0, 1], [0, 1]] = 1 / half
    matrix[[0, 1], 3] = -centre / half
    matrix[2, 2], matrix[2, 3] = 1 / (far - near), far / (far - near)
    if not zero_to_one:
        matrix[2] = 2 * matrix[2] - matrix[3]
    return matrix


def view(pose: F64) -> F64:
    """World to camera, (4, 4), of a rigid camera-to-world pose."""
    matrix = np.eye(4)
    matrix[:3, :3] = pose[:3, :3].T
    matrix[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return matrix


def tangents(world: World, size: tuple[int, int]) -> tuple[float, float]:
    """Tangents of the camera's half angles in x and y."""
    y = float(np.tan(world.camera.yfov / 2))
    return y * size[0] / size[1], y


def shift(size: tuple[int, int], offset: tuple[float, float]) -> tuple[float, float]:
    """Clip-space shift that brings sample `offset` of each pixel to its centre.

    The offset is counted from the pixel's upper left; the picture's top is at the bottom of GL's window.
    """
    return (1 - 2 * offset[0]) / size[0], (1 - 2 * offset[1]) / size[1]


def world_to_clip(world: World, size: tuple[int, int], offset: tuple[float, float], *, zero_to_one: bool) -> F64:
    """Matrix (4, 4) of the World's camera, picture upside down in GL's window so that row 0 is the top."""
    x, y = tangents(world, size)
    moved = np.eye(4)
    moved[:2, 3] = shift(size, offset)
    return moved @ perspective((x, -y), world.clip[0], zero_to_one=zero_to_one) @ view(world.camera.pose)


def column_major(matrix: F64) -> bytes:
    """Float32 bytes of a matrix as GLSL uniforms take them."""
    return np.ascontiguousarray(matrix.T, np.float32).tobytes()
