"""Revealed pixels against what G-buffers of the frames show, where the camera stands still, and against the image's edge."""

from __future__ import annotations

import numpy as np
import pytest

from renderers import Scene
from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Lambert
from renderers.transport.primary import cast_gbuffer
from renderers.transport.revealed import revealed

SIZE = (48, 32)
TIMES = np.arange(13) / 24


def room(*, camera_moves: bool = False) -> Scene:
    """A card that slides to the right before a wall, 0.1 a frame; or one that stands still, and a camera that moves so."""
    b = SceneBuilder("slide")
    paint = b.material(Lambert())
    b.quad([(-4, -3, -1), (4, -3, -1), (4, 3, -1), (-4, 3, -1)], paint)
    moved = b.quad([(-0.3, -0.3, 0), (0.3, -0.3, 0), (0.3, 0.3, 0), (-0.3, 0.3, 0)], paint)
    path = np.column_stack([0.1 * np.arange(13), np.zeros(13), np.zeros(13)])
    camera = b.camera((0, 0, 3), (0, 0, 0), np.radians(50))
    b.animate(camera if camera_moves else moved, "translation", TIMES, path + ([0, 0, 3] if camera_moves else [0, 0, 0]))
    return b.build()


@pytest.mark.parametrize(("frame", "begin", "looked_at"), [(1, 0, (0,)), (6, 0, (5, 4, 2)), (9, 0, (8, 7, 5, 1)), (6, 5, (5,))])
def test_pixels_that_saw_the_moving_card_a_few_frames_ago(frame: int, begin: int, looked_at: tuple[int, ...]) -> None:
    scene = room()
    wall = {n: cast_gbuffer(scene.world(n), SIZE).triangle < 2 for n in (frame, *looked_at)}
    expected = wall[frame] & ~np.logical_and.reduce([wall[n] for n in looked_at])
    assert expected.any()
    assert np.array_equal(revealed(scene, frame, SIZE, begin), expected)


def test_what_a_moving_camera_had_outside_of_its_image() -> None:
    scene = room(camera_moves=True)
    found = revealed(scene, 1, SIZE)
    assert found is not None
    # The wall is 4 away from the camera and moves out of the image by 0.1: so much of its width 2 · 4 · tan 25° · 48/32 is new.
    columns = 0.1 / (2 * 4 * np.tan(np.radians(25)) * 48 / 32) * 48
    new = found[:, ::-1].argmin(axis=1)
    assert np.all(np.abs(new - columns) <= 1)


@pytest.mark.parametrize(("frame", "begin"), [(0, 0), (3, 3)])
def test_a_sequence_begins_with_nothing_known(frame: int, begin: int) -> None:
    assert revealed(room(), frame, SIZE, begin) is None


def test_nothing_is_revealed_where_nothing_moves() -> None:
    b = SceneBuilder("still")
    b.quad([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], b.material(Lambert()))
    b.camera((0, 0, 3), (0, 0, 0), np.radians(50))
    assert revealed(b.build(), 5, SIZE) is None
