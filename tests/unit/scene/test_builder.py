"""Rotations as the builder writes them down."""

from __future__ import annotations

import itertools
import subprocess
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from renderers.scene.builder import look_rotation, quaternion_of

RNG = np.random.default_rng(4)
AXES = [
    np.eye(3)[list(order)] * signs
    for order in itertools.permutations(range(3))
    for signs in itertools.product([1.0, -1.0], repeat=3)
]
TURNS = [m for m in AXES if np.linalg.det(m) > 0]  # with the half turns, whose w is 0
MATRICES = [*TURNS, *Rotation.random(1000, random_state=4).as_matrix()]


def test_quaternions_are_scipys() -> None:
    """To the last digit: they enter the hashes of scenes."""
    assert len(TURNS) == 24
    for matrix in MATRICES:
        # random matrices are orthogonal to rounding only; scipy's own way to the quaternion starts from what it is given, too
        expected = Rotation.from_matrix(matrix, assume_valid=True).as_quat(canonical=True)
        assert np.array(quaternion_of(matrix)).tobytes() == expected.tobytes()


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


def test_opening_a_scene_leaves_scipy_alone() -> None:
    """Its import takes longer than all else that a refusal, or a child that draws one colour, has to do."""
    code = "import sys, renderers; renderers.load_scene('cornell-box').hash; assert 'scipy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
