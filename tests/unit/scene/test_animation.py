"""Keyframes against their closed forms (glTF 2.0, appendix C)."""

import numpy as np
import pytest

from renderers.scene.animation import posed, sample, slerp
from renderers.scene.model import Camera, Channel, Node, PointLight, Scene


def channel(values, times=(1.0, 2.0, 4.0), path="translation", mode="LINEAR", target="node", index=0):
    return Channel(target, index, path, np.array(times, np.float64), np.array(values, np.float64), mode)


def turn(degrees):
    """Rotation about Y as a quaternion."""
    half = np.radians(degrees) / 2
    return np.array([0.0, np.sin(half), 0.0, np.cos(half)])


def test_step_keeps_the_value_until_the_next_key():
    moves = channel([[1, 0, 0], [2, 0, 0], [3, 0, 0]], mode="STEP")
    assert [sample(moves, t)[0] for t in (0, 1, 1.999, 2, 3.999, 4, 9)] == [1, 1, 1, 2, 2, 3, 3]


def test_linear_interpolates_and_holds_outside_the_keys():
    moves = channel([[0, 0, 0], [10, 0, 0], [30, 0, 0]])
    assert [sample(moves, t)[0] for t in (-5, 0, 1, 1.25, 2, 3, 4, 100)] == pytest.approx([0, 0, 0, 2.5, 10, 20, 30, 30])


def test_rotation_turns_at_constant_speed():
    turns = channel([turn(0), turn(90), turn(90)], path="rotation")
    assert sample(turns, 1.25) == pytest.approx(turn(22.5))
    assert sample(turns, 1.75) == pytest.approx(turn(67.5))


def test_rotation_takes_the_shorter_arc_whatever_the_sign():
    assert slerp(turn(10), -turn(50), 0.5) == pytest.approx(turn(30))
    assert slerp(turn(10), turn(10), 0.3) == pytest.approx(turn(10))


def test_cubic_spline_is_the_hermite_polynomial():
    # with tangents of the straight line a + 3t the spline is that line; with zero tangents it is smoothstep
    line = channel([[[3], [0], [3]], [[3], [6], [3]]], (0, 2), "yfov", "CUBICSPLINE", "camera")
    assert [sample(line, t)[0] for t in (0, 0.5, 1.7, 2)] == pytest.approx([0, 1.5, 5.1, 6])
    smooth = channel([[[0], [0], [0]], [[0], [1], [0]]], (0, 1), "yfov", "CUBICSPLINE", "camera")
    u = 0.3
    assert sample(smooth, u)[0] == pytest.approx(3 * u**2 - 2 * u**3)


def test_cubic_spline_rotation_is_unit():
    zero = np.zeros(4)
    turns = channel([[zero, turn(0), zero], [zero, turn(120), zero]], (0, 1), "rotation", "CUBICSPLINE")
    assert np.linalg.norm(sample(turns, 0.4)) == pytest.approx(1)
    assert sample(turns, 0.5) == pytest.approx(turn(60))


def test_a_single_key_is_a_constant():
    only = channel([[7, 0, 0]], (3.0,))
    assert [sample(only, t)[0] for t in (0, 3, 8)] == [7, 7, 7]


def test_posed_sets_each_property_at_frame_over_fps():
    scene = Scene(
        "s",
        nodes=(Node(), Node()),
        lights=(PointLight(),),
        cameras=(Camera(),),
        channels=(
            channel([[0, 0, 0], [24, 0, 0]], (0, 1), index=1),
            channel([[0], [48]], (0, 1), "intensity", target="light"),
            channel([[0, 0, 0], [1, 1, 1]], (0, 1), "color", target="light"),
            channel([[0.5], [1.0]], (0, 1), "yfov", target="camera"),
        ),
        fps=24.0,
    )
    frame = posed(scene, 6)
    assert frame.nodes[0].translation == (0, 0, 0)
    assert frame.nodes[1].translation == pytest.approx((6, 0, 0))
    assert frame.lights[0].intensity == pytest.approx(12)
    assert frame.lights[0].color == pytest.approx((0.25, 0.25, 0.25))
    assert frame.cameras[0].yfov == pytest.approx(0.625)
    assert frame.channels == ()
    assert posed(scene, 25).nodes[1].translation == posed(scene, 24).nodes[1].translation == (24, 0, 0)
    assert posed(scene, -3).nodes[1].translation == (0, 0, 0)


def test_an_overshooting_spline_gives_no_negative_light():
    dips = channel([[[0], [0], [-9]], [[0], [1], [0]]], (0, 1), "intensity", "CUBICSPLINE", "light")
    scene = Scene("s", lights=(PointLight(),), channels=(dips,), fps=10)
    assert sample(dips, 0.3)[0] < 0
    assert posed(scene, 3).lights[0].intensity == 0
