"""How `trc` samples hemispheres and foresees them: its settings, with what they take from `transport` and `gl`.

Not a method of its own.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from renderers.methods.one_bounce import is_software
from renderers.methods.ray_records import PILOT_RAYS, warm_up
from renderers.scene.world import World

if TYPE_CHECKING:
    from renderers.transport.temporal.motion import Motion
    from renderers.transport.temporal.plane import Draw
    from renderers.transport.temporal.sampling import Ahead, TemporalSampler


def backend_of(backend: str, device: str) -> str:
    """The table behind `backend=auto`: software rasterisers → cpu, others → gl."""
    if backend != "auto":
        return backend
    return "cpu" if is_software(device) else "gl"


def prepare(world: World, settings: Any) -> None:
    """`ray_records.warm_up`, and the same for planes, where they are asked for."""
    warm_up(world)
    if settings.sampler == "plane":
        from renderers.transport.caching.records import Sites

        up = np.array([[0.0, 0.0, 1.0]])
        samplers_of(world, settings, 0, Counter(), None)[0].sample(Sites(np.zeros((1, 3)), up, up), np.arange(1))
        if settings.prediction == "reproject":
            draw_of(settings.backend)(up[None].astype(np.float32), 4, 1.0)


def samplers_of(
    world: World, settings: Any, seed: int, counters: Counter[str], order: int | None
) -> tuple[TemporalSampler, TemporalSampler]:
    """What computes the records of a frame, and what finds the distances that say where they go. order: of radiance records."""
    from renderers.transport.caching.hemisphere import grid_of
    from renderers.transport.caching.incoming import ReflectedDirectLight
    from renderers.transport.caching.plane import side_of
    from renderers.transport.temporal.plane_sampling import TemporalPlaneSampler
    from renderers.transport.temporal.sampling import TemporalSampler

    incoming = ReflectedDirectLight(world)
    pilot = TemporalSampler(world, grid_of(PILOT_RAYS), incoming, seed, counters)
    if order is not None:
        return TemporalSampler(world, grid_of(settings.glossy_rays), incoming, seed, counters, settings.sparse, order), pilot
    if settings.sampler == "plane":
        return TemporalPlaneSampler(world, side_of(settings.rays), incoming, seed, counters, settings.sparse), pilot
    return TemporalSampler(world, grid_of(settings.rays), incoming, seed, counters, settings.sparse), pilot


def ahead_of(motion: Motion, sampler: TemporalSampler, settings: Any) -> Ahead | None:
    """What foresees the records of a sampler; None where nothing changes."""
    from renderers.transport.caching.incoming import ReflectedDirectLight
    from renderers.transport.temporal.plane_sampling import PlaneReprojection, TemporalPlaneSampler
    from renderers.transport.temporal.prediction import RayCast, Reprojection

    if motion.still:
        return None
    later = ReflectedDirectLight(motion.after)
    # hits can only be followed on triangles that are still there
    if settings.prediction == "raycast" or not motion.same_topology:
        return RayCast(motion, sampler, later)
    if isinstance(sampler, TemporalPlaneSampler):
        return PlaneReprojection(motion, sampler, later, draw_of(settings.backend), settings.follow)
    return Reprojection(motion, sampler, later, settings.footprints, settings.follow)


def draw_of(backend: str) -> Draw:
    """What draws reprojected planes."""
    if backend == "gl":
        from renderers.gl.reprojection import reprojected as drawn_by_gl

        return drawn_by_gl
    from renderers.transport.temporal.plane import reprojected

    return reprojected
