"""Photon-mapped irradiance caching (Gautron 2006, chapter 6): records made of photons alone, splatted for any camera.

    R_k = a photon zone's harmonic mean of 1/d,  A = area its photons sampled (corrected hull),  E_k = Σ Φ_i / A
    L   = L_e + L_direct + ρ/π · Σ w_k max(0, E_k + (n_k × n)·∇_rE_k + (p - p_k)·∇_pE_k) / Σ w_k

No ray and no rasterisation makes a record: the cost of one doesn't depend on the scene's triangles, and all bounces are in it. One
walk over the photons covers all of them; a view is then a G-buffer, splats and direct light. A pixel that no record reaches lies
where no photon fell: `holes = fill` gives it a zone of its own, which grows up to a·r_max, and it is black if that holds no photon.

Glossy surfaces have radiance records: λ_i = Σ_j Φ_j H_i(ω_j) / (A n·ω_j) in hemispherical harmonics, each photon aimed at where
it came from, multiplied with the BRDF's coefficients as in `rcs`. Lobes that no order holds are traced. On curved surfaces A is
counted, by points spread over the scene.

Passes: photons (trace), tree, surface, records (the walk), radiance records, refine, in stage prepare since they serve any camera;
gbuffer, direct, splat.

| setting       | default   | unit | range                        | meaning                                                      |
| ------------- | --------- | ---- | ---------------------------- | ------------------------------------------------------------ |
| photons       | 400000    | 1    | 1 … 2²⁶                      | N_e, photons emitted                                         |
| most_stored   | 2·10⁷     | 1    | 1 … 10⁸                      | tracing ends once so many are stored (68 bytes each)         |
| a             | 0.2       | 1    | 0.01 … 1.4                   | accuracy: zones have radius a·R                              |
| knn           | 50        | 1    | 1 … 4096                     | K, photons of the first query                                |
| n_min         | 50        | 1    | 1 … 4096                     | fewest photons of a zone: it grows until it holds them       |
| gradients     | shrunk    |      | off, thresholded, shrunk     | noise rule of gradients                                      |
| n_grad        | 500       | 1    | 2 … 10⁶                      | fewest photons for gradients (thresholded)                   |
| rows, columns | 8, 24     | 1    | 2 … 64, 4 … 256              | hemisphere cells                                             |
| area          | corrected |      | disc, hull, corrected        | area that a zone's photons stand for                         |
| r_min, r_max  | auto, 1   | r    | > 0 … 10                     | limits of R, in scene radii; auto: 8 photons in the mean     |
| rounds        | 1         | 1    | 1 … 4096                     | progressive refinement: so many times N_e photons            |
| holes         | fill      |      | fill, black                  | pixels without a record                                      |
| records       | walk      |      | walk, pixels, gather         | cached; one at every pixel; none: final gathering            |
| glossy        | records   |      | records, diffuse             | glossy surfaces by radiance records, or as diffuse ones      |
| glossy_a      | 0.15      | 1    | 0.01 … 1                     | accuracy of radiance records: they reach glossy_a·R          |
| harmonics     | auto      | 1    | 2 … 16                       | order of radiance records; auto: by material, up to 12       |
| lobe_rays     | 64        | 1    | 1 … 4096                     | rays a pixel of lobes too sharp for records                  |
| gather_rays   | 256       | 1    | 1 … 65536                    | rays a pixel of records = gather                             |
| light_samples | 16        | 1    | 1 … 4096                     | samples of area lights and sky per pixel                     |
| subpixels     | 1         | 1    | 1 … 8                        | k: average k×k G-buffers, with common records                |
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from renderers.frame import Frame
from renderers.method import Claim, Context, Method, Transport, register, setting
from renderers.methods.photon_map import PhotonSettings, add_picture, layered, traced_map
from renderers.methods.photon_map import warm_up as warm_up_photons
from renderers.scene.model import Scene
from renderers.scene.world import World, WorldCamera

if TYPE_CHECKING:
    from renderers.gbuffer import GBuffer
    from renderers.transport.photons.density import F64
    from renderers.transport.photons.map import PhotonMap
    from renderers.transport.photons.view import Built
    from renderers.transport.photons.walk import Cache
    from renderers.transport.photons.zones import Recipe

SOURCE = "Gautron 2006 §6"
GATHER_RADIUS = 0.1


class PmicSettings(PhotonSettings):
    """Settings of photon-mapped irradiance caching."""

    photons: int = setting(400_000, "N_e, photons emitted", source="Gautron 2006 §6.6", ge=1, le=1 << 26)
    a: float = setting(0.2, "accuracy: a record reaches a·R far", source="Gautron 2006 eq. 6.1", ge=0.01, le=1.4)
    knn: int = setting(50, "K, photons of the first query", source="Gautron 2006 §6.4.1", ge=1, le=4096)
    n_min: int = setting(50, "fewest photons of a zone: it grows until it holds them", ge=1, le=4096)
    gradients: Literal["off", "thresholded", "shrunk"] = setting(
        "shrunk",
        "gradients off, from n_grad photons on, or shrunk by their noise",
        source="Gautron 2006 §6.4.3; James & Stein 1961",
    )
    n_grad: int = setting(500, "fewest photons of a zone for thresholded gradients", ge=2, le=10**6)
    rows: int = setting(8, "hemisphere cells in θ", source="Gautron 2006 §6.4.3", ge=2, le=64)
    columns: int = setting(24, "hemisphere cells in φ", source="Gautron 2006 §6.4.3", ge=4, le=256)
    area: Literal["disc", "hull", "corrected"] = setting(
        "corrected", "area that a zone's photons stand for", source="Gautron 2006 §6.4.2; Baldin & Reiß 2016"
    )
    r_min: float | None = setting(None, "smallest R; empty: that which holds 8 photons in the mean", unit="r", gt=0, le=10)
    r_max: float = setting(1.0, "largest R", unit="r", gt=0, le=10)
    rounds: int = setting(
        1,
        "progressive refinement: times N_e photons, averaged with a shrinking radius",
        source="Knaus & Zwicker 2011",
        ge=1,
        le=4096,
    )
    holes: Literal["fill", "black"] = setting("fill", "pixels without a record: from the nearest photons, or black")
    records: Literal["walk", "pixels", "gather"] = setting(
        "walk",
        "cached records; one at every pixel, which leaves out the error of interpolation; or none: final gathering from the same "
        "photons, which leaves out that of the density estimate too",
    )
    glossy: Literal["records", "diffuse"] = setting(
        "records", "glossy surfaces by radiance records, or as diffuse ones of the same mean albedo", source="Gautron 2006 §4.4"
    )
    glossy_a: float = setting(0.15, "accuracy of radiance records", source="Gautron 2006 §4.8", ge=0.01, le=1)
    harmonics: int | None = setting(
        None, "order of radiance records; empty: what the materials need, up to 12", source="Gautron 2006 §4.8", ge=2, le=16
    )
    lobe_rays: int = setting(64, "rays a pixel of lobes too sharp for records", ge=1, le=4096)
    gather_rays: int = setting(256, "rays a pixel of records = gather", source="Jensen 1996", ge=1, le=65536)


class PhotonMappedIrradianceCaching(Method):
    """All bounces, interpolated between records that were made of photons."""

    name = "pmic"
    title = "Photon-mapped irradiance caching"
    source = "Gautron 2006 chapter 6"
    Settings = PmicSettings
    claims: ClassVar = {
        "diffuse": Claim("approximated", "indirect light is the mean over photon zones, interpolated between records"),
        "glossy": Claim("approximated", "indirect light comes from radiance records made of photons; sharper lobes are traced"),
        "specular": Claim("approximated", "lobes are traced by a few rays a pixel, what they hit reflects as diffuse"),
    }

    def transport(self, settings: Any) -> Transport:
        """All bounces."""
        return "full"

    def _render(self, scene: Scene, settings: Any, context: Context) -> Frame:
        world, counters = scene.world(context.frame), Counter[str]()
        if settings.records == "gather":
            from renderers.methods.photon_map_final_gather import gathered

            return gathered(world, settings, settings.gather_rays, max(settings.knn, 2), GATHER_RADIUS, context)
        built = self.built(world, settings, context, counters)
        layers = shown(world, built, settings, context, counters)
        notes = built.photons.notes + notes_of(built.photons, settings, counters)
        captions = add_pictures(layers, world, built.photons, built.cache, context)
        return Frame(layers, context.watch.timings, dict(sorted(counters.items())), notes=notes, captions=captions)

    def built(self, world: World, settings: Any, context: Context, counters: Counter[str]) -> Built:
        """Photon map and records of a world: all that doesn't depend on the camera."""
        from renderers.transport.caching.glossy import warm_up as prepare_turns
        from renderers.transport.caching.reflectance import gloss_of
        from renderers.transport.photons.glossy import radiance_records
        from renderers.transport.photons.refine import refined
        from renderers.transport.photons.surface import surface_of
        from renderers.transport.photons.view import Built
        from renderers.transport.photons.walk import walk

        watch, radiance = context.watch, None
        with watch("warm-up", "prepare"):
            warm_up(world)
            gloss = gloss_of(world, settings.harmonics) if settings.glossy == "records" else None
            if gloss is not None and gloss.order:
                prepare_turns(gloss.order)
        photons = traced_map(world, settings, context.seed, False, watch, counters, "prepare")
        with watch("surface", "prepare"):
            photons = replace(photons, surface=surface_of(world, len(photons)))
        with watch("records", "prepare"):
            recipe = recipe_of(world, photons, settings)
            cache = walk(world, photons, recipe, counters=counters)
        if gloss is not None and gloss.order:
            with watch("radiance records", "prepare"):
                radiance = radiance_records(world, photons, recipe, settings.glossy_a, gloss.order, counters)
        if settings.rounds > 1:
            with watch("refine", "prepare"):
                cache = refined(world, photons, cache, recipe.estimator, context.seed, settings.rounds, counters)
        return Built(world, photons, cache, recipe, gloss, radiance)

    def walkthrough(
        self, scene: Scene, settings: Any, cameras: Sequence[WorldCamera], *, size: tuple[int, int] = (320, 180), seed: int = 0
    ) -> list[Frame]:
        """Frames of a static scene along a camera path, from one cache: only the first carries the timings of the stage prepare.

        Raises ValueError for records = gather, which makes no cache.
        """
        from renderers.frame import Stopwatch

        settings = self.Settings() if settings is None else settings
        if settings.records == "gather":
            raise ValueError("records = gather makes no cache to walk through")
        self.check(scene)
        world, counters = scene.world(0), Counter[str]()
        context = Context(size, seed, 0, Stopwatch())
        built = self.built(world, settings, context, counters)
        frames = []
        for camera in cameras:
            layers = shown(replace(world, camera=camera), built, settings, context, counters)
            frames.append(Frame(layers, context.watch.timings, dict(sorted(counters.items())), notes=built.photons.notes))
            context, counters = Context(size, seed, 0, Stopwatch()), Counter[str]()
        return frames


def recipe_of(world: World, photons: PhotonMap, settings: Any) -> Recipe:
    """The settings as `photons.zones` takes them; radii in scene radii are World units."""
    from renderers.transport.photons.density import ESTIMATOR
    from renderers.transport.photons.walk import smallest_radius
    from renderers.transport.photons.zones import GRADIENTS, Recipe

    smallest = smallest_radius(world, photons, settings.a) if settings.r_min is None else settings.r_min
    return Recipe(
        settings.a, min(smallest, settings.r_max), settings.r_max, settings.knn, settings.n_min, ESTIMATOR[settings.area],
        GRADIENTS[settings.gradients], settings.n_grad, settings.rows, settings.columns,
    )  # fmt: skip


def shown(world: World, built: Built, settings: Any, context: Context, counters: Counter[str]) -> dict[str, Any]:
    """Layers of one view of what was built; world: with the view's camera."""
    from renderers.transport.photons.view import Viewing, indirect_light

    splatted = settings.records == "walk"
    how = Viewing(splatted, settings.holes == "fill" or not splatted, settings.glossy_a, settings.lobe_rays)

    def indirect(gbuffer: GBuffer, seed: int) -> F64:
        return indirect_light(built, how, gbuffer, seed, counters)

    return layered(world, settings, context, counters, indirect, "splat")


def add_pictures(layers: dict[str, Any], world: World, photons: PhotonMap, cache: Cache, context: Context) -> dict[str, str]:
    """Add the layers debug.photons and debug.records, no part of the method's time; returns their captions."""
    from renderers.transport.photons.picture import RECORD_CAPTION, record_picture
    from renderers.transport.primary import cast_gbuffer

    captions, records = add_picture(layers, world, photons, context), cache.records
    gbuffer = cast_gbuffer(world, context.size)
    layers["debug.records"] = record_picture(world, gbuffer, records.position, records.normal, records.radius)
    return captions | {"debug.records": RECORD_CAPTION}


def notes_of(photons: PhotonMap, settings: Any, counters: Counter[str]) -> tuple[str, ...]:
    """Why pixels are black that no photon reached, and how many have traced lobes."""
    if not len(photons):
        return ("no light reaches a surface after a reflection: there is no indirect light",)
    notes = []
    if dark := counters["pixels_without_photons"]:
        notes.append(f"{dark} pixels have no photon within the largest zone: their indirect light is black")
    if traced := counters["pixels_traced"]:
        notes.append(f"{traced} pixels have lobes too sharp for radiance records and were traced, {settings.lobe_rays} rays each")
    return tuple(notes)


def warm_up(world: World) -> None:
    """Compile (or load) the kernels and build the ray caster, so that no measured pass pays for it."""
    from renderers.transport.caching.splat import warm_up as compile_splat

    warm_up_photons(world)
    compile_splat()


register(PhotonMappedIrradianceCaching)
