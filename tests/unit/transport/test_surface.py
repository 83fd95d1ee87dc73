"""Textures and interpolation: texel centres, filtering, wrap modes, glTF's orientation of v."""

import numpy as np
import pytest

from renderers.scene.model import Texture
from renderers.transport.surface import look_up, turned

PIXELS = np.arange(4 * 3 * 3, dtype=np.uint8).reshape(4, 3, 3) * 7  # 4 rows, 3 columns


def texture(wrap: str = "repeat") -> Texture:
    return Texture("t", PIXELS, (wrap, wrap))  # type: ignore[arg-type]


def test_texel_centres_and_row_0_on_top() -> None:
    t = texture()
    rows, columns = (a.ravel() for a in np.meshgrid(np.arange(4), np.arange(3), indexing="ij"))
    uv = np.stack([(columns + 0.5) / 3, (rows + 0.5) / 4], axis=1)
    np.testing.assert_allclose(look_up(t, uv), t.linear[rows, columns], atol=1e-9)


def test_filtering_happens_in_linear_colour() -> None:
    t = texture()
    middle = look_up(t, np.array([[1 / 3, 0.125], [0.5, 0.25]]))
    np.testing.assert_allclose(middle[0], (t.linear[0, 0] + t.linear[0, 1]) / 2, atol=1e-7)
    np.testing.assert_allclose(middle[1], (t.linear[0, 1] + t.linear[1, 1]) / 2, atol=1e-7)


@pytest.mark.parametrize(("wrap", "column"), [("repeat", 0), ("clamp", 2), ("mirror", 2)])
def test_wrap_past_the_right_edge(wrap: str, column: int) -> None:
    t = texture(wrap)
    np.testing.assert_allclose(look_up(t, np.array([[3.5 / 3, 0.125]]))[0], t.linear[0, column], atol=1e-6)


@pytest.mark.parametrize(("wrap", "column"), [("repeat", 2), ("clamp", 0), ("mirror", 0)])
def test_wrap_past_the_left_edge(wrap: str, column: int) -> None:
    t = texture(wrap)
    np.testing.assert_allclose(look_up(t, np.array([[-0.5 / 3, 0.125]]))[0], t.linear[0, column], atol=1e-6)


def test_turned_faces_the_viewer() -> None:
    normals = np.array([[0.0, 1, 0], [0, 1, 0]])
    assert turned(normals, np.array([[0.0, 2, 1], [0, -2, 1]]))[:, 1].tolist() == [1, -1]
