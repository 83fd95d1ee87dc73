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
