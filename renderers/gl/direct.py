"""Direct lighting with shadow maps: one map and one additive full-screen pass per light sample."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.gl import lights, passes
from renderers.gl.gbuffer import ResidentGBuffer, on_gpu
from renderers.gl.lights import LightSample
from renderers.gl.programs import assign, program
from renderers.gl.shadow import shadow_map
from renderers.scene.world import World

KINDS = {"point": 0, "spot": 1, "directional": 2, "area": 3}


def direct(
    world: World, gbuffer: GBuffer | ResidentGBuffer, shadow_resolution: int = 1024, light_samples: int = 16, taps: int = 0
) -> NDArray[np.float32]:
    """Direct light reflected to the eye, radiance float32 (H, W, 3); emission is not in it, the background is 0.

    shadow_resolution: texels along a tile's side. light_samples: for all emitting triangles, and again for the environment
    (soft shadows are sums of that many hard ones). taps: percentage-closer filtering over (2 taps + 1)² texels, 0 for the
    hard test. Raises GLError.
    """
    return lit_by(world, gbuffer, lights.light_samples(world, light_samples), shadow_resolution, taps)


def lit_by(
    world: World, gbuffer: GBuffer | ResidentGBuffer, samples: list[LightSample], shadow_resolution: int = 1024, taps: int = 0
) -> NDArray[np.float32]:
    """`direct` from the given samples alone."""
    shader = program("fullscreen.vert.glsl", "direct.frag.glsl")
    with on_gpu(gbuffer, world) as resident:
        target = passes.accumulator(resident.size)
        for sample in samples:
            shadow = shadow_map(world, sample, shadow_resolution, taps)
            resident.bind(shader)
            shadow.bind(shader, 4, taps)
            assign_light(shader, sample)
            passes.draw_fullscreen(target, shader, "direct light", add=True)
            shadow.release()
        image = passes.read_rgb(target.color_attachments[0])
        passes.release(target, *target.color_attachments)
    return image


def assign_light(shader: Any, sample: LightSample) -> None:
    """Tell a shader that includes `light.glsl` which light it adds."""
    assign(
        shader,
        light_kind=KINDS[sample.kind],
        light_position=tuple(sample.position),
        light_axis=tuple(sample.axis),
        light_intensity=tuple(sample.intensity),
        light_cosines=sample.cosines,
    )
