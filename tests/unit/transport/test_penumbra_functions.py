"""Packed functions: evaluation at vertices and jumps, filtering, files."""

from pathlib import Path

import numpy as np
import pytest

from renderers.transport.penumbra.functions import PenumbraFileError, PenumbraMap, load
from renderers.transport.penumbra.pyramid import Pyramid

PYRAMID = Pyramid(np.zeros(3), np.eye(3), (-1.0, -1.0), 1.0, 2, 2, 1.0, 8.0)


def example() -> PenumbraMap:
    """Four pixels: a jump, a ramp, nothing, and a jump back to 0."""
    depth = np.array([3, 2, 4, 2, 5, 5], np.float32)
    value = np.array([1, 0, 0.5, 0.5, 0.5, 0], np.float32)
    return PenumbraMap(PYRAMID, 2, 0.01, np.array([0, 1, 3, 3, 6]), depth, value)


def at(column: float, row: float, z: float) -> list[list[float]]:
    """The point over continuous pixel coordinates at depth z."""
    return [[(column - 1) * z, (row - 1) * z, z]]


def test_values_before_between_and_after_vertices() -> None:
    """0 before, linear between, the last value after; a vertex at exactly Z is not passed yet."""
    m = example()
    cases = {(0.5, 0.5, 3): 0, (0.5, 0.5, 3.0001): 1, (1.5, 0.5, 3): 0.25, (1.5, 0.5, 7): 0.5, (0.5, 1.5, 7): 0,
             (1.5, 1.5, 2): 0, (1.5, 1.5, 5): 0.5, (1.5, 1.5, 5.001): 0}  # fmt: skip
    for (column, row, z), expected in cases.items():
        assert m.hidden(at(column, row, z), "nearest")[0] == pytest.approx(expected, abs=1e-6)
        # at a pixel's centre all weight is its own
        assert m.hidden(at(column, row, z))[0] == pytest.approx(expected, abs=1e-6)


def test_bilinear_blends_results_at_one_depth() -> None:
    """Weights .75/.25 along the row; taps beyond the border clamp."""
    m = example()
    assert m.hidden(at(0.75, 0.5, 4.0))[0] == pytest.approx(0.75 * 1 + 0.25 * 0.5)
    assert m.hidden(at(0.1, 0.1, 4.0))[0] == pytest.approx(1)
    assert m.hidden(at(1.0, 1.0, 4.5))[0] == pytest.approx((1 + 0.5 + 0 + 0.5) / 4)


def test_size_counts_vertices_and_pixels() -> None:
    """8 bytes a vertex and 4 a pixel."""
    assert example().bytes == 8 * 6 + 4 * 4


def test_file_round_trip(tmp_path: Path) -> None:
    """Every array and number comes back; the same map gives the same bytes."""
    m = example()
    m.save(tmp_path / "a.npz")
    m.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    back = load(tmp_path / "a.npz")
    for name in ("start", "depth", "value"):
        np.testing.assert_array_equal(getattr(back, name), getattr(m, name))
    assert back.samples == m.samples
    for name in ("low", "pitch", "width", "height", "near", "far"):
        assert getattr(back.pyramid, name) == getattr(PYRAMID, name)


def test_foreign_files_are_refused(tmp_path: Path) -> None:
    """Not an archive, another archive, another version: each is named."""
    text, other, newer = tmp_path / "a.npz", tmp_path / "b.npz", tmp_path / "c.npz"
    text.write_text("no archive")
    np.savez(other, x=np.zeros(3))
    np.savez(newer, format=np.array("penumbra-deep-shadow-map/99"))
    for path, message in ((text, "not a penumbra"), (other, "not a penumbra"), (newer, "version 99")):
        with pytest.raises(PenumbraFileError, match=message):
            load(path)
