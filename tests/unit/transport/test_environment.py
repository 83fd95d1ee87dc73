"""Lat-long look-up and sampling; the convention against Mitsuba's envmap emitter."""

import numpy as np
import pytest

from renderers.images import luminance
from renderers.scene.environment import radiance
from renderers.scene.model import Environment
from renderers.transport.environment import EnvironmentSampler
from renderers.transport.sampling import generator, lattice, uniform_sphere

TURN = (0.1, 0.5, -0.2, 0.8)


def noise(height: int, width: int) -> np.ndarray:
    return generator(4, "image").random((height, width, 3)).astype(np.float32)


def one_bright_texel(height: int, width: int, row: int, column: int) -> np.ndarray:
    image = np.zeros((height, width, 3), np.float32)
    image[row, column] = 1
    return image


def test_constant() -> None:
    assert (radiance(Environment((1.0, 2.0, 3.0)), np.eye(3)) == [1, 2, 3]).all()


@pytest.mark.parametrize(
    ("row", "column", "direction"),
    [
        (4, 0, (np.sin(np.pi / 8), 0, -np.cos(np.pi / 8))),  # column 0 starts at -Z and turns towards +X
        (4, 1, (np.sin(3 * np.pi / 8), 0, -np.cos(3 * np.pi / 8))),
        (4, 3, (np.sin(7 * np.pi / 8), 0, -np.cos(7 * np.pi / 8))),
        (4, 7, (-np.sin(np.pi / 8), 0, -np.cos(np.pi / 8))),
        (2, 1, (np.sin(np.pi / 4) * np.sin(3 * np.pi / 8), np.cos(np.pi / 4), -np.sin(np.pi / 4) * np.cos(3 * np.pi / 8))),
    ],
)
def test_texel_centres(row: int, column: int, direction: tuple[float, float, float]) -> None:
    assert radiance(Environment(image=one_bright_texel(9, 8, row, column)), np.array([direction]))[0, 0] == pytest.approx(
        1, abs=1e-9
    )


def test_rows_lie_on_the_poles() -> None:
    image = np.zeros((5, 4, 3), np.float32)
    image[0], image[-1] = 1, 2
    assert radiance(Environment(image=image), np.array([[0, 1, 0], [0, -1, 0]], np.float64))[:, 0].tolist() == [1, 2]


@pytest.mark.mitsuba
@pytest.mark.parametrize("rotation", [(0.0, 0.0, 0.0, 1.0), TURN])
@pytest.mark.parametrize("bright", [None, (3, 0), (3, 7), (1, 4)])
def test_orientation_is_that_of_mitsuba(rotation: tuple[float, float, float, float], bright: tuple[int, int] | None) -> None:
    import drjit as dr

    from tests.unit.transport.mitsuba_world import mitsuba, sky_of

    mi = mitsuba()
    image = noise(7, 8) if bright is None else one_bright_texel(7, 8, *bright)
    environment = Environment((1.0, 0.5, 2.0), image, rotation)
    directions = uniform_sphere(lattice(4000, 2))
    si = dr.zeros(mi.SurfaceInteraction3f, len(directions))
    si.wi = mi.Vector3f(-directions.T.astype(np.float32))
    theirs = np.array(mi.load_dict(sky_of(environment)).eval(si)).T
    # float32 angles: 2.4e-7 · 8 texels of unit contrast, times radiance 2, with margin for acos near the poles.
    np.testing.assert_allclose(radiance(environment, directions), theirs, atol=3e-5)


@pytest.mark.parametrize("image", [noise(7, 8), one_bright_texel(7, 8, 0, 3), one_bright_texel(9, 16, 4, 15)])
def test_sampling_is_unbiased(image: np.ndarray) -> None:
    environment, count = Environment((1.0, 0.5, 2.0), image, TURN), 1 << 16
    directions, density = EnvironmentSampler(environment).sample(generator(1, "sky").random((count, 3)))
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-9)
    everywhere = uniform_sphere(lattice(1 << 18, 2))
    for weight in (lambda d: 1.0 + 0 * d[:, 0], lambda d: d[:, 0], lambda d: d[:, 1] ** 2, lambda d: d[:, 2] * d[:, 0]):
        estimates = radiance(environment, directions)[:, 0] * weight(directions) / density
        uniform = radiance(environment, everywhere)[:, 0] * weight(everywhere) * 4 * np.pi
        # 4 standard errors of the sample; the lattice's own error is O(1/count) of its spread.
        assert abs(estimates.mean() - uniform.mean()) < 4 * estimates.std() / np.sqrt(count) + 20 * uniform.std() / len(everywhere)


@pytest.mark.parametrize("image", [noise(7, 8), one_bright_texel(9, 16, 4, 15)])
def test_sampling_beats_uniform_directions(image: np.ndarray) -> None:
    environment = Environment(image=image)
    directions, density = EnvironmentSampler(environment).sample(generator(1, "sky").random((1 << 15, 3)))
    assert (luminance(radiance(environment, directions)) / density).std() < (
        luminance(radiance(environment, uniform_sphere(lattice(1 << 15, 2)))) * 4 * np.pi
    ).std()


@pytest.mark.parametrize("shape", [(2, 8, 3), (5, 1, 3), (5, 8), (5, 8, 4)])
def test_images_that_are_no_lat_long_map_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="2x3"):
        radiance(Environment(image=np.zeros(shape, np.float32)), np.eye(3))
