"""Cleaning triangles: what is dropped, what is computed anew, and that the count is told."""

import numpy as np
import pytest

from renderers.scene.geometry import Findings, cleaned, degenerate, first_of_each

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
UP = np.tile(np.array([0, 0, 1], np.float32), (4, 1))
TWO = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)


def test_clean_input_is_not_touched():
    p, n, t, uvs, found = cleaned(SQUARE, UP, TWO)
    assert (p is SQUARE, n is UP, uvs, found) == (True, True, None, Findings())
    assert t.tolist() == TWO.tolist()


@pytest.mark.parametrize("scale", [1e-18, 1.0, 1e15])
def test_zero_area_at_any_scale(scale):
    points = (np.array([[0, 0, 0], [0.1, 0.1, 0.1], [0.3, 0.3, 0.3], [1, 0, 0], [0.5, 1e-3, 0]]) * scale).astype(np.float32)
    triangles = np.array([[0, 1, 2], [0, 0, 3], [3, 3, 3], [0, 3, 4]])
    assert degenerate(points, triangles).tolist() == [True, True, True, False]


def test_duplicates_are_found_in_any_rotation_and_over_copied_vertices_but_not_turned_round():
    points = np.vstack([SQUARE, SQUARE]).astype(np.float32)
    points[4] = -0.0
    triangles = np.array([[0, 1, 2], [1, 2, 0], [4, 5, 6], [2, 1, 0], [0, 2, 3]], np.uint32)
    assert first_of_each(points, triangles).tolist() == [0, 3, 4]


def test_unusable_normals_come_from_the_faces_around():
    normals = UP * np.float32(1)
    normals[0], normals[1], normals[2] = np.nan, 0, (0, 0, 2)
    _, n, _, _, found = cleaned(SQUARE, normals, TWO)
    assert n.tolist() == UP.tolist()
    assert (found.bad_normals, found.scaled_normals) == (2, 1)


def test_a_vertex_without_faces_gets_some_unit_normal():
    normals = UP * np.float32(1)
    normals[3] = 0
    _, n, _, _, found = cleaned(SQUARE, normals, TWO[:1])
    assert np.linalg.norm(n[3]) == 1
    assert found.bad_normals == 1


def test_flat_normals_split_vertices_and_carry_texture_coordinates():
    uvs = SQUARE[:, :2].copy()
    p, n, t, split, found = cleaned(SQUARE, None, TWO, uvs)
    assert (len(p), found.missing_normals) == (6, 2)
    assert n.tolist() == [[0, 0, 1]] * 6
    assert p[t].tolist() == SQUARE[TWO].tolist()
    assert split.tolist() == p[:, :2].tolist()


def test_normals_against_the_winding_are_counted_and_kept():
    _, n, _, _, found = cleaned(SQUARE, -UP, TWO)
    assert n.tolist() == (-UP).tolist()
    assert found.against_winding == 2
