"""World → Mitsuba: camera, textures, lights and environments against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import renderers
from renderers.scene.builder import SceneBuilder, look_rotation
from renderers.scene.model import (
    DirectionalLight,
    Environment,
    Lambert,
    Light,
    Mesh,
    PointLight,
    Scene,
    SphereLight,
    SpotLight,
    Texture,
)
from renderers.scene.world import rotation_matrix

pytestmark = pytest.mark.mitsuba

SIZE = (32, 24)
FLOOR = [(-2, 0, 2), (2, 0, 2), (2, 0, -2), (-2, 0, -2)]


def direct(scene: Scene, size: tuple[int, int] = SIZE) -> NDArray[np.float64]:
    """Mean of one replicate of `direct` through the pixel centres, radiance."""
    from renderers.reference.export import mitsuba_scene
    from renderers.reference.sampling import CENTRE, mean_image, reference_stream
    from renderers.reference.transports import estimator

    traced = mitsuba_scene(scene.world(), size)
    return mean_image(traced, estimator("direct", traced), size, 64, reference_stream(0), CENTRE)


def floor_under(light: Light, height: float = 1.0, direction: tuple[float, float, float] = (0, -1, 0)) -> Scene:
    b = SceneBuilder("floor")
    b.quad(FLOOR, b.material(Lambert("white", (0.5, 0.5, 0.5))))
    b.light(light, (0.0, height, 0.0), look_rotation(direction))
    b.camera((0, 3, 3), (0, 0, 0), 0.7)
    return b.build()


def floor_points(scene: Scene, size: tuple[int, int] = SIZE) -> NDArray[np.float64]:
    """Where camera rays through the pixel centres meet y = 0, in metres, (H, W, 3)."""
    world = scene.world()
    origin, direction = world.camera.rays(size)
    origin = origin / world.scale + world.centre
    return origin - direction * (origin[..., 1:2] / direction[..., 1:2])


def test_sensor_shoots_the_rays_of_the_world_camera() -> None:
    from renderers.reference.export import mi, mitsuba_scene

    b = SceneBuilder("rolled")
    b.quad(FLOOR, b.material(Lambert()))
    b.camera((1, 3, 3), (0.2, 0, 0.1), 0.9, up=(0.3, 1, 0.2))
    world = b.build().world()
    x, y = np.meshgrid((np.arange(32) + 0.5) / 32, (np.arange(24) + 0.5) / 24)
    places = mi.Point2f(np.stack([x.ravel(), y.ravel()]).astype(np.float32))
    ray, _ = mitsuba_scene(world, SIZE).sensors()[0].sample_ray(0.0, 0.5, places, mi.Point2f(0.5))
    origins, directions = world.camera.rays(SIZE)
    np.testing.assert_allclose(np.array(ray.d).T.reshape(24, 32, 3), directions, atol=5e-7)
    off = np.cross(np.array(ray.o).T.reshape(24, 32, 3) - origins, directions)
    assert np.abs(off).max() < 2e-6


def test_first_hits_lie_where_the_camera_looks() -> None:
    from renderers.reference.visible import first_hits

    scene = floor_under(PointLight())
    world = scene.world()
    hits = first_hits(world, SIZE)
    points = floor_points(scene)
    inside = np.all(np.abs(points[..., [0, 2]]) < 1.99, axis=-1)
    outside = np.any(np.abs(points[..., [0, 2]]) > 2.01, axis=-1)
    assert inside.any()
    assert hits["coverage"][inside].all()
    assert not hits["coverage"][outside].any()
    assert not hits["emitter"].any()
    expected = (points - world.centre) * world.scale
    np.testing.assert_allclose(hits["position"][inside], expected[inside], atol=2e-6)
    np.testing.assert_allclose(hits["normal"][inside], np.broadcast_to([0, 1, 0], hits["normal"][inside].shape), atol=1e-6)
    np.testing.assert_allclose(hits["albedo"][inside], 0.5, rtol=1e-6)
    assert not hits["position"][outside].any()


def test_first_hit_normals_are_turned_to_the_viewer() -> None:
    from renderers.reference.visible import first_hits

    b = SceneBuilder("from below")
    b.quad(FLOOR, b.material(Lambert()))
    b.camera((0, -3, 0.1), (0, 0, 0), 0.5)
    hits = first_hits(b.build().world(), SIZE)
    np.testing.assert_allclose(hits["normal"][hits["coverage"]][:, 1], -1, atol=1e-6)


def test_point_light_is_inverse_square_and_cosine() -> None:
    scene = floor_under(PointLight(color=(1.0, 0.5, 0.25), intensity=3.0))
    p = floor_points(scene)
    inside = np.all(np.abs(p[..., [0, 2]]) < 1.9, axis=-1)
    d2 = p[..., 0] ** 2 + 1 + p[..., 2] ** 2
    expected = 3 * np.array([1, 0.5, 0.25]) * (0.5 / np.pi / d2**1.5)[..., None]
    np.testing.assert_allclose(direct(scene)[inside], expected[inside], rtol=2e-4)


def test_directional_light_is_irradiance() -> None:
    scene = floor_under(DirectionalLight(intensity=2.0), direction=(1, -1, 0))
    image = direct(scene)
    lit = image[..., 0] > 0
    assert lit.sum() > 300
    np.testing.assert_allclose(image[lit], 2 * 0.5 / np.pi * np.sqrt(0.5), rtol=1e-4)


@pytest.mark.parametrize(("inner", "outer"), [(0.0, 0.7), (0.3, 0.6), (0.5, 0.5)])
def test_spot_falls_off_as_gltf_says(inner: float, outer: float) -> None:
    scene = floor_under(SpotLight(intensity=3.0, inner_angle=inner, outer_angle=outer), direction=(0.2, -1, 0.1))
    p = floor_points(scene) - [0, 1, 0]
    distance = np.linalg.norm(p, axis=-1)
    axis = np.array([0.2, -1, 0.1]) / np.linalg.norm([0.2, -1, 0.1])
    cos = p @ axis / distance
    width = max(np.cos(inner) - np.cos(outer), 1e-6)
    falloff = np.clip((cos - np.cos(outer)) / width, 0, 1) ** 2
    expected = 3 * 0.5 / np.pi * falloff / distance**3
    keep = np.all(np.abs(p[..., [0, 2]]) < 1.9, axis=-1) & (np.abs(cos - np.cos(outer)) > 1e-4)
    np.testing.assert_allclose(direct(scene)[keep][:, 1], expected[keep], rtol=1e-3, atol=1e-5)
    assert (expected[keep] > 0).sum() > 20


@pytest.mark.parametrize("both", [False, True])
def test_emission_leaves_the_front_and_the_back_only_if_both(both: bool) -> None:
    """A small lamp between two plates, facing down: what is seen of it, and what it sends up and down (1/d²)."""
    half, albedo, radiance = 0.02, 0.5, 100.0
    b = SceneBuilder("lamp")
    white = b.material(Lambert("white", (albedo,) * 3))
    b.quad(FLOOR, white)
    b.quad([(x, 2, z) for x, _, z in FLOOR], white)
    lamp = b.material(Lambert("lamp", (0, 0, 0), emission=(radiance,) * 3, double_sided=both))
    b.quad([(-half, 1, -half), (half, 1, -half), (half, 1, half), (-half, 1, half)], lamp)
    expected = radiance * (2 * half) ** 2 * albedo / np.pi
    down, up = b.build(), b.build()
    for scene_camera, target in (("down", 0.0), ("up", 2.0)):
        b.nodes = [n for n in b.nodes if n.camera is None]
        b.camera((0.3, 1, 0), (0, target, 0), 0.01)
        if scene_camera == "down":
            down = b.build()
        else:
            up = b.build()
    np.testing.assert_allclose(direct(down, (2, 2)), expected, rtol=2e-3)
    np.testing.assert_allclose(direct(up, (2, 2)), expected if both else 0.0, rtol=2e-3)
    b.nodes = [n for n in b.nodes if n.camera is None]
    b.camera((0, 0.2, 0.001), (0, 1, 0), 0.01)
    np.testing.assert_allclose(direct(b.build(), (2, 2)), radiance, rtol=1e-6)
    b.nodes = [n for n in b.nodes if n.camera is None]
    b.camera((0, 1.8, 0.001), (0, 1, 0), 0.01)
    np.testing.assert_allclose(direct(b.build(), (2, 2)), radiance if both else 0.0, rtol=1e-6)


def test_two_sided_emission_is_without_noise_where_it_is_seen() -> None:
    """No z-fighting of coincident faces: every pixel on the lamp shows its radiance, from either side."""
    for y in (1.0, -1.0):
        b = SceneBuilder("lamp")
        b.quad(FLOOR, b.material(Lambert("lamp", (0, 0, 0), emission=(3.0, 2.0, 1.0), double_sided=True)))
        b.camera((0, y, 0.01), (0, 0, 0), 0.8)
        np.testing.assert_allclose(direct(b.build()), np.broadcast_to([3, 2, 1], (24, 32, 3)), rtol=1e-6)


def lambert_irradiance(corners: NDArray[np.float64], normal: NDArray[np.float64]) -> float:
    """Irradiance at the origin from a triangle of radiance 1 above the horizon (Lambert 1760): ½ Σ angle · (edge normal · n)."""
    total = 0.0
    unit = corners / np.linalg.norm(corners, axis=1, keepdims=True)
    for p, q in zip(unit, np.roll(unit, -1, axis=0), strict=True):
        edge = np.cross(p, q)
        length = np.linalg.norm(edge)
        total += np.arctan2(length, p @ q) * (edge @ normal) / max(length, 1e-300) / 2
    return abs(total)


def test_sphere_light_gives_the_irradiance_of_its_facets() -> None:
    """Interpolated normals must not bias the sampling; the sum over facets that face the point is exact (convex solid)."""
    from renderers.scene.shapes import sphere

    b = SceneBuilder("sphere")
    b.quad(FLOOR, b.material(Lambert("white", (0.5, 0.5, 0.5))))
    b.light(SphereLight(intensity=10.0, radius=0.3), (0.0, 1.0, 0.0))
    b.camera((0.6, 0.5, 0), (0, 0, 0), 0.005)
    positions, _, triangles = sphere(0.3)
    corners = (positions.astype(np.float64) + np.array([0, 1, 0]))[triangles]
    facing = (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) * corners[:, 0]).sum(axis=1) < 0
    irradiance = 10 * sum(lambert_irradiance(c, np.array([0, 1, 0])) for c in corners[facing])
    assert irradiance == pytest.approx(np.pi * 10 * 0.3**2, rel=0.01)
    expected = 0.5 / np.pi * irradiance
    image = direct(b.build(), (16, 16))
    assert abs(image.mean() - expected) < 5 * image.std() / 16


@pytest.mark.parametrize("wrap", [("repeat", "repeat"), ("clamp", "mirror"), ("mirror", "clamp")])
def test_texture_is_bilinear_row_0_at_v_0(wrap: tuple[str, str]) -> None:
    from renderers.reference.export import mi
    from renderers.reference.texture import texture

    rng = np.random.default_rng(3)
    image = Texture("t", rng.integers(0, 256, (3, 5, 3), dtype=np.uint8), wrap)  # type: ignore[arg-type]
    uv = rng.uniform(-2.5, 2.5, (500, 2))

    def index(k: NDArray[np.int64], n: int, mode: str) -> NDArray[np.int64]:
        if mode == "clamp":
            return np.clip(k, 0, n - 1)
        if mode == "repeat":
            return k % n
        k = k % (2 * n)
        return np.where(k < n, k, 2 * n - 1 - k)

    x, y = uv[:, 0] * 5 - 0.5, uv[:, 1] * 3 - 0.5
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    expected = np.zeros((500, 3))
    for di in (0, 1):
        for dj in (0, 1):
            weight = np.abs(1 - di - (x - i)) * np.abs(1 - dj - (y - j))
            expected += weight[:, None] * image.linear[index(j + dj, 3, wrap[1]), index(i + di, 5, wrap[0])]
    si = mi.SurfaceInteraction3f()
    si.uv = mi.Point2f(np.ascontiguousarray(uv.T, np.float32))
    np.testing.assert_allclose(np.array(texture(image.linear, wrap).eval(si)).T, expected, atol=5e-6)


def test_textured_floor_shows_its_texels() -> None:
    """Albedo through the camera: the texel at (column, row) appears where uv says, times the base colour."""
    from renderers.reference.visible import first_hits

    pixels = np.zeros((2, 2, 3), np.uint8)
    pixels[0, 0], pixels[0, 1], pixels[1, 0] = (255, 0, 0), (0, 255, 0), (0, 0, 255)
    positions = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], np.float32)
    uvs = np.array([(0, 1), (1, 1), (1, 0), (0, 0)], np.float32)
    b = SceneBuilder("texture")
    material = b.material(Lambert("t", (0.5, 0.5, 0.5), texture=0))
    normals = np.tile(np.array([0, 0, 1], np.float32), (4, 1))
    b.meshes.append(Mesh("quad", positions, normals, np.array([[0, 1, 2], [0, 2, 3]], np.uint32), material, uvs))
    b.node(meshes=(0,))
    b.camera((0, 0, 3), (0, 0, 0), 2 * np.arctan(1 / 3))
    scene = b.build()
    scene = Scene(**{**vars(scene), "textures": (Texture("t", pixels, ("clamp", "clamp")),)})
    albedo = first_hits(scene.world(), (8, 8))["albedo"]
    np.testing.assert_allclose(albedo[0, 0], [0.5, 0, 0], atol=1e-5)
    np.testing.assert_allclose(albedo[0, 7], [0, 0.5, 0], atol=1e-5)
    np.testing.assert_allclose(albedo[7, 0], [0, 0, 0.5], atol=1e-5)
    np.testing.assert_allclose(albedo[7, 7], [0, 0, 0], atol=1e-5)


@pytest.mark.parametrize("rotation", [(0.0, 0.0, 0.0, 1.0), (0.0, 0.6, 0.0, 0.8), (0.5, -0.5, 0.5, 0.5)])
@pytest.mark.parametrize("texel", [(4, 3), (8, 12)])
def test_environment_texel_appears_where_it_should(texel: tuple[int, int], rotation: tuple[float, float, float, float]) -> None:
    """One bright texel at (row, column) of 17 x 16: seen along R · (sin u sin v, cos v, -cos u sin v), nowhere else."""
    row, column = texel
    image = np.zeros((17, 16, 3), np.float32)
    image[row, column] = (3, 2, 1)
    u, v = 2 * np.pi * (column + 0.5) / 16, np.pi * row / 16
    direction = rotation_matrix(rotation) @ [np.sin(u) * np.sin(v), np.cos(v), -np.cos(u) * np.sin(v)]
    b = SceneBuilder("sky")
    b.environment = Environment((1.0, 0.5, 1.0), image, rotation)
    for sign, expected in ((1, [3, 1, 1]), (-1, [0, 0, 0])):
        b.nodes, b.cameras = [], []
        # The one triangle that a scene needs lies far off, out of sight.
        b.quad((np.array(FLOOR) * 1e-3 - 50 * sign * direction).tolist(), 0)
        b.materials = [Lambert()]
        b.camera((0, 0, 0), sign * direction, 1e-3)
        np.testing.assert_allclose(direct(b.build(), (3, 3))[1, 1], expected, rtol=2e-3, atol=2e-3)


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (2, 2), (3, 2)])
def test_tiny_environment_images_keep_their_function(shape: tuple[int, int]) -> None:
    from renderers.reference.export import _at_least_2x3

    pixels = np.random.default_rng(1).random((*shape, 3), np.float32)
    grown = _at_least_2x3(pixels)
    assert grown.shape[0] >= 2
    assert grown.shape[1] >= 3
    u = np.linspace(0, 1, 101)

    def at(image: NDArray[np.float32]) -> NDArray[np.float64]:
        width = image.shape[1]
        x = u * width - 0.5
        left = np.floor(x).astype(int)
        t = (x - left)[:, None]
        return (1 - t) * image[0, left % width] + t * image[0, (left + 1) % width]

    np.testing.assert_allclose(at(grown), at(pixels), atol=1e-6)


def test_constant_environment_lights_an_open_floor_fully() -> None:
    b = SceneBuilder("sky")
    b.quad(FLOOR, b.material(Lambert("grey", (0.3, 0.3, 0.3))))
    b.environment = Environment((2.0, 1.0, 0.5))
    b.camera((0, 1, 0.01), (0, 0, 0), 0.5)
    np.testing.assert_allclose(direct(b.build()).mean(axis=(0, 1)), 0.3 * np.array([2, 1, 0.5]), rtol=2e-3)


def test_what_is_dark_or_unused_is_left_out() -> None:
    from renderers.reference.export import mitsuba_scene

    b = SceneBuilder("dark")
    b.material(Lambert("unused", emission=(9, 9, 9)))
    b.quad(FLOOR, b.material(Lambert()))
    b.light(PointLight(intensity=0.0), (0, 1, 0))
    b.environment = Environment((0.0, 0.0, 0.0))
    b.camera((0, 3, 3), (0, 0, 0), 0.7)
    scene = mitsuba_scene(b.build().world(), SIZE)
    assert not scene.emitters()
    assert len(scene.shapes()) == 1


def test_clay_has_no_light_and_albedo_one() -> None:
    from renderers.reference.export import mitsuba_scene
    from renderers.reference.visible import hits_of

    scene = mitsuba_scene(renderers.load_scene("cornell-box").world(), SIZE, clay=True)
    hits = hits_of(scene, SIZE)
    assert not scene.emitters()
    np.testing.assert_allclose(hits["albedo"][hits["coverage"]], 1.0)
