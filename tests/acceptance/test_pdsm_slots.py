"""Fixed slots, the published GPU layout: its texture count and bytes, its precision in a shader, and the vertex budget."""

import numpy as np
import pytest
from penumbra_scene import BIAS, BLOCKERS, FLOOR, constructed, floor_points, light_points, on_rays, view

from renderers.transport.penumbra.assemble import Construction
from renderers.transport.penumbra.functions import PenumbraMap
from renderers.transport.penumbra.slots import fixed_slots

ALL = (FLOOR, *BLOCKERS)


def longest(made: PenumbraMap) -> int:
    """Vertices of the longest function."""
    return int(np.diff(made.start).max())


def empty_map(resolution: int, vertices: int) -> PenumbraMap:
    """One function of so many vertices in the first pixel, nothing elsewhere."""
    start = np.full(resolution**2 + 1, vertices)
    start[0] = 0
    steps = np.linspace(4, 15, vertices, dtype=np.float32)
    return PenumbraMap(view(resolution), 16, 0.01, start, steps, np.linspace(0, 1, vertices, dtype=np.float32))


@pytest.mark.parametrize(("vertices", "textures"), [(0, 3), (1, 3), (16, 3), (17, 6), (31, 6), (33, 9), (80, 15)])
def test_a24_texture_count_and_bytes(vertices: int, textures: int) -> None:
    """A24: 3 ⌈K / 16⌉ textures of 16 bytes a pixel (one group where there is nothing); six at 512² are 24 MiB."""
    slots = fixed_slots(empty_map(32, vertices))
    assert slots.shape == (textures, 32, 32, 4)
    assert slots.nbytes == textures * 16 * 32**2
    assert 6 * 16 * 512**2 == 24 * 2**20


def test_layout_of_the_channels() -> None:
    """Vertex 0 and 1 in the halves of the first depth channel, vertex 9 in the second texture, shares four to a channel."""
    slots = fixed_slots(empty_map(4, 12))[:, 0, 0]
    depth = np.rint((np.linspace(4, 15, 12, dtype=np.float32).astype(float) - 3) / 13 * 65535).astype(int)
    assert [slots[0, 0] & 0xFFFF, slots[0, 0] >> 16, slots[1, 0] >> 16, slots[1, 2] & 0xFFFF] == [*depth[[0, 1, 9]], 65535]
    assert [slots[2, 0] & 0xFF, slots[2, 2] >> 24, slots[2, 3] & 0xFF] == [0, 255, 255]


@pytest.mark.gl
def test_a23_precision_in_the_shader() -> None:
    """A23: 16-bit depths and 8-bit shares move V by RMS .002 at most on the floor and in free space."""
    from renderers.gl.penumbra import PenumbraSlots

    made, *_ = constructed(ALL, light_points(64), 64, 128, Construction(bias=BIAS))
    p = made.pyramid
    rng = np.random.default_rng(3)
    z = rng.uniform(3.1, 15.9, (100, 100))
    free = np.stack([rng.uniform(-0.49, 0.49, z.shape) * z, rng.uniform(-0.49, 0.49, z.shape) * z, z], axis=-1)
    floor = floor_points(50)
    floor = floor[: len(floor) // 50 * 50].reshape(50, -1, 3)
    with PenumbraSlots(fixed_slots(made), (*p.low, p.pitch), (p.near, p.far)) as slots:
        for where in (free.astype(np.float32), floor.astype(np.float32)):
            error = slots.hidden(where).astype(np.float64) - made.hidden(where).reshape(where.shape[:2])
            assert np.sqrt((error**2).mean()) <= 0.002


@pytest.mark.parametrize("compression", ["vertical", "perpendicular", "none"])
@pytest.mark.parametrize("budget", [8, 16])
def test_a25_vertex_budget(budget: int, compression: str) -> None:
    """A25: no function is longer than the budget; functions that were short enough stay as they were."""
    points = light_points(36)
    free, tight = (
        constructed(ALL, points, 32, 64, Construction(bias=BIAS, compression=compression, budget=b))[0]  # type: ignore[arg-type]
        for b in (0, budget)
    )
    assert longest(free) > budget
    assert longest(tight) <= budget
    assert fixed_slots(tight).shape[0] == 3
    kept = np.diff(free.start) <= budget
    np.testing.assert_array_equal(np.diff(tight.start)[kept], np.diff(free.start)[kept])
    assert tight.value.min() >= 0
    assert tight.value.max() <= 1
    where = on_rays(view(32), 5_000, 2)
    error = np.abs(tight.hidden(where, "nearest") - free.hidden(where, "nearest"))
    # two vertices bound any function within 1; the budget must do far better than that almost everywhere
    assert np.quantile(error, 0.95) <= 0.15
