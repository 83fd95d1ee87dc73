"""Facts of single scenes: published Cornell data, thin walls, gears in mesh, motion."""

from __future__ import annotations

import numpy as np
import pytest

from renderers import Scene, load_scene
from renderers.scene.builtin.gears import outline
from renderers.scene.model import Phong


def volume(scene: Scene, name: str) -> float:
    """Signed volume of the closed surface of all nodes of one name; a missing face counts as seen from the floor."""
    parts = [scene.meshes[i] for n in scene.nodes for i in n.meshes if n.name == name]
    p = np.concatenate([m.positions[m.triangles] for m in parts]).astype(np.float64)
    return float(np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2])).sum() / 6)


def shoelace(ring: tuple[tuple[float, float], ...]) -> float:
    x, y = np.array(ring).T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


def test_cornell_dimensions_camera_and_light_are_the_published_ones() -> None:
    scene = load_scene("cornell-box", light="area")
    points = {tuple(np.round(p * 1000, 1)) for m in scene.meshes for p in m.positions.astype(np.float64)}
    published = {
        (552.8, 0, 0), (0, 0, 0), (0, 0, 559.2), (549.6, 0, 559.2), (556, 548.8, 0), (556, 548.8, 559.2), (0, 548.8, 559.2),
        (0, 548.8, 0),
        (343, 548.8, 227), (343, 548.8, 332), (213, 548.8, 332), (213, 548.8, 227),
        (130, 165, 65), (82, 165, 225), (240, 165, 272), (290, 165, 114), (290, 0, 114), (240, 0, 272), (130, 0, 65), (82, 0, 225),
        (423, 330, 247), (265, 330, 296), (314, 330, 456), (472, 330, 406), (423, 0, 247), (472, 0, 406), (314, 0, 456),
        (265, 0, 296),
    }  # fmt: skip
    assert published <= points
    camera = next(n for n in scene.nodes if n.camera is not None)
    assert camera.translation == (0.278, 0.273, -0.8)
    assert np.degrees(scene.cameras[0].yfov) == pytest.approx(39.3, abs=0.01)


def test_cornell_walls_face_into_the_room_and_boxes_outwards() -> None:
    scene = load_scene("cornell-box", light="area")
    for node in scene.nodes:
        for i in node.meshes:
            mesh = scene.meshes[i]
            if "box" not in node.name:
                inside = np.array([0.278, 0.273, 0.28]) - mesh.positions.mean(axis=0)
                assert (mesh.normals @ inside > 0).all(), node.name
    for name, height in (("short box", 0.165), ("tall box", 0.330)):
        from renderers.scene.builtin import cornell

        ring = cornell.SHORT if name == "short box" else cornell.TALL
        # the open bottom lies in y = 0, where it adds nothing to the volume
        assert volume(scene, name) == pytest.approx(shoelace(ring) * height, rel=1e-5)


def test_cornell_ceiling_and_lamp_tile_the_ceiling_without_overlap() -> None:
    scene = load_scene("cornell-box", light="area")
    area = 0.0
    for node in scene.nodes:
        if node.name in ("ceiling", "lamp"):
            p = scene.meshes[node.meshes[0]].positions.astype(np.float64).reshape(-1, 3, 3)
            area += float(np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum() / 2)
    assert area == pytest.approx(0.556 * 0.5592, rel=1e-5)
    lamp = next(m for m in scene.materials if m.name == "lamp")
    assert not lamp.double_sided


def test_cornell_glossy_back_wall_is_phong_and_conserves_energy() -> None:
    scene = load_scene("cornell-glossy")
    (back,) = [m for m in scene.materials if isinstance(m, Phong)]
    assert back.exponent == 20
    assert max(np.add(back.diffuse, back.specular)) <= 1
    assert load_scene("cornell-glossy", exponent=5).hash != scene.hash


def test_empty_room_is_convex_closed_and_faces_inwards() -> None:
    world = load_scene("empty-room").world(0)
    positions = world.positions.astype(np.float64)
    # every vertex lies in front of (or in) the plane of every triangle
    heights = (positions[:, None] - positions[world.triangles[:, 0]]) * world.face_normals
    assert heights.sum(axis=-1).min() > -1e-6
    assert world.areas.sum() / world.scale**2 == pytest.approx(108, rel=1e-6)


def test_no_straight_line_joins_the_rooms_of_thin_wall() -> None:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    for thickness in (0.0, 0.001, 0.1):
        scene = load_scene("thin-wall", thickness=thickness)
        world = scene.world(0)
        caster = EmbreeScene()
        TriangleMesh(caster, np.ascontiguousarray(world.positions[world.triangles]))
        rng = np.random.default_rng(2)
        starts = (rng.uniform((-0.99, 0.01, -0.99), (-thickness / 2 - 1e-3, 0.99, -0.01), (3000, 3)) - world.centre) * world.scale
        ends = (rng.uniform((thickness / 2 + 1e-3, 0.01, -0.99), (0.99, 0.99, -0.01), (3000, 3)) - world.centre) * world.scale
        hit = caster.run(starts.astype(np.float32), (ends - starts).astype(np.float32), query="DISTANCE")
        # distances are in units of the given directions: under 1 is between start and end
        assert (hit < 1).all()


def test_colonnade_is_open_to_the_sun_and_the_aisles_are_not() -> None:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    world = load_scene("colonnade", triangles=20_000).world(0)
    caster = EmbreeScene()
    TriangleMesh(caster, np.ascontiguousarray(world.positions[world.triangles]))
    rng = np.random.default_rng(3)
    court = (rng.uniform((-11, 0.01, -3), (11, 0.02, 3), (500, 3)) - world.centre) * world.scale
    aisle = (rng.uniform((-11, 0.01, 5.5), (11, 0.02, 6.9), (500, 3)) - world.centre) * world.scale
    up = np.tile(np.array([0, 1, 0], np.float32), (500, 1))
    assert (caster.run(court.astype(np.float32), up) < 0).mean() > 0.9
    assert (caster.run(aisle.astype(np.float32), up) >= 0).all()
    sun = np.tile(-world.lights[0].direction.astype(np.float32), (500, 1))
    lit = (caster.run(court.astype(np.float32), sun) < 0).mean()
    assert 0.3 < lit < 0.95
    assert (caster.run(aisle.astype(np.float32), sun) >= 0).all()


def test_gear_outlines_are_simple_counter_clockwise_and_of_the_right_radii() -> None:
    for teeth in (12, 24, 40):
        ring = outline(teeth, 6)
        radius, angle = np.linalg.norm(ring, axis=1), np.unwrap(np.arctan2(ring[:, 1], ring[:, 0]))
        assert (np.diff(angle) > 0).all()
        assert radius.max() == pytest.approx(0.05 * (teeth / 2 + 1))
        assert radius.min() == pytest.approx(0.05 * (teeth / 2 - 1.25))


@pytest.mark.parametrize("frame", [0, 7, 33])
def test_gears_mesh_without_overlap_while_turning(frame: int) -> None:
    """No outline point of one gear lies inside the body of another: even-odd rule in the plane of the train."""
    from matplotlib.path import Path

    scene = load_scene("gears", steps=6, turning=True).at(frame)
    bodies = []
    for node in scene.nodes:
        if node.name.startswith("gear "):
            teeth = int(node.name.split()[1])
            z, w = node.rotation[2], node.rotation[3]
            c, s = w * w - z * z, 2 * z * w
            bodies.append(outline(teeth, 6) @ np.array([[c, s], [-s, c]]) + np.array(node.translation[:2]))
    assert len(bodies) == 5
    for i, body in enumerate(bodies):
        for k, other in enumerate(bodies):
            if i != k:
                assert not Path(body).contains_points(other).any(), (i, k)


@pytest.mark.parametrize(
    ("name", "moving", "still"),
    [
        ("cube-in-a-box", ["cube"], "floor"),
        ("kite", ["kite", "tail 8"], "tiles"),
        ("bouncing-spheres", ["sphere 0", "sphere 65"], "floor"),
        ("interior", ["ball", "top", "lamp"], "table"),
    ],
)
def test_animation_moves_what_it_should(name: str, moving: list[str], still: str) -> None:
    from renderers.scene.world import global_matrices

    scene = load_scene(name)
    names = [n.name for n in scene.nodes]
    poses = [global_matrices(scene.at(frame).nodes) for frame in (0, 13)]
    for part in moving:
        assert np.abs(poses[0][names.index(part)] - poses[1][names.index(part)]).max() > 1e-3
    assert (poses[0][names.index(still)] == poses[1][names.index(still)]).all()


def test_moving_light_moves_only_its_light_and_comes_round() -> None:
    scene = load_scene("moving-light", period=100)
    first, later, last = (scene.world(f) for f in (0, 25, 100))
    assert (first.positions == later.positions).all()
    assert np.linalg.norm(first.lights[0].position - later.lights[0].position) > 0.1
    np.testing.assert_allclose(first.lights[0].position, last.lights[0].position, atol=1e-12)


@pytest.mark.parametrize(("name", "frames"), [("cube-in-a-box", 400), ("bouncing-spheres", 200)])
def test_loops_close(name: str, frames: int) -> None:
    scene = load_scene(name)
    np.testing.assert_allclose(scene.world(0).positions, scene.world(frames).positions, atol=1e-6)


def test_the_lamp_of_the_interior_rests_after_a_third_and_all_else_goes_on() -> None:
    scene = load_scene("interior", frames=30)
    lamps = [scene.world(frame).lights[0].position for frame in (9, 10, 11, 30)]
    assert np.linalg.norm(lamps[1] - lamps[0]) > 1e-3
    assert (lamps[1] == lamps[2]).all()
    assert (lamps[1] == lamps[3]).all()
    assert (scene.world(20).positions != scene.world(21).positions).any()


def test_the_interior_has_more_than_100_thousand_triangles() -> None:
    assert len(load_scene("interior").world(0).triangles) > 100_000


@pytest.mark.parametrize("name", ["cube-in-a-box", "interior", "kite", "bouncing-spheres"])
def test_moving_parts_stay_in_the_room(name: str) -> None:
    scene = load_scene(name)
    room = scene.world(0).positions
    low, high = room.min(axis=0), room.max(axis=0)
    for frame in range(0, 400, 23):
        p = scene.world(frame).positions
        assert (p >= low - 1e-6).all()
        assert (p <= high + 1e-6).all()


def test_spheres_never_touch() -> None:
    scene = load_scene("bouncing-spheres")
    balls = [(n.translation[0], n.translation[2], n.scale[0]) for n in scene.nodes if n.name.startswith("sphere ")]
    x, z, r = np.array(balls).T
    gap = np.hypot(x[:, None] - x, z[:, None] - z) - (r[:, None] + r)
    assert gap[~np.eye(66, dtype=bool)].min() > 0


def test_cube_in_a_box_has_24_triangles_and_the_kite_about_28_thousand() -> None:
    assert len(load_scene("cube-in-a-box").world(0).triangles) == 24
    assert len(load_scene("kite").world(0).triangles) == pytest.approx(28_000, rel=0.1)
    assert len(load_scene("bouncing-spheres").world(0).triangles) == 66 * 968 + 10
