"""Additive splatting: each item reaches the pixels whose surface lies inside its sphere, and adds what a GLSL snippet says.

An item is drawn as the screen-space bounds of its sphere, whatever the sphere's place (near the camera, around it, half off
the screen); the fragment tests the sphere exactly against the G-buffer. Items are added in their order, so the bytes don't
depend on threads.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.gl import camera, passes
from renderers.gl.context import context
from renderers.gl.gbuffer import ResidentGBuffer, on_gpu
from renderers.gl.programs import assign, program
from renderers.gl.upload import PAYLOAD, SPHERES
from renderers.scene.world import World


def splat(
    gbuffer: GBuffer | ResidentGBuffer,
    world: World,
    centres: NDArray[np.floating],
    radii: NDArray[np.floating],
    payload: NDArray[np.floating],
    snippet: str,
    uniforms: Mapping[str, Any] | None = None,
) -> NDArray[np.float32]:
    """Sum over items of `contribution` in each pixel whose position lies within the item's sphere, float32 (H, W, 4).

    centres (N, 3), radii (N,): World units. payload (N, K): floats that the snippet reads as `payload(item, k)`.
    snippet: GLSL with `vec4 contribution(Pixel pixel, int item, vec4 sphere)`; `Pixel`, `materials[]` and `brdf` are in scope
    (shaders/surface.glsl, brdf.glsl), and so are its own uniforms, set from `uniforms`. Raises moderngl.Error on bad GLSL, GLError.
    """
    import moderngl

    shader = program("splat.vert.glsl", "splat.frag.glsl", snippet)
    with on_gpu(gbuffer, world) as resident:
        size = resident.size
        target = passes.accumulator(size)
        if len(centres):
            buffers = _bound_items(centres, radii, payload)
            resident.bind(shader)
            assign(
                shader,
                view_matrix=camera.column_major(camera.view(world.camera.pose)),
                tangents=(camera.tangents(world, size)[0], -camera.tangents(world, size)[1]),
                shift=camera.shift(size, resident.offset),
                pixel=(2 / size[0], 2 / size[1]),
                payload_width=payload.shape[1],
                **(uniforms or {}),
            )
            quads = context().vertex_array(shader, [])
            passes.draw(
                target, quads, "splat", add=True, mode=moderngl.TRIANGLE_STRIP, vertices=4, instances=len(centres)
            )  # fmt: skip
            for buffer in buffers:
                buffer.release()
        image = passes.read(target.color_attachments[0]).copy()
        passes.release(target, *target.color_attachments)
    return image


def _bound_items(centres: NDArray[np.floating], radii: NDArray[np.floating], payload: NDArray[np.floating]) -> tuple[Any, Any]:
    spheres = np.column_stack([centres, radii]).astype(np.float32)
    sphere_buffer = context().buffer(spheres.tobytes())
    payload_buffer = context().buffer(np.ascontiguousarray(payload, np.float32).tobytes())
    sphere_buffer.bind_to_storage_buffer(SPHERES)
    payload_buffer.bind_to_storage_buffer(PAYLOAD)
    return sphere_buffer, payload_buffer
