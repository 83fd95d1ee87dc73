"""OpenGL, the CPU ray caster and Mitsuba see the same scene: coverage, position, normal, albedo, for every built-in scene."""

from __future__ import annotations

import numpy as np
import pytest

import renderers
from renderers.gbuffer import GBuffer
from renderers.scene.model import Scene
from tests.scaling import scaled

SIZE = (160, 90)
SCENES = sorted(renderers.builtin_scenes())


def views(scene: Scene, size: tuple[int, int]) -> tuple[GBuffer, GBuffer, dict[str, np.ndarray]]:
    """The scene's first hits as GL, the ray caster and Mitsuba see them."""
    from renderers.gl.gbuffer import render_gbuffer
    from renderers.reference.visible import first_hits
    from renderers.transport.primary import cast_gbuffer

    world = scene.world()
    return render_gbuffer(world, size), cast_gbuffer(world, size), first_hits(world, size)


def assert_same_view(ours: GBuffer, theirs: dict[str, np.ndarray]) -> None:
    """Coverage differs in < 0.1 % of pixels; position 99th percentile < 1e-5 of the scene's size, normals < 0.1°."""
    covered = ours.covered & theirs["coverage"]
    differing = np.count_nonzero(ours.covered != theirs["coverage"])
    assert differing < 1e-3 * covered.size
    assert covered.any()
    # The World has half diagonal 1: its size is 2.
    distance = np.linalg.norm(ours.position.astype(np.float64) - theirs["position"], axis=-1)[covered] / 2
    assert np.percentile(distance, 99) < 1e-5
    a, b = ours.normal.astype(np.float64)[covered], theirs["normal"].astype(np.float64)[covered]
    # The chord gives the angle where its cosine has no digits left.
    angle = 2 * np.degrees(np.arcsin(np.clip(np.linalg.norm(a - b, axis=-1) / 2, 0, 1)))
    assert np.percentile(angle, 99) < 0.1
    albedo = np.abs(ours.base.astype(np.float64) - theirs["albedo"]).max(axis=-1)[covered]
    assert np.percentile(albedo, 99) < 1e-3


@pytest.mark.gl
@pytest.mark.mitsuba
@pytest.mark.parametrize("name", SCENES)
def test_gl_and_ray_caster_see_what_mitsuba_sees(name: str) -> None:
    gl, cast, mitsuba = views(renderers.load_scene(name), SIZE)
    assert_same_view(gl, mitsuba)
    assert_same_view(cast, mitsuba)


@pytest.mark.gl
@pytest.mark.mitsuba
@pytest.mark.parametrize("factor", [1e-3, 1e4])
@pytest.mark.parametrize("name", SCENES)
def test_the_view_does_not_depend_on_the_scale(name: str, factor: float) -> None:
    gl, cast, mitsuba = views(scaled(renderers.load_scene(name), factor), SIZE)
    assert_same_view(gl, mitsuba)
    assert_same_view(cast, mitsuba)


@pytest.mark.mitsuba
@pytest.mark.parametrize("factor", [1.0, 1e-3, 1e4])
def test_ray_cast_direct_light_of_a_point_light_equals_the_reference(factor: float) -> None:
    """Relative difference < 1e-3 in 99 % of the pixels that see a lit surface, at any scale."""
    import renderers.reference
    from renderers.transport.direct import direct
    from renderers.transport.primary import cast_gbuffer

    scene = scaled(renderers.load_scene("cornell-box"), factor)
    world = scene.world()
    ours = direct(world, cast_gbuffer(world, SIZE)).astype(np.float64)
    truth = renderers.reference.render(scene, "direct", SIZE, 0.02).image.astype(np.float64)
    lit = truth.max(axis=-1) > 0
    off = np.abs(ours - truth).max(axis=-1) > 1e-3 * truth.max(axis=-1)
    assert np.count_nonzero(off) <= 0.01 * np.count_nonzero(lit)
