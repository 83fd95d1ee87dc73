"""Rotations as the builder writes them down."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from renderers.scene.builder import look_rotation

RNG = np.random.default_rng(4)


@pytest.mark.parametrize("up", [(0, 1, 0), (1, 2, 3)])
def test_looking_turns_the_axes(up: tuple[float, float, float]) -> None:
    for direction in (*RNG.standard_normal((20, 3)), np.array(up, float)):
        turn = Rotation.from_quat(look_rotation(direction, up))
        towards = direction / np.linalg.norm(direction)
        # rounding of a few float64 operations on numbers of size 1
        np.testing.assert_allclose(turn.apply([0, 0, -1]), towards, atol=1e-14)
        across = np.cross(towards, up)
        if np.linalg.norm(across) > 1e-9:
            np.testing.assert_allclose(turn.apply([1, 0, 0]), across / np.linalg.norm(across), atol=1e-14)
