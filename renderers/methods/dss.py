"""Deep screen space (Nalbach, Ritschel & Seidel 2014): all triangles become surfels, each of which lights the pixels near it.

    L(x) = L_e + L_direct + Σ_{|x - y_j| ≤ R} f_r ⟨n_x, l⟩⁺ ⟨n_j, -l⟩⁺ / max(ε_b, r²) · ρ_j/π · E_j · A_j

Triangles are split until a piece's edge looks no longer than `surfel_size` pixels from the eye, on the screen or off it, seen or
hidden: so light doesn't change when the camera turns. Pieces are the surfels; they are splatted on the pixels within one radius R,
with interleave = s each on one of s² sub-images that a filter joins. Triangles are never merged: cost grows with their number.
Light from beyond R is lost, and occlusion of the bounce is left out: with R = 2 (the whole scene) the image is that of `ir` with
regular points. Passes: surfels, light, gbuffer, direct, splat.

| setting           | default          | unit | range               | meaning                                               |
| ----------------- | ---------------- | ---- | ------------------- | ----------------------------------------------------- |
| radius            | 0.3              | r    | 0 … 2               | R in scene radii                                      |
| surfel_size       | 16               | px   | 0.25 … 1024         | longest edge of a surfel, as seen from the eye        |
| levels            | 6                | 1    | 0 … 10              | a triangle becomes 4^levels surfels at most           |
| interleave        | 1                | 1    | 1, 2, 4, 8          | s: each surfel in one of s² sub-images, then a filter |
| eps_b             | (1 % of radius)² | m²   | ≥ 0                 | clamp on the squared distance, the same as `ir`'s     |
| light_samples     | 16               | 1    | 1 … 4096            | samples of area lights and sky, per pixel and surfel  |
| direct_visibility | raycast          |      | raycast, shadow-map | shadows of the direct layer                           |
| backend           | auto             |      | auto, gl, cpu       | auto: a fixed table on the device string              |
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.method import Context, register, setting
from renderers.methods.ir import InstantRadiosity
from renderers.methods.one_bounce import OneBounce, OneBounceSettings, make_gbuffer
from renderers.scene.model import Scene
from renderers.scene.world import LAMBERT, World

if TYPE_CHECKING:
    from renderers.gbuffer import GBuffer
    from renderers.transport.vpl import Vpls

PAPER = "Nalbach, Ritschel & Seidel 2014"


class DssSettings(OneBounceSettings):
    """Settings of deep screen space."""

    radius: float = setting(0.3, "R, how far a surfel's light reaches, in scene radii", unit="r", source=f"{PAPER} §4", gt=0, le=2)
    surfel_size: float = setting(
        16.0, "longest edge of a surfel as seen from the eye", unit="px", source=f"{PAPER} §4", ge=0.25, le=1024
    )
    levels: int = setting(
        6, "a triangle becomes 4^levels surfels at most (OpenGL's tessellator: 64 × 64)", source=PAPER, ge=0, le=10
    )
    interleave: Literal[1, 2, 4, 8] = setting(
        1, "s: each surfel in one of s² sub-images, then a filter; sizes must be divisible by s", source=f"{PAPER} §5"
    )


class Made(NamedTuple):
    """The lit surfels and the sub-image of each."""

    surfels: Vpls
    place: NDArray[np.int64]


class DeepScreenSpace(OneBounce):
    """One bounce from surfels of all geometry, over one radius."""

    name = "dss"
    title = "Deep screen space"
    source = PAPER
    pass_name = "splat"
    Settings = DssSettings
    claims: ClassVar = InstantRadiosity.claims

    def warm_up(self, world: World, settings: Any) -> None:
        """A splat of nothing on one pixel."""
        from renderers.transport.vpl import Vpls

        none = np.zeros((0, 3), np.float32)
        gbuffer = make_gbuffer(world, (1, 1), (0.5, 0.5), settings.backend)
        splat(world, gbuffer, Vpls(none, none, none, np.zeros(0, np.int64), 0), settings, Counter())

    def prepare(self, scene: Scene, world: World, settings: Any, context: Context, counters: Counter[str]) -> Made:
        """Split triangles, light the pieces, draw a sub-image for each."""
        from renderers.transport.sampling import generator
        from renderers.transport.surfels import pieces_of
        from renderers.transport.vpl import emit_at

        with context.watch("surfels"):
            pieces = pieces_of(world, context.size[1], settings.surfel_size, settings.levels)
        with context.watch("light"):
            surfels = emit_at(world, *pieces, context.seed, settings.light_samples, counters)
        places = generator(context.seed, "sub-images").integers(settings.interleave**2, size=surfels.drawn)
        return Made(surfels, places[surfels.index])

    def bounce(
        self, world: World, gbuffer: GBuffer, lit: NDArray[np.float32], made: Made, settings: Any, seed: int, counters: Counter[str]
    ) -> NDArray[np.float32]:
        """All surfels on the whole picture, or each on its sub-image, s² times as strong, and then the filter."""
        side = settings.interleave
        if side == 1:
            return splat(world, gbuffer, made.surfels, settings, counters)
        from renderers.transport.interleave import joined, sub_images

        lambert = gbuffer.covered & (world.materials.kind[gbuffer.material] == LAMBERT)
        white = replace(gbuffer, base=np.where(lambert[..., None], np.float32(1), gbuffer.base))
        image = np.empty(lit.shape, np.float32)
        for index, (place, part) in enumerate(sub_images(white, side)):
            image[place] = splat(world, part, chosen(made.surfels, made.place == index, side * side), settings, counters)
        return joined(image, gbuffer, side) * np.where(lambert[..., None], gbuffer.base, np.float32(1))


def chosen(surfels: Vpls, which: NDArray[np.bool_], times: float) -> Vpls:
    """Some of the surfels, `times` as strong."""
    return replace(
        surfels,
        positions=surfels.positions[which],
        normals=surfels.normals[which],
        intensities=surfels.intensities[which] * np.float32(times),
        index=surfels.index[which],
    )


def splat(world: World, gbuffer: GBuffer, surfels: Vpls, settings: Any, counters: Counter[str]) -> NDArray[np.float32]:
    """One splatting pass on the resolved backend, float32 (H, W, 3). The World's radius is 1, so `radius` needs no scale."""
    eps_b = settings.eps_b * world.scale**2
    if settings.backend == "gl":
        from renderers.gl.surfels import splat_surfels as splat_gl

        arrays = surfels.positions, surfels.normals, surfels.intensities
        image, touched = splat_gl(gbuffer, world, *arrays, settings.radius, eps_b)
        counters["pixels_touched"] += touched
        return image
    from renderers.transport.surfels import splat_surfels

    return splat_surfels(gbuffer, world, surfels, settings.radius, eps_b, counters)


register(DeepScreenSpace)
