"""Penumbra deep shadow maps (St-Amour 2004): soft shadows of area lights from a structure that answers at any point.

    V(P) = 1/N Σ_i [D_i(P) + b < Z]          share of the light that N shadow maps hide from P, stored along rays from the light
    C = Σ_e C_e (1 - V_e)                    direct light of the area lights e

Construction (algorithms 3.1 and 3.2): stratified points on the light, a shadow map from each; every ray of a pyramid around the
light is followed through every map, its visibility changes are sorted and summed to V(Z), and V is compressed to few line segments
within epsilon. Rendering (algorithm 4.1): look V up at each pixel's surface point, bilinearly between four rays. Passes: warm-up,
maps (build), gbuffer, direct.

Extensions: light points of a Hammersley set (pattern = stratified are the published ones); exact texel traversal (walk = midpoint
is the published one), in lockstep where the light is flat; up to six pyramids around a light instead of one; the bias that each
texel's own plane needs, at most half way to the next surface; light from behind the receiver's plane counts once, by rays where V
alone can't tell; points near the light that no pyramid covers are ray cast.

| setting        | default  | unit | range                            | meaning                                                    |
| -------------- | -------- | ---- | -------------------------------- | ---------------------------------------------------------- |
| samples        | 64       | 1    | 1 … 4096                         | N, points on each light, one shadow map each               |
| pattern        | hammers… |      | hammersley, stratified           | light points of rectangles and discs                       |
| resolution     | 256      | px   | 8 … 4096                         | pixels of a pyramid across 90°                             |
| map_resolution | 256      | px   | 8 … 4096                         | texels across a shadow map                                 |
| walk           | exact    |      | exact, midpoint                  | rays through shadow maps: every texel, or as published     |
| compression    | vertical |      | none, vertical, perpendicular    | metric of epsilon                                          |
| epsilon        | 0.02     | 1    | 0.0001 … 0.5                     | tolerance of the compression                               |
| filter         | bilinear |      | bilinear, nearest                | between functions of neighbouring pixels                   |
| bias           | 0.00025  | r    | 0 … 1                            | added to all depths, in scene radii                        |
| normal_offset  | 0.0      | 1    | 0 … 8                            | lookup on the receiver's plane, lifted so far; 0: off      |
| slope_bias     | 0.2      | r    | 0 … 1                            | largest bias of slanted surfaces in maps, in scene radii   |
| near           | 1.0      | 1    | 0.01 … 100                       | near plane's distance from the light, in its half sizes    |
| lights         | 8        | 1    | 1 … 64                           | brightest area lights with maps; others are ray cast       |
| horizon        | rays     |      | rays, share                      | light partly behind the receiver's plane: shadow rays, or  |
|                |          |      |                                  | V less the share behind                                    |
| light_samples  | 64       | 1    | 1 … 4096                         | samples per pixel of the unshadowed light                  |
| memory         | 1024     | MiB  | 1 … 65536                        | bound on what lives at a time while it is built            |
| subpixels      | 1        | 1    | 1 … 8                            | k: average k×k G-buffers                                   |
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

from renderers.method import register, setting
from renderers.methods.soft_shadows import SoftShadows, SoftShadowSettings
from renderers.scene.world import World

if TYPE_CHECKING:
    from renderers.transport.penumbra.build import LightShadows
    from renderers.transport.penumbra.emitters import Emitter
    from renderers.transport.penumbra.shading import F64, Hidden


class PdsmSettings(SoftShadowSettings):
    """Settings of penumbra deep shadow maps."""

    resolution: int = setting(256, "pixels of a pyramid across 90°", unit="px", source="St-Amour 2004 §3.1", ge=8, le=4096)
    walk: Literal["exact", "midpoint"] = setting(
        "exact", "rays through shadow maps: every texel touched, or the published scan conversion", source="St-Amour 2004 §3.1"
    )
    compression: Literal["none", "vertical", "perpendicular"] = setting(
        "vertical", "metric of the tolerance epsilon", source="St-Amour 2004 §3.2"
    )
    epsilon: float = setting(0.02, "tolerance of the compression, share of the light", source="St-Amour 2004 §3.2", ge=1e-4, le=0.5)
    filter: Literal["bilinear", "nearest"] = setting(
        "bilinear", "between functions of neighbouring pixels", source="St-Amour 2004 §4.1"
    )
    bias: float = setting(2.5e-4, "added to all stored depths, in scene radii", unit="r", source="St-Amour 2004 §3.1", ge=0, le=1)
    normal_offset: float = setting(
        0.0, "lookup on the receiver's plane, lifted: 1 lets no plane shadow itself even without slope_bias", ge=0, le=8
    )
    slope_bias: float = setting(
        0.2, "largest additional bias of slanted surfaces, in scene radii; at most half way to the next", unit="r", ge=0, le=1
    )
    memory: int = setting(
        1024, "bound on what lives at a time while maps are built", unit="MiB", source="St-Amour 2004 §3.4", ge=1, le=65536
    )


class PenumbraDeepShadowMaps(SoftShadows):
    """Soft shadows of area lights, read from attenuation functions along rays from the light."""

    name = "pdsm"
    title = "Penumbra deep shadow maps"
    source = "St-Amour 2004; St-Amour, Paquette & Poulin 2005"
    Settings = PdsmSettings
    how_area = "the hidden share weighs all parts of a light alike, and is resampled from rays of a pyramid around it"

    def warm_up(self) -> None:
        """Import, and compile kernels (or load them from numba's cache), so that no measured pass pays for it."""
        from renderers.transport.penumbra.build import warm_up

        warm_up()

    def prepare(
        self, world: World, emitters: Sequence[Emitter], points: Sequence[F64], settings: Any, counters: Counter[str]
    ) -> Hidden:
        """Build the maps of every light."""
        from renderers.transport.penumbra.assemble import Construction
        from renderers.transport.penumbra.build import Slope, build

        how = Construction(
            bias=settings.bias,
            walk=settings.walk,
            compression=settings.compression,
            epsilon=settings.epsilon,
            memory=settings.memory << 20,
        )
        shadows: list[LightShadows] = []
        for emitter, light_points in zip(emitters, points, strict=True):
            one = build(
                world, emitter, light_points, resolution=settings.resolution, map_resolution=settings.map_resolution, how=how,
                slope=Slope(settings.slope_bias, settings.filter), near=settings.near, counters=counters,
                held=sum(s.nbytes for s in shadows),
            )  # fmt: skip
            shadows.append(one)
        counters["bytes_functions"] = sum(m.bytes for s in shadows for m in s.maps)
        return lambda k, positions, normals: shadows[k].hidden(positions, normals, settings.normal_offset, settings.filter)


register(PenumbraDeepShadowMaps)
