"""Table 5.1 of Gautron 2006: how far the irradiance foreseen for the next frame is from what it then is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jobs.claims.bench import Bench
from jobs.claims.model import Measurement, PublishedClaim, held, row
from jobs.claims.registry import register

if TYPE_CHECKING:
    from renderers.scene.model import Scene
    from renderers.transport.temporal.motion import Motion
    from renderers.transport.temporal.sampling import Ahead, TemporalSampler

    # samplers of this frame and the next, and what foresees
    Ways = tuple[TemporalSampler, TemporalSampler, dict[str, Ahead | None]]

F64 = NDArray[np.float64]
SCENES = ("cube-in-a-box", "moving-light", "bouncing-spheres")
FRAMES, PLACES, RAYS = 8, 48, 4096
SIZE = (64, 48)
WITHOUT, WITH = (0.0, 0.32, 0.037, 0.024), (0.0, 0.30, 0.029, 0.016)
PUBLISHED = {"without": WITHOUT, "with": WITH, "plane_without": WITHOUT, "plane": WITH, "plane_gl": WITH}
STATISTICS: dict[str, Callable[[F64], np.floating[Any]]] = {"min": np.min, "max": np.max, "mean": np.mean, "median": np.median}
WAYS = {
    "without": "light taken as constant",
    "with": "reprojection, footprints of 4×4 points",
    "points": "reprojection, single points",
    "raycast": "recasting",
    "plane_without": "one plane as published, light taken as constant",
    "plane": "one plane as published, reprojection by the CPU",
    "plane_gl": "one plane as published, reprojection by OpenGL",
}


def measure(bench: Bench) -> Measurement:
    """All ways at the same records."""
    found: dict[str, list[F64]] = {way: [] for way in WAYS}
    for name in SCENES:
        scene = bench.open(name).scene
        for number, frame in enumerate(np.linspace(3, 190, FRAMES).astype(int)):
            bench.report(f"{name}: frame {frame}")
            for way, part in errors_at(scene, int(frame), number).items():
                found[way].append(part)
    errors = {way: np.concatenate(parts) for way, parts in found.items()}
    rows = []
    for way, words in WAYS.items():
        for column, (statistic, function) in enumerate(STATISTICS.items()):
            printed = PUBLISHED[way][column] if way in PUBLISHED and statistic in ("mean", "median") else None
            values = [float(function(errors[way]))]
            rows.append(
                row(f"{way}.{statistic}", f"{statistic} error, {words}", "of E(t+1)", printed, values, "lower", comparable=False)
            )
    for statistic in ("mean", "median"):
        for way, kind, where in (("with", "", ""), ("plane", "plane_", " on the published plane")):
            lower = [bool(STATISTICS[statistic](errors[way]) < STATISTICS[statistic](errors[f"{kind}without"]))]
            rows.append(held(f"{kind}{statistic}_lower", f"reprojection lowers the {statistic} error{where}", lower))
    notes = [
        f"{len(errors['with'])} records at random pixels of {', '.join(SCENES)}; {RAYS} rays each, on polar hemispheres, that "
        "miss no direction, and on the published plane; the published 4523 values are of unknown scenes, so only the order counts",
        "errors are differences from the same hemisphere cast anew one frame later; records on moving surfaces are left out",
    ]
    return Measurement("built-in animated scenes", rows, notes)


def errors_at(scene: Scene, frame: int, seed: int) -> dict[str, F64]:
    """Relative errors, (K,) each, at places that rest and are lit."""
    from renderers.transport.caching.records import Sites
    from renderers.transport.direct import receivers_of
    from renderers.transport.primary import cast_gbuffer
    from renderers.transport.temporal.motion import motion_between

    motion = motion_between(scene.world(frame), scene.world(frame + 1))
    gbuffer = cast_gbuffer(motion.before, SIZE)
    rests = np.flatnonzero(gbuffer.covered.ravel() & ~motion.moved[gbuffer.triangle.ravel()])
    rows = np.random.default_rng(seed).choice(rests, PLACES, replace=False)
    sites, places = Sites(*receivers_of(motion.before, gbuffer, rows)), np.arange(PLACES)
    errors = {}
    for now, then, foreseen in (polar_ways(motion), plane_ways(motion)):
        truth = then.sample(sites, places)[0].irradiance.sum(axis=1)
        lit = truth > 1e-3 * truth.mean()
        for way, ahead in foreseen.items():
            value = now.sample(sites, places, ahead)[1].irradiance.sum(axis=1)
            errors[way] = np.abs(value[lit] / truth[lit] - 1)
    return errors


def polar_ways(motion: Motion) -> Ways:
    """On polar hemispheres."""
    from renderers.transport.caching.hemisphere import grid_of
    from renderers.transport.caching.incoming import ReflectedDirectLight
    from renderers.transport.temporal.prediction import RayCast, Reprojection
    from renderers.transport.temporal.sampling import TemporalSampler

    lights = [ReflectedDirectLight(world) for world in (motion.before, motion.after)]
    now = TemporalSampler(motion.before, grid_of(RAYS), lights[0], 0, Counter())
    then = TemporalSampler(motion.after, grid_of(RAYS), lights[1], 0, Counter())
    points = {way: Reprojection(motion, now, lights[1], side) for way, side in (("with", 4), ("points", 1))}
    return now, then, {"without": None, **points, "raycast": RayCast(motion, now, lights[1])}


def plane_ways(motion: Motion) -> Ways:
    """On the square plane of the publication."""
    from renderers.methods.foresight import draw_of
    from renderers.transport.caching.incoming import ReflectedDirectLight
    from renderers.transport.caching.plane import side_of
    from renderers.transport.temporal.plane_sampling import PlaneReprojection, TemporalPlaneSampler

    lights = [ReflectedDirectLight(world) for world in (motion.before, motion.after)]
    now = TemporalPlaneSampler(motion.before, side_of(RAYS), lights[0], 0, Counter())
    then = TemporalPlaneSampler(motion.after, side_of(RAYS), lights[1], 0, Counter())
    ways = {way: PlaneReprojection(motion, now, lights[1], draw_of(by)) for way, by in (("plane", "cpu"), ("plane_gl", "gl"))}
    return now, then, {"plane_without": None, **ways}


register(PublishedClaim("trc-table-5.1", "Error of the irradiance foreseen one frame ahead", "Gautron 2006 table 5.1", measure))
