"""Where soft shadows from maps go wrong: contacts, grazing light, thin and coincident things, odd lights, scale, degenerate input.

The oracle is the same image with shadow rays to the same light points, so that neither their number nor the separation of light and
visibility counts: what is left are the maps, the rays of the pyramid, and the bias.
"""

from collections import Counter
from collections.abc import Callable
from typing import Literal

import numpy as np
import pytest

import renderers
from renderers.scene.builder import SceneBuilder
from renderers.scene.model import Lambert, Scene, SphereLight
from renderers.transport.penumbra.assemble import Construction
from renderers.transport.penumbra.build import LightShadows, Slope, build
from renderers.transport.penumbra.emitters import emitters_of
from renderers.transport.penumbra.shading import cast_hidden

SIZE = (64, 48)
POINTS = 36
QUICK = {"samples": POINTS, "map_resolution": 192, "light_samples": 16}
GREY, BLACK = Lambert("grey", (0.6, 0.6, 0.6)), Lambert("black", (0.0, 0.0, 0.0))


@pytest.fixture(autouse=True)
def _software_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """These methods run on the CPU: nobody shall ask for a GL context."""
    monkeypatch.setattr("renderers.method.device_string", lambda: "llvmpipe (LLVM 15.0.6, 256 bits)")


def lamp(b: SceneBuilder, centre: tuple[float, float, float], half: float) -> None:
    """A square lamp that shines down."""
    paint = b.material(Lambert("lamp", (0.0, 0.0, 0.0), emission=(4 / half**2,) * 3, double_sided=False))
    x, y, z = centre
    b.quad([(x - half, y, z - half), (x + half, y, z - half), (x + half, y, z + half), (x - half, y, z + half)], paint, "lamp")


def stage(
    add: Callable[[SceneBuilder], None],
    *,
    lamp_at: tuple[float, float, float] = (0.0, 3.0, 0.0),
    half: float = 0.4,
    unit: float = 1.0,
    eye: tuple[float, float, float] = (0.0, 4.0, 5.0),
) -> Scene:
    """A floor of 6 × 6 under a lamp, and what `add` puts on it; `unit` scales everything."""
    b = SceneBuilder("stage")
    b.quad([(-3, 0, 3), (3, 0, 3), (3, 0, -3), (-3, 0, -3)], b.material(GREY), "floor")
    add(b)
    lamp(b, lamp_at, half)
    b.camera(eye, (0, 0, 0), 0.7)
    for k, mesh in enumerate(b.meshes):
        b.meshes[k] = type(mesh)(mesh.name, mesh.positions * np.float32(unit), mesh.normals, mesh.triangles, mesh.material)
    for k, node in enumerate(b.nodes):
        moved = tuple(float(t) * unit for t in node.translation)
        b.nodes[k] = type(node)(**{**vars(node), "translation": moved})
    return b.build()


def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> Callable[[SceneBuilder], None]:
    """A box."""

    def add(b: SceneBuilder) -> None:
        (x0, y0, z0), (x1, y1, z1) = low, high
        p = [(x, y, z) for x in (x0, x1) for y in (y0, y1) for z in (z0, z1)]
        sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        b.node(meshes=(b.mesh(p, [t for a, c, d, e in sides for t in ((a, c, d), (a, d, e))], b.material(GREY)),))

    return add


def card(height: float, half: float = 0.6, tilt: float = 0.0) -> Callable[[SceneBuilder], None]:
    """A square sheet over the floor."""

    def add(b: SceneBuilder) -> None:
        t = tilt * half
        b.quad(
            [(-half, height - t, half), (half, height + t, half), (half, height + t, -half), (-half, height - t, -half)],
            b.material(GREY), "card",
        )  # fmt: skip

    return add


def nothing(b: SceneBuilder) -> None:
    """An empty floor."""


def image(scene: Scene, name: str = "pdsm", **settings: object) -> np.ndarray:
    """Direct light, float64 (H, W)."""
    method = renderers.get_method(name)
    chosen = {**QUICK, **({"resolution": 192} if name == "pdsm" else {}), **settings}
    return method.render(scene, method.Settings(**chosen), size=SIZE, seed=1).layers["direct"][..., 0].astype(np.float64)


def shadows(scene: Scene, points: int = POINTS, compression: Literal["none", "vertical"] = "vertical") -> LightShadows:
    """The structure itself, with the method's bias."""
    world = scene.world()
    light = emitters_of(world)[0]
    how = Construction(bias=2.5e-4, compression=compression)
    return build(world, light, light.points(points, 0), resolution=192, map_resolution=192, how=how, slope=Slope())


def on_floor(scene: Scene, xz: np.ndarray) -> np.ndarray:
    """World points of floor positions (N, 2) in metres."""
    world = scene.world()
    return (np.stack([xz[:, 0], np.zeros(len(xz)), xz[:, 1]], axis=1) - world.centre) * world.scale


@pytest.mark.parametrize("height", [0.01, 0.03, 0.1])
def test_contact_shadow_has_no_gap(height: float) -> None:
    """Under a sheet close over the floor all light is gone up to its edge, within one pixel of the pyramid.

    Off the axis the edge's shadow lies by height · tan(angle) off the sheet, and the penumbra is height · 0.8 / 3 wide.
    """
    scene = stage(card(height))
    made = shadows(scene)
    footprint = made.maps[0].pyramid.pitch * 3.0
    x = np.linspace(-0.6 + footprint, 0.6 - footprint, 25)
    inside = np.stack([a.ravel() for a in np.meshgrid(x, x)], axis=1)
    assert made.hidden(on_floor(scene, inside)).min() >= 0.98
    reach = 0.6 + height * (0.6 + 0.4) / (3.0 - height) + footprint + 2 * 0.02
    ring = np.stack([np.linspace(-1, 1, 41), np.full(41, reach)], axis=1)
    assert made.hidden(on_floor(scene, ring)).max() <= 0.02


def test_gap_and_acne_of_a_box_on_the_floor_in_pixels() -> None:
    """A box stands on the floor: pixels that differ from rays to the same points lie along the box's outline only.

    Off by more than a tenth of the light: at most the pixels that a footprint of the pyramid covers along the box's outline.
    """
    scene = stage(block((-0.5, 0.0, -0.4), (0.4, 0.7, 0.5)), lamp_at=(1.2, 3.0, 0.8))
    ours, rays = image(scene), image(scene, "ray-cast-area-light")
    white = np.percentile(rays, 99)
    acne, gap = (ours < rays - 0.1 * white).mean(), (ours > rays + 0.1 * white).mean()
    # the box's outline is about 4 m of the 36 m² in view, a footprint 3 · 2 / 192 m wide: a third of a per cent of the pixels
    assert acne <= 0.004
    assert gap <= 0.004


@pytest.mark.parametrize("angle", [60, 80, 87, 89.5])
def test_grazing_surfaces_do_not_shadow_themselves(angle: float) -> None:
    """A wall that the light grazes: lit where rays say so. The wall's own light there is weak: cos of the angle."""

    def wall(b: SceneBuilder) -> None:
        lean = 2.5 / np.tan(np.radians(angle)) / np.tan(np.radians(45))
        b.quad([(-1, 0, -1), (1, 0, -1), (1, 2.5, -1 - lean), (-1, 2.5, -1 - lean)], b.material(GREY), "wall")

    scene = stage(wall, lamp_at=(0.0, 3.0, -0.3), half=0.3)
    ours, rays = image(scene), image(scene, "ray-cast-area-light")
    white = np.percentile(rays, 99)
    assert (np.abs(ours - rays) > 0.05 * white).mean() <= 0.01
    assert abs(ours.mean() / rays.mean() - 1) <= 0.01


@pytest.mark.parametrize("width", [0.004, 0.02])
def test_blockers_thinner_than_a_pixel(width: float) -> None:
    """A slanted ribbon under a texel of the maps (1.5 · 2 / 192 m): the mean hidden share on the floor is right within 15 %.

    Each texel along it catches it with probability width / texel in each of 256 maps: 25,600 trials, a spread of 2 %
    for the thinner one. Its 64² points on the floor sample the streaks, in both ways. Uncompressed: V is below ε there.
    """

    def ribbon(b: SceneBuilder) -> None:
        start, end = np.array([-1.0, 1.5, -0.3]), np.array([1.0, 1.7, 0.45])
        across = np.cross(end - start, [0.0, 1.0, 0.0])
        across *= width / 2 / np.linalg.norm(across)
        b.quad([start - across, end - across, end + across, start + across], b.material(GREY), "ribbon")

    scene = stage(ribbon, half=0.5)
    made = shadows(scene, 256, "none")
    side = np.linspace(-1.5, 1.5, 64)
    floor = on_floor(scene, np.stack([a.ravel() for a in np.meshgrid(side, side)], axis=1))
    mean = float(made.hidden(floor).mean())
    up = np.tile([0.0, 1.0, 0.0], (len(floor), 1))
    world = scene.world()
    truth = float(cast_hidden(world, made.emitter, made.emitter.points(1024, 1), floor, up, Counter()).mean())
    assert mean == pytest.approx(truth, rel=0.15)


def test_coincident_surfaces() -> None:
    """The same card twice, and a card in the floor's plane: as by rays, no stripes, everything within [0, 1]."""

    def twice(b: SceneBuilder) -> None:
        card(0.5)(b)
        card(0.5)(b)
        card(0.0, half=1.5)(b)

    scene = stage(twice)
    ours, rays = image(scene), image(scene, "ray-cast-area-light")
    assert (np.abs(ours - rays) > 0.1 * np.percentile(rays, 99)).mean() <= 0.01
    for one in shadows(scene).maps:
        assert one.value.min(initial=0) >= 0
        assert one.value.max(initial=0) <= 1


def test_light_in_the_midst_of_the_scene() -> None:
    """A ball of light between floor and boxes on all sides: six pyramids, no seams, as by rays."""

    def around(b: SceneBuilder) -> None:
        for x, z in ((-1.2, -0.3), (0.8, -1.3), (0.9, 0.6)):
            block((x, 0.2, z), (x + 0.4, 0.9, z + 0.4))(b)
        b.light(SphereLight(radius=0.2, intensity=8.0), (0.0, 0.8, 0.0))

    b = SceneBuilder("midst")
    b.quad([(-3, 0, 3), (3, 0, 3), (3, 0, -3), (-3, 0, -3)], b.material(GREY), "floor")
    around(b)
    b.camera((0, 4, 5), (0, 0, 0), 0.7)
    scene = b.build()
    ours, rays = image(scene), image(scene, "ray-cast-area-light")
    white = np.percentile(rays, 99)
    assert np.sqrt(((ours - rays) ** 2).mean()) <= 0.03 * white
    assert abs(ours.mean() / rays.mean() - 1) <= 0.01


@pytest.mark.parametrize("half", [1e-4, 1e-3, 1e-2, 2.5])
def test_very_small_and_very_large_lights(half: float) -> None:
    """From next to a point, whose shadow is hard, to a ceiling of light: as by rays to the same points."""
    scene = stage(card(0.8), half=half)
    ours, rays = image(scene), image(scene, "ray-cast-area-light")
    assert np.sqrt(((ours - rays) ** 2).mean()) <= 0.04 * np.percentile(rays, 99)


def test_continuity_to_the_hard_shadow() -> None:
    """Lights of side 1e-2, 1e-3, 1e-4 tend to the hard shadow map's picture: the difference does not grow."""
    differences = []
    for half in (1e-1, 1e-2, 1e-4):
        scene = stage(card(0.8), half=half)
        hard = image(scene, "shadow-map", map_resolution=512)
        differences.append(float(np.abs(image(scene) - hard).mean() / hard.mean()))
    assert differences[0] > differences[1] >= differences[2] - 1e-3
    assert differences[2] <= 0.02


def test_light_touching_a_receiver() -> None:
    """A lamp that stands on the floor, edge on it: finite, and as by rays (points this near are ray cast)."""

    def upright(b: SceneBuilder) -> None:
        paint = b.material(Lambert("lamp", (0.0, 0.0, 0.0), emission=(9.0, 9.0, 9.0), double_sided=False))
        b.quad([(-0.5, 0, -0.5), (0.5, 0, -0.5), (0.5, 1, -0.5), (-0.5, 1, -0.5)], paint, "lamp")
        block((-0.2, 0.0, 0.4), (0.2, 0.5, 0.7))(b)

    b = SceneBuilder("touching")
    b.quad([(-3, 0, 3), (3, 0, 3), (3, 0, -3), (-3, 0, -3)], b.material(GREY), "floor")
    upright(b)
    b.camera((0, 4, 5), (0, 0, 0), 0.7)
    scene = b.build()
    method = renderers.get_method("pdsm")
    frame = method.render(scene, method.Settings(**QUICK, resolution=192), size=SIZE, seed=1)
    assert frame.counters["points_ray_cast"] > 0
    ours, rays = frame.layers["direct"][..., 0].astype(np.float64), image(scene, "ray-cast-area-light")
    assert np.isfinite(ours).all()
    assert np.sqrt(((ours - rays) ** 2).mean()) <= 0.03 * np.percentile(rays, 99)


def test_points_outside_of_the_frustum() -> None:
    """The documented answer is -1: behind a one-sided lamp, nearer than the near plane, beyond the far one, beside the window."""
    scene = stage(card(0.8))
    made = shadows(scene)
    world = scene.world()
    metres = np.array([[0, 3.5, 0], [0, 2.999, 0], [0, -3.0, 0], [9.0, 0, 0], [0, 0.4, 0]])
    found = made.hidden((metres - world.centre) * world.scale)
    assert found[:4].tolist() == [-1, -1, -1, -1]
    assert 0 <= found[4] <= 1


@pytest.mark.parametrize("unit", [1e-3, 1e4])
def test_scene_scale(unit: float) -> None:
    """Millimetres or ten kilometres: the same picture as in metres, to the rounding of float32 vertices."""
    here, there = image(stage(card(0.5, tilt=0.3))), image(stage(card(0.5, tilt=0.3), unit=unit))
    white = np.percentile(here, 99)
    # rounding moves single depths across the edge of a texel or an event: a few pixels by a few of the 36 light points
    assert np.sqrt(((here - there) ** 2).mean()) <= 0.005 * white
    assert abs(here.mean() / there.mean() - 1) <= 1e-3


def test_degenerate_triangles() -> None:
    """Slivers, points and needles among the casters change nothing, and no value is NaN."""

    def broken(b: SceneBuilder) -> None:
        card(0.5)(b)
        points = [
            (0, 1, 0),
            (1, 1, 0),
            (0.5, 1, 0),
            (0, 1, 1e-12),
            (0.3, 0.9, 0.2),
            (0.3, 0.9, 0.2),
            (0.3, 0.9, 0.2),
            (-2, 2, 1e-30),
        ]
        triangles = [(0, 1, 2), (0, 1, 3), (4, 5, 6), (0, 0, 1), (7, 7, 7), (0, 7, 3)]
        up = np.tile([0.0, 1.0, 0.0], (len(points), 1))
        b.node(meshes=(b.mesh(points, triangles, b.material(BLACK), normals=up),))

    clean, dirty = stage(card(0.5)), stage(broken)
    for name in ("pdsm", "averaged-shadow-maps", "layered-attenuation-map", "moment-shadow-map", "pcss", "shadow-map"):
        picture = image(dirty, name)
        assert np.isfinite(picture).all()
        assert np.abs(picture - image(clean, name)).max() <= 0.02 * picture.max(), name
    made = shadows(dirty)
    for one in made.maps:
        assert np.isfinite(one.depth).all()
        assert np.isfinite(one.value).all()
