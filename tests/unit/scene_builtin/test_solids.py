"""Shapes: volume by the divergence theorem (sign = orientation), area, normals."""

from __future__ import annotations

import numpy as np
import pytest

from renderers.scene.builtin import solids
from renderers.scene.shapes import Shape, sphere


def volume(shape: Shape) -> float:
    p = shape[0][shape[2]].astype(np.float64)
    return float(np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2])).sum() / 6)


def test_box_is_closed_outward_and_cut_into_cells() -> None:
    shape = solids.box((1, 2, 3), (2, 4, 7), cell=0.5)
    assert volume(shape) == pytest.approx(8)
    assert solids.area(shape) == pytest.approx(2 * (2 + 4 + 8))
    assert len(shape[2]) == 2 * 2 * (2 * 4 + 2 * 8 + 4 * 8)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_lathe_faces_outwards_about_every_axis(axis: str) -> None:
    positions, normals, _ = shape = solids.lathe([(1, 0), (1, 2)], 200, axis)
    assert solids.area(shape) == pytest.approx(4 * np.pi, rel=1e-3)
    k = "xyz".index(axis)
    radial = np.delete(positions, k, axis=1)
    np.testing.assert_allclose(np.delete(normals, k, axis=1), radial, atol=1e-5)
    assert positions[:, k].min() == 0
    assert positions[:, k].max() == 2


def test_lathe_has_no_seam() -> None:
    positions, normals, _ = solids.lathe([(1, 0), (0.5, 1)], 12)
    first, last = np.flatnonzero(np.isclose(positions[:, 0], 0) & (positions[:, 2] > 0))[:2]
    np.testing.assert_allclose(normals[first], normals[last], atol=1e-6)


def test_tube_faces_outwards_and_keeps_its_radius() -> None:
    path = np.column_stack([np.linspace(0, 3, 30), np.zeros(30), np.zeros(30)])
    positions, normals, _ = shape = solids.tube(path, np.full(30, 0.2), 64)
    assert solids.area(shape) == pytest.approx(2 * np.pi * 0.2 * 3, rel=2e-3)
    np.testing.assert_allclose(normals[:, 1:], positions[:, 1:] / 0.2, atol=1e-5)


def test_loft_closed_along_its_section_encloses_a_ring() -> None:
    angle = 2 * np.pi * np.arange(300) / 300
    unit = np.column_stack([np.cos(angle), np.sin(angle)])
    section = [(2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 0.0), (2.0, 0.0)]
    shape = solids.loft([np.column_stack([unit * r, np.full(300, z)]) for r, z in section])
    assert volume(shape) == pytest.approx(3 * np.pi, rel=1e-3)


def test_grid_front_is_row_step_cross_column_step_and_flipped_is_the_other_side() -> None:
    x, z = np.meshgrid(np.linspace(0, 1, 4), np.linspace(0, 1, 3))
    shape = solids.grid(np.stack([x, 0 * x, z], axis=-1))
    np.testing.assert_array_equal(shape[1], np.tile(np.array([0, 1, 0], np.float32), (12, 1)))
    p = solids.flipped(shape)[0][solids.flipped(shape)[2]]
    assert (np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])[:, 1] < 0).all()


def test_merge_and_moved_keep_area_and_volume() -> None:
    ball = sphere(1.0, 24, 12)
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    both = solids.merge(ball, solids.moved(ball, (5, 0, 0), turn))
    assert solids.area(both) == pytest.approx(2 * solids.area(ball), rel=1e-5)
    assert volume(both) == pytest.approx(2 * volume(ball), rel=1e-5)
    assert both[2].max() == len(both[0]) - 1
