"""Hemicubes around many points at once, drawn into one atlas: what `renderers.transport.caching.hemicube` computes records from.

Each face of each hemicube is an instance of the World, clipped to a rectangle of its own: one draw call for a batch of hemicubes,
whatever textures the World has, since only the numbers of the triangles are drawn. A hemicube of faces N texels wide takes N × 3N
texels of the atlas: the upper face below, then the upper halves of the four others.

`Triangles` reads those numbers back. `LitHemicubes` computes on the device what each texel sees and adds its direct light, one
full-screen pass and one shadow map a light sample; the maps are drawn once. Emitting surfaces and the sky are SOFT samples each, of
which a texel takes one in STRIDE² and its neighbours in a block of STRIDE × STRIDE others: few samples for all texels would be a
wrong light, the same for all records; few for each are noise, averaged over thousands of texels.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.gl import passes
from renderers.gl.context import check, context, device
from renderers.gl.direct import assign_light
from renderers.gl.gbuffer import WRAP, ResidentGBuffer
from renderers.gl.lights import light_samples
from renderers.gl.programs import assign, program
from renderers.gl.shadow import ShadowMap, shadow_map
from renderers.gl.upload import VERTEX_FLOATS, Uploaded, srgb_table, upload
from renderers.scene.world import World

F64 = NDArray[np.float64]
TEXELS = 1 << 20  # of one atlas
NEAR = 1e-5
EYES = 6
SOFT, STRIDE = 256, 4
SHARP_RESOLUTION, SOFT_RESOLUTION = 1024, 256
CLIP_DISTANCE0 = 0x3000
INSTANCE = "3f 3f 3f 3f 3f 3f/i"
ATTRIBUTES = ("in_eye", "in_right", "in_up", "in_forward", "in_lift", "in_place")
# right, up, forward in the frame (tangent, other tangent, normal); the sides look along azimuths 0, 90, …
FACES = np.array(
    [
        [(1, 0, 0), (0, 1, 0), (0, 0, 1)],
        [(0, 1, 0), (0, 0, 1), (1, 0, 0)],
        [(-1, 0, 0), (0, 0, 1), (0, 1, 0)],
        [(0, -1, 0), (0, 0, 1), (-1, 0, 0)],
        [(1, 0, 0), (0, 0, 1), (0, -1, 0)],
    ],
    np.float64,
)


class Triangles:
    """Draws which triangle each texel of hemicubes sees. lift: how far the eyes lie off their surfaces, World units."""

    def __init__(self, world: World, lift: float) -> None:
        self._world, self._lift = world, lift

    def batch(self, size: int) -> int:
        """How many hemicubes of faces `size` texels wide are drawn at once."""
        return max(1, TEXELS // (3 * size * size))

    def __call__(self, eyes: F64, lifts: F64, axes: F64, size: int, counters: Counter[str]) -> NDArray[Any]:
        """Triangles int32 (K, 3 size²), -1 where nothing is, of hemicubes at eyes (K, 3), K ≤ batch.

        lifts (K, 3): unit, which way each eye was lifted off its surface. axes (K, 3, 3): two tangents and the normal, around which
        the upper face lies. size: even. counters: `draw_calls` is added to. Raises GLError.
        """
        with self._drawn(eyes, lifts, axes, size) as atlas:
            counters["draw_calls"] += 1
            return self._cut(passes.read(atlas), len(eyes), size)

    @contextmanager
    def _drawn(self, eyes: F64, lifts: F64, axes: F64, size: int) -> Iterator[Any]:
        """The atlas of triangles, R32I, for the block."""
        ctx, uploaded = context(), upload(self._world)
        extent = _extent(len(eyes), size)
        atlas, depth = ctx.texture(extent, 1, dtype="i4"), passes.depth_target(extent)
        target = passes.framebuffer([atlas], depth)
        passes.clear(target, (-1, -1, -1, -1), depth=0.0)
        shader = program("hemicube.vert.glsl", "hemicube.frag.glsl")
        assign(
            shader,
            scale=(size / extent[0], size / extent[1]),
            zero_to_one=device().zero_to_one,
            near=NEAR,
            skipped=(-1.9 * self._lift, -0.1 * self._lift),
        )
        instances = ctx.buffer(_instances(eyes, lifts, axes, size, extent).tobytes())
        if uploaded.triangles:
            with _clipped():
                passes.draw(
                    target, _vertices(uploaded, shader, instances), "hemicubes", depth=True,
                    vertices=3 * uploaded.triangles, instances=5 * len(eyes),
                )  # fmt: skip
        passes.release(target, depth, instances)
        try:
            yield atlas
        finally:
            atlas.release()

    @staticmethod
    def _cut(image: NDArray[Any], count: int, size: int) -> NDArray[Any]:
        """Hemicubes (K, 3 size², C) out of an atlas (H, W, C); C = 1 is dropped."""
        height, width, components = image.shape
        tiles = image.reshape(height // (3 * size), 3 * size, width // size, size, components).swapaxes(1, 2)
        cut = tiles.reshape(-1, 3 * size * size, components)[:count]
        return np.ascontiguousarray(cut[..., 0] if components == 1 else cut)


class LitHemicubes(Triangles):
    """Draws hemicubes with the direct light that surfaces in them reflect, without emission and sky. lift: as in `Triangles`."""

    def __init__(self, world: World, lift: float) -> None:
        super().__init__(world, lift)
        self._lights = light_samples(world, SOFT)
        self._punctual = sum(bool(light.intensity.any()) for light in world.lights)
        self._maps: list[ShadowMap] = [
            shadow_map(world, light, SHARP_RESOLUTION if k < self._punctual else SOFT_RESOLUTION)
            for k, light in enumerate(self._lights)
        ]

    def __call__(self, eyes: F64, lifts: F64, axes: F64, size: int, counters: Counter[str]) -> NDArray[Any]:
        """Radiance and 1/distance, float32 (K, 3 size², 4), 0 where nothing is; otherwise as `Triangles`. Raises GLError."""
        rows = np.zeros((len(eyes), 4, 4), np.float32)
        rows[:, 0, :3], rows[:, 1:, :3] = eyes, axes
        buffer = context().buffer(rows.tobytes())
        buffer.bind_to_storage_buffer(EYES)
        where = {"size": size, "columns": _extent(len(eyes), size)[0] // size, "count": len(eyes)}
        with self._drawn(eyes, lifts, axes, size) as triangles:
            seen, light = self._surfaces(triangles, where)
            counters["draw_calls"] += 1
            self._add_light(seen, light, where)
            image = self._cut(passes.read(light), len(eyes), size)
            seen.release()
        for part in (light, buffer):
            part.release()
        return image

    def _surfaces(self, triangles: Any, where: dict[str, int]) -> tuple[ResidentGBuffer, Any]:
        """G-buffer of an atlas, and its light: RGBA32F, still dark, with 1/distance."""
        ctx, uploaded = context(), upload(self._world)
        position, normal, base, light = (ctx.texture(triangles.size, 4, dtype="f4") for _ in range(4))
        ids = ctx.texture(triangles.size, 2, dtype="i4")
        target = passes.framebuffer([position, normal, base, ids, light])
        black = (0.0, 0.0, 0.0, 0.0)
        passes.clear(target, black, black, black, (-1, -1, 0, 0), black)
        shader = program("fullscreen.vert.glsl", "hemicube_surface.frag.glsl")
        triangles.use(2)
        srgb_table().use(1)
        uploaded.bind()
        for texture in sorted({run[2] for run in uploaded.runs}):
            if texture >= 0:
                uploaded.textures[texture].use(0)
                wrap = self._world.textures[texture].wrap
                assign(shader, wrap=(WRAP[wrap[0]], WRAP[wrap[1]]))
            assign(shader, triangle_map=2, image=0, srgb=1, texture_index=texture, nearest=self._lift, **where)
            passes.draw_fullscreen(target, shader, "surfaces of hemicubes")
        passes.release(target)
        return ResidentGBuffer(self._world, position, normal, base, ids, (0.5, 0.5)), light

    def _add_light(self, seen: ResidentGBuffer, light: Any, where: dict[str, int]) -> None:
        shader = program("fullscreen.vert.glsl", "hemicube_light.frag.glsl")
        target = passes.framebuffer([light])
        for k, (sample, shadow) in enumerate(zip(self._lights, self._maps, strict=True)):
            stride = 1 if k < self._punctual else STRIDE
            seen.bind(shader)
            shadow.bind(shader, 4, 0)
            assign_light(shader, sample)
            assign(shader, stride=stride, turn=(k - self._punctual) % stride**2, **where)
            passes.draw_fullscreen(target, shader, "light of hemicubes", add=True)
        passes.release(target)


def _extent(count: int, size: int) -> tuple[int, int]:
    """Width and height of an atlas of hemicubes, nearly square."""
    columns = int(np.ceil(np.sqrt(3 * count)))
    return columns * size, -(-count // columns) * 3 * size


def _instances(eyes: F64, lifts: F64, axes: F64, size: int, extent: tuple[int, int]) -> NDArray[np.float32]:
    """Rows of INSTANCE, five a hemicube, float32 (5 K, 18)."""
    columns, index = extent[0] // size, np.arange(len(eyes))
    rows = np.zeros((len(eyes), 5, 18), np.float32)
    rows[..., 0:3], rows[..., 12:15] = eyes[:, None], lifts[:, None]
    rows[..., 3:12] = np.einsum("fij,kjd->kfid", FACES, axes).reshape(len(eyes), 5, 9)
    # middle of the upper face; horizon of the others
    middle = np.array([size / 2] + [size + k * size / 2 for k in range(4)])
    x, y = index % columns * size + size / 2, index // columns * (3 * size)
    rows[..., 15] = (2 * x / extent[0] - 1)[:, None]
    rows[..., 16] = 2 * (y[:, None] + middle) / extent[1] - 1
    rows[:, 0, 17] = -1
    return rows.reshape(-1, 18)


def _vertices(uploaded: Uploaded, shader: Any, instances: Any) -> Any:
    positions = (uploaded.vertices, f"3f {4 * (VERTEX_FLOATS - 3)}x", "in_position")
    return context().vertex_array(
        shader, [positions, (instances, INSTANCE, *ATTRIBUTES)], index_buffer=uploaded.indices, index_element_size=4
    )


@contextmanager
def _clipped() -> Iterator[None]:
    """The four clip distances of `hemicube.vert.glsl`, on for the block."""
    from OpenGL import GL

    for k in range(4):
        GL.glEnable(CLIP_DISTANCE0 + k)
    try:
        yield
    finally:
        for k in range(4):
            GL.glDisable(CLIP_DISTANCE0 + k)
        check(context(), "hemicubes")
