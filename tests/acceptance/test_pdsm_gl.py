"""The shader's lookup of attenuation functions against the kernel's."""

import numpy as np
import pytest
from penumbra_scene import BIAS, BLOCKERS, FLOOR, constructed, light_points

from renderers.transport.penumbra.assemble import Construction

pytestmark = pytest.mark.gl


@pytest.mark.parametrize("bilinear", [True, False])
def test_a22_linear_encoding(bilinear: bool) -> None:
    """A22: 10⁻⁴ from the CPU's answer, covered or not.

    Single precision moves tangents and depth by 1e-6 of their size: where a function jumps, or nearest pixels change, that
    flips a value. With 64 jumps and edges in reach of a point, 1e-4 of random points are that near to one.
    """
    from renderers.gl.penumbra import PenumbraTextures

    made, *_ = constructed((FLOOR, *BLOCKERS), light_points(16), 48, 96, Construction(bias=BIAS))
    p = made.pyramid
    rng = np.random.default_rng(2)
    z = rng.uniform(2.5, 17.0, (200, 200))
    points = np.stack([rng.uniform(-0.55, 0.55, z.shape) * z, rng.uniform(-0.55, 0.55, z.shape) * z, z], axis=-1).astype(np.float32)
    with PenumbraTextures((p.width, p.height), (*p.low, p.pitch), (p.near, p.far), made.start, made.depth, made.value) as textures:
        ours = textures.hidden(points, bilinear=bilinear)
    expected = made.hidden(points, "bilinear" if bilinear else "nearest").reshape(z.shape)
    assert (expected == -1).any()
    assert (np.abs(ours - expected) > 1e-4).mean() <= 1e-4


@pytest.mark.parametrize("bilinear", [True, False])
def test_lookups_on_surfaces(bilinear: bool) -> None:
    """With normals and a lift the shader agrees with the kernel as well: on the floor, at points of any normal, in free space.

    A ray at cosine c meets a plane at depth height / c: rounding moves it by 1e-7 / c of its size, and within the reach of two
    footprints c is above 1e-2. So as above, with ten times as many points near an edge.
    """
    from renderers.gl.penumbra import PenumbraTextures

    made, *_ = constructed((FLOOR, *BLOCKERS), light_points(16), 48, 96, Construction(bias=BIAS))
    p = made.pyramid
    rng = np.random.default_rng(4)
    z = rng.uniform(3.5, 15.0, (120, 120))
    points = np.stack([rng.uniform(-0.49, 0.49, z.shape) * z, rng.uniform(-0.49, 0.49, z.shape) * z, z], axis=-1)
    normals = rng.normal(size=points.shape)
    points[:40, :, 2] = 10 + 0.2 * points[:40, :, 0]
    normals[:40] = [0.2, 0.0, -1.0]
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals[80:] = 0
    points, normals = points.astype(np.float32), normals.astype(np.float32)
    offset = 1.5
    with PenumbraTextures((p.width, p.height), (*p.low, p.pitch), (p.near, p.far), made.start, made.depth, made.value) as textures:
        ours = textures.hidden(points, bilinear=bilinear, normals=normals, lift=offset * made.texel)
        free = textures.hidden(points, bilinear=bilinear)
    expected = made.hidden(points, "bilinear" if bilinear else "nearest", normals, offset).reshape(z.shape)
    assert (np.abs(ours - expected) > 1e-4).mean() <= 1e-3
    np.testing.assert_array_equal(ours[80:], free[80:])
    assert (np.abs(ours[:80] - free[:80]) > 0.05).mean() > 0.05
