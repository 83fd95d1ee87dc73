"""Temporal accumulation of path-traced frames: variance, motion, what is hidden, bytes."""

from dataclasses import replace

import numpy as np
import pytest
from temporal_rooms import room

from renderers import get_method
from renderers.scene.builder import SceneBuilder
from renderers.scene.builtin.solids import quads_shape
from renderers.scene.model import Lambert
from renderers.transport.primary import cast_gbuffer
from renderers.transport.temporal.accumulation import History, accumulated

SIZE = (24, 18)


def test_a_still_pixel_averages_as_many_frames_as_alpha_says() -> None:
    """α = 1/n until alpha: the mean of n frames; then variance falls to α/(2 - α) of one frame's."""
    world = room().world()
    gbuffer = cast_gbuffer(world, SIZE)
    rng, past, images = np.random.default_rng(0), None, []
    for k in range(60):
        images.append(rng.normal(1, 0.3, (SIZE[1], SIZE[0], 3)).astype(np.float32))
        past = accumulated(images[-1], world, gbuffer, past, 0.1)
        if k == 7:
            np.testing.assert_allclose(past.mean, np.mean(images, axis=0, dtype=np.float64), rtol=1e-3)
    assert past is not None
    # 1296 values: the standard error of a variance is 4 %
    assert np.var(past.mean) == pytest.approx(0.09 * 0.1 / 1.9, rel=0.2)


def test_the_past_follows_a_moving_camera_and_object() -> None:
    """Each pixel shows its own world position: followed back, the mean of two frames is that position again, up to interpolation
    within a pixel. What came into view has no past."""
    scene = room(
        camera=lambda t: np.stack([-0.2 + 0.3 * t, -1.95 + 0 * t, 1.5 + 0 * t], 1),
        cube=lambda t: np.stack([0.3 + 0.1 * t, 0.4 + 0 * t, 0.45 + 0 * t], 1),
    )
    past: History | None = None
    for k in (0, 1):
        world = scene.world(k)
        gbuffer = cast_gbuffer(world, SIZE)
        past = accumulated(gbuffer.position, world, gbuffer, past, 0.5)
    assert past is not None
    followed = past.age > 1.5
    assert 0.7 < followed.mean() < 1
    error = np.linalg.norm(past.mean - gbuffer.position, axis=2)
    # the world moved by the pixel's own motion: on surfaces at rest the mean of both positions is the position; edges take the
    # nearest pixel, up to a pixel (0.06 of the distance) off
    rests = followed & (world.instance[gbuffer.triangle] != world.instance.max())
    assert np.median(error[rests]) < 1e-3
    assert error[rests].max() < 0.1
    np.testing.assert_array_equal(past.mean[~followed], gbuffer.position[~followed])


def test_what_another_instance_covered_is_forgotten() -> None:
    scene = room(cube=lambda t: np.stack([-0.6 + 0.6 * t, 0.4 + 0 * t, 0.45 + 0 * t], 1))
    worlds = [scene.world(k) for k in (0, 1)]
    gbuffers = [cast_gbuffer(w, SIZE) for w in worlds]
    past = accumulated(np.ones((SIZE[1], SIZE[0], 3), np.float32), worlds[0], gbuffers[0], None, 0.5)
    now = accumulated(np.zeros((SIZE[1], SIZE[0], 3), np.float32), worlds[1], gbuffers[1], past, 0.5)
    old, new = (w.instance[g.triangle] for w, g in zip(worlds, gbuffers, strict=True))
    uncovered = (old == worlds[0].instance.max()) & (new != worlds[0].instance.max())
    assert uncovered.sum() > 5
    # only where all four pixels around were covered, nothing of them is taken
    assert np.median(now.age[uncovered]) == 1


def test_no_surface_takes_the_past_of_another() -> None:
    """From a camera that slides along: one instance (a shelf, what lies below it, and a slope of 45° that rises from there), and a
    tile beside it in the plane of the latter. Each pixel shows the number of its surface, and the mean of two frames is that
    number again, whether edge, depth or instance parts it from its neighbours."""
    b = SceneBuilder("step")
    paint = b.material(Lambert())

    def quad(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> list[tuple[float, float, float]]:
        return [(x[0], y[0], z[0]), (x[1], y[0], z[1]), (x[1], y[1], z[1]), (x[0], y[1], z[0])]

    faces = [quad((-2.5, -1), (-1, 1), (0.5, 0.5)), quad((-2, -0.3), (-1, 0), (0, 0)), quad((-0.3, 0.2), (-1, 0), (0, 0.5))]
    b.place(quads_shape(faces), paint, "step")
    b.quad(quad((-2, -0.3), (0, 1), (0, 0)), paint, "tile")
    camera = b.camera((0, 0, 3), (0, 0, 0), np.radians(30))
    b.animate(camera, "translation", [0, 1 / 24], [(0, 0, 3), (0.33, 0, 3)])
    scene, past = b.build(), None
    for k in (0, 1):
        world = scene.world(k)
        gbuffer = cast_gbuffer(world, (256, 64))
        # halves of the step's three faces come one after the other
        face = np.where(gbuffer.triangle < 6, gbuffer.triangle % 3, 3)
        number = np.repeat(face[..., None], 3, axis=2).astype(np.float32)
        past = accumulated(number, world, gbuffer, past, 0.5)
    assert past is not None
    assert set(np.unique(number[gbuffer.covered])) == {0, 1, 2, 3}
    assert (past.age[gbuffer.covered] > 1.5).mean() > 0.7
    np.testing.assert_allclose(past.mean[gbuffer.covered], number[gbuffer.covered], atol=1e-9)


@pytest.mark.mitsuba
def test_bytes_first_frame_and_noise() -> None:
    scene, method, pt = replace(room()), get_method("pt-temporal"), get_method("pt")
    settings = method.Settings(spp=4, transport="direct")
    frames = list(method.render_frames(scene, settings, size=SIZE, seed=1, frames=(0, 3)))
    again = list(method.render_frames(scene, settings, size=SIZE, seed=1, frames=(0, 1)))
    assert [f.layers["beauty"].tobytes() for f in frames[:2]] == [f.layers["beauty"].tobytes() for f in again]
    assert frames[-1].counters["pixels_followed"] == frames[-1].counters["pixels_covered"]
    truth = pt.render(scene, pt.Settings(spp=64, transport="direct"), size=SIZE).layers["beauty"]
    np.testing.assert_allclose(frames[-1].layers["beauty"].mean(), truth.mean(), rtol=0.02)
