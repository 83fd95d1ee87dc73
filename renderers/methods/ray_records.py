"""What `rcs` and `trc` share: the settings of records made of rays, where records go, and what is prepared once.

Not a method of its own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from renderers.method import Settings, setting
from renderers.scene.world import World

if TYPE_CHECKING:
    from renderers.gbuffer import GBuffer
    from renderers.transport.caching.placement import Placement
    from renderers.transport.caching.traced import Price

PILOT_RAYS = 64
BY_CURVATURE = ("hessian", "hessian-bounded")


class RecordSettings(Settings):
    """Settings of methods that interpolate light between records, each made of a hemisphere of rays."""

    a: float = setting(0.15, "accuracy: a record reaches a·R far", source="Gautron 2006 eq. 2.8", ge=0.01, le=1.4)
    rays: int = setting(4096, "rays a record", source="Gautron 2006 §4.8", ge=16, le=65536)
    weight: Literal["ward", "shifted", "tent"] = setting(
        "ward", "weighting function", source="Ward 1988; Tabellion & Lamorlette 2004"
    )
    gradients: bool = setting(True, "extrapolate with rotation and translation gradients", source="Ward & Heckbert 1992")
    r_min: float = setting(0.03, "smallest R", unit="r", source="Tabellion & Lamorlette 2004", ge=1e-6, le=1)
    r_max: float = setting(2.0, "largest R", unit="r", source="Tabellion & Lamorlette 2004", ge=1e-6, le=1000)
    footprint: float = setting(
        1.0, "smallest reach of a record, in pixels", unit="px", source="Tabellion & Lamorlette 2004", ge=0, le=100
    )
    order: Literal["batched", "sequential"] = setting(
        "batched", "misses found for the whole image and thinned, or one by one", source="luxmeter; Gautron 2006 alg. 4"
    )
    glossy: Literal["records", "diffuse"] = setting(
        "records", "glossy surfaces by radiance records, or as diffuse ones of the same mean albedo", source="Gautron 2006 §4.4"
    )
    glossy_a: float = setting(0.15, "accuracy of radiance records", source="Gautron 2006 §4.8", ge=0.01, le=1)
    glossy_rays: int = setting(16384, "rays a radiance record", ge=16, le=65536)
    glossy_pixels: int | None = setting(
        None,
        "fewest pixels that a radiance record is made for: fewer are traced, glossy_rays / 2 glossy_pixels rays each; 1: none are;"
        " empty: by their lobes, so that tracing them isn't dearer than a record",
        source="luxmeter", ge=1, le=65536,
    )  # fmt: skip
    harmonics: int | None = setting(
        None, "order of radiance records; empty: what the materials need, up to 12", source="Gautron 2006 §4.8", ge=2, le=16
    )
    sharp: Literal["traced", "truncated"] = setting("traced", "lobes beyond the order: traced from each pixel, or cut to the order")
    lobe_rays: int = setting(256, "rays a pixel of a traced lobe", ge=1, le=4096)
    light_samples: int = setting(16, "samples of area lights and environment, per pixel of the direct layer", ge=1, le=4096)

    @model_validator(mode="after")
    def _known_curvature(self) -> Self:
        """Raises ValueError where the sampler doesn't know what `placement` needs; methods bring both."""
        if getattr(self, "sampler", None) == "plane" and getattr(self, "placement", None) in BY_CURVATURE:
            raise ValueError("this placement needs another sampler: the plane knows no curvature")
        return self

    @property
    def by_curvature(self) -> str:
        """What `placement=auto` stands for where the sampler knows the curvature of the irradiance."""
        return "hessian"


def placement_of(world: World, height: int, settings: Any, seed: int) -> Placement:
    """The settings as `caching.placement` takes them, for images so high; radii in scene radii are World units."""
    from renderers.transport.caching.limits import Footprint, Limits
    from renderers.transport.caching.placement import Placement

    pixel, kind = 2 * np.tan(world.camera.yfov / 2) / height, chosen_placement(settings)
    by_curvature = kind in BY_CURVATURE
    limits = Limits(
        smallest=min(settings.r_min, settings.r_max),
        largest=settings.r_max,
        gradient=kind in ("bounded", "hessian-bounded"),
        neighbours=settings.neighbours,
        footprint=Footprint(world.camera.pose[:3, 3], settings.footprint * pixel / settings.a),
        metric="hessian" if by_curvature else "split-sphere",
    )
    return Placement(settings.a, settings.weight, settings.gradients, limits, settings.order, seed, sees=by_curvature)


def glossy_placement_of(world: World, height: int, settings: Any, seed: int) -> Placement:
    """The same for radiance records, whose curvature nobody knows."""
    return placement_of(world, height, settings.model_copy(update={"a": settings.glossy_a, "placement": "bounded"}), seed)


def price_of(settings: Any) -> Price:
    """What radiance records cost."""
    from renderers.transport.caching.traced import Price

    return Price(settings.glossy_rays, settings.glossy_pixels)


def chosen_placement(settings: Any) -> str:
    """What `placement=auto` stands for: by curvature, wherever the sampler knows it."""
    if settings.placement != "auto":
        return str(settings.placement)
    return "bounded" if settings.sampler == "plane" else str(settings.by_curvature)


def albedos(world: World, gbuffer: GBuffer) -> NDArray[np.float64]:
    """`caching.reflectance.stand_in_albedo`, for methods whose caches hold irradiance alone."""
    from renderers.transport.caching.reflectance import stand_in_albedo

    return stand_in_albedo(world, gbuffer)


def warm_up(world: World) -> None:
    """Import, compile kernels and build the ray caster, so that no measured pass pays for it."""
    import renderers.transport.primary  # noqa: F401
    from renderers.transport.caching.hemisphere import PolarSampler, grid_of
    from renderers.transport.caching.incoming import ReflectedDirectLight
    from renderers.transport.caching.records import Sites
    from renderers.transport.caching.splat import warm_up as compile_splat

    compile_splat()
    up = np.array([[0.0, 0.0, 1.0]])
    PolarSampler(world, grid_of(16), ReflectedDirectLight(world))(Sites(np.zeros((1, 3)), up, up))
