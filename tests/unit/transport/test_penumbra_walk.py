"""Rays through shadow maps: the worked example, the exact walk's identity, cameras in general position."""

import numpy as np
import pytest
from penumbra_scene import average_of_tests, box, constructed, depth_of, events_of_rays, on_rays, plane, ready, sphere, view
from scipy.spatial.transform import Rotation

from renderers.transport.penumbra.assemble import Construction, assemble
from renderers.transport.penumbra.cameras import cameras_of

UNCOMPRESSED = Construction(bias=0.02, compression="none", merge=0.0)


@pytest.mark.parametrize(
    ("depths", "exact", "midpoint"),
    [
        ((3, 1.3, 1.2, 3.5), [(1.3, 1), (2.857143, -1), (3.5, 1)], [(1.3, 1)]),
        ((3, 1.1, 1.2, 3.5), [(1.176471, 1), (2.857143, -1), (3.5, 1)], [(1.1, 1)]),
        ((3, 1.3, 1.2, 5), [(1.3, 1), (2.857143, -1)], [(1.3, 1), (2, -1)]),
    ],
)
def test_worked_example(depths: tuple[float, ...], exact: list[tuple[float, int]], midpoint: list[tuple[float, int]]) -> None:
    """8 x 8 texels over [-1, 1]², light point (1, 0), ray u = v = 0.1 between depths 1 and 4: x from 0.4 to 3.4 in row 4."""
    maps = np.full((1, 8, 8), np.inf, np.float32)
    maps[0, 4, :4] = depths
    cameras = np.concatenate([np.eye(3).ravel(), [1, 0, 0], [-1, 0.25, -1, 0.25]])[None]
    for is_exact, expected in ((True, exact), (False, midpoint)):
        z, sign, _ = events_of_rays(maps, cameras, np.array([0.1]), np.array([0.1]), 1.0, 4.0, 0.0, is_exact)
        assert sign.tolist() == [s for _, s in expected]
        np.testing.assert_allclose(z, [at for at, _ in expected], rtol=1e-6)


def test_cameras_in_general_position() -> None:
    """A2: rotated, non-coplanar cameras; V is the average of their shadow tests at every point of the rays."""
    rng = np.random.default_rng(5)
    pyramid = view(32)
    points = rng.uniform(-0.6, 0.6, (6, 3))
    turns = Rotation.from_rotvec(rng.uniform(-0.25, 0.25, (6, 3))).as_matrix()
    cameras = cameras_of(pyramid, points, 96, turns)
    surfaces = (plane(10, 0.2), sphere((0.3, -0.2, 6), 1.0), box((-2.5, -0.8, 7.5), (-1.2, 0.8, 8.3)))
    maps = depth_of(surfaces, cameras, 96)
    made = assemble(pyramid, cameras, ready(cameras, maps), UNCOMPRESSED)
    where = on_rays(pyramid, 20_000, 6)
    wrong = np.abs(made.hidden(where, "nearest") - average_of_tests(cameras, maps, where, 0.02)) > 1e-6
    # a mismatch needs a point within float32 rounding of an event: 1e-6 of the depth, a few events per ray
    assert wrong.mean() <= 1e-4


def test_a_camera_behind_which_the_pyramid_starts_is_refused() -> None:
    """Depths at or behind a camera have no texel."""
    with pytest.raises(ValueError, match="behind a shadow map camera"):
        cameras_of(view(8), [[0.0, 0.0, 3.5]], 16)


def test_what_lies_outside_the_map_is_lit() -> None:
    """A blocker that a window does not hold casts no shadow, and the walk stays inside the array."""
    maps = np.full((1, 8, 8), 1.0, np.float32)
    cameras = np.concatenate([np.eye(3).ravel(), [0, 0, 0], [5, 0.25, 5, 0.25]])[None]
    z, _, _ = events_of_rays(maps, cameras, np.array([0.1]), np.array([0.1]), 1.0, 4.0, 0.0, True)
    assert len(z) == 0


def test_slabs_batches_and_order_do_not_matter() -> None:
    """A5: a memory bound that splits maps into batches and rows into slabs, and permuted light points, give the same bytes."""
    surfaces = (plane(10, 0.2), sphere((0.3, -0.2, 6), 1.0))
    points = np.concatenate([np.random.default_rng(2).uniform(-1, 1, (9, 2)), np.zeros((9, 1))], axis=1)
    whole, *_ = constructed(surfaces, points, 24, 48, Construction(bias=0.02))
    # next to the least possible
    small = Construction(bias=0.02, memory=1_250_000)
    for other in (constructed(surfaces, points, 24, 48, small)[0], constructed(surfaces, points[::-1], 24, 48, small)[0]):
        for name in ("start", "depth", "value"):
            np.testing.assert_array_equal(getattr(other, name), getattr(whole, name))
