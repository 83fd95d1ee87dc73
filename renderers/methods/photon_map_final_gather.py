"""Photon map behind a final gather (Jensen 1996): every pixel looks around by rays, and reads the map where they end.

    L(x, v) = L_e + L_direct + 1/M Σ_m f_r(ω_m, v) (n·ω_m) / p(ω_m) · ρ(y_m)/π E(y_m)

E comes from the whole map (direct photons too), computed beforehand at one photon in four and taken from the nearest
(Christensen 1999). The map's blur and noise are one reflection away from the eye; what is left is the noise of M rays. The dear way
to use a photon map, and the reference for the cheap ones.

Passes: photons (trace), tree, irradiance (at the photons), gbuffer, direct, gather.

| setting       | default | unit | range                 | meaning                                              |
| ------------- | ------- | ---- | --------------------- | ---------------------------------------------------- |
| photons       | 200000  | 1    | 1 … 2²⁶               | N_e, photons emitted                                 |
| most_stored   | 2·10⁷   | 1    | 1 … 10⁸               | tracing ends once so many are stored (68 bytes each) |
| rays          | 64      | 1    | 1 … 65536             | M, rays per pixel                                    |
| nearest       | 50      | 1    | 2 … 4096              | photons of an irradiance estimate                    |
| radius        | 0.1     | r    | > 0 … 1               | largest look-up, in scene radii                      |
| area          | corrected |    | disc, hull, corrected | area that the photons stand for                      |
| light_samples | 16      | 1    | 1 … 4096              | samples of area lights and sky per pixel             |
| subpixels     | 1       | 1    | 1 … 8                 | k: average k×k G-buffers                             |
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from renderers.frame import Frame
from renderers.method import Claim, Context, Method, Transport, register, setting
from renderers.methods.photon_map import SOURCE, PhotonSettings, add_picture, layered, traced_map, warm_up
from renderers.scene.model import Scene
from renderers.scene.world import World

if TYPE_CHECKING:
    from renderers.gbuffer import GBuffer
    from renderers.transport.photons.density import F64


class FinalGatherSettings(PhotonSettings):
    """Settings of `photon-map-final-gather`."""

    rays: int = setting(64, "M, rays per pixel", source=SOURCE, ge=1, le=65536)
    nearest: int = setting(50, "photons of an irradiance estimate", source=SOURCE, ge=2, le=4096)
    radius: float = setting(0.1, "largest look-up, in scene radii", unit="r", source=SOURCE, gt=0, le=1)
    area: Literal["disc", "hull", "corrected"] = setting("corrected", "area the photons stand for", source="Gautron 2006 §6.4")


class FinalGather(Method):
    """Photon map seen through one bounce of ray casting."""

    name = "photon-map-final-gather"
    title = "Photon map with final gathering"
    source = "Jensen 1996; Christensen 1999"
    Settings = FinalGatherSettings
    claims: ClassVar = {
        "glossy": Claim(
            "approximated", "exact at the receiver and along the photons; seen by a gather ray, a glossy surface is diffuse"
        ),
        "specular": Claim("approximated", "mirror-like surfaces reflect the photon map of what they see, as diffuse surfaces"),
    }

    def transport(self, settings: Any) -> Transport:
        """All bounces."""
        return "full"

    def _render(self, scene: Scene, settings: Any, context: Context) -> Frame:
        return gathered(scene.world(context.frame), settings, settings.rays, settings.nearest, settings.radius, context)


def gathered(world: World, settings: Any, rays: int, nearest: int, radius: float, context: Context) -> Frame:
    """A frame by final gathering with `rays` a pixel from a map of `settings` (PhotonSettings with an `area`).

    nearest, radius: photons of a look-up at most, and how far they may lie, in scene radii.
    """
    watch, counters = context.watch, Counter[str]()
    with watch("warm-up", "prepare"):
        warm_up(world)
    photons = traced_map(world, settings, context.seed, True, watch, counters)
    with watch("irradiance"):
        from renderers.transport.photons.density import lookup
        from renderers.transport.photons.final_gather import final_gather, stored_irradiance
        from renderers.transport.photons.pixels import gatherers

        stored = stored_irradiance(world, photons, lookup(nearest, radius, settings.area))

    def indirect(gbuffer: GBuffer, seed: int) -> F64:
        pixels = gatherers(world, gbuffer)
        return pixels.image(gbuffer, final_gather(world, pixels, stored, rays, seed, counters))

    layers = layered(world, settings, context, counters, indirect, "gather")
    captions = add_picture(layers, world, photons, context)
    return Frame(layers, watch.timings, dict(sorted(counters.items())), notes=photons.notes, captions=captions)


register(FinalGather)
