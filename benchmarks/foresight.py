"""What foreseeing a record of temporal caching costs beside computing it: recast, reprojected on the CPU, reprojected on OpenGL.

    python -m benchmarks.foresight [--scene NAME@FRAME]… [--records 128] [--repeats 5]

CPU milliseconds a record, all threads, medians over the repeats; 4096 rays a record on the published plane. `sampling`: its rays,
their light, and what is made of them. `reprojection`: all that foreseeing it so adds, the light of what moved included, which
takes shadow rays; `of it drawing`: points into planes, holes filled, read back where OpenGL does it. Figures: docs/methods/trc.md.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable

import numpy as np

from renderers.methods.foresight import draw_of
from renderers.scene.load import load_scene
from renderers.transport.caching.hemisphere import RAYS_PER_TASK
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.plane import HALF_WIDTH
from renderers.transport.caching.records import Sites
from renderers.transport.direct import receivers_of
from renderers.transport.primary import cast_gbuffer
from renderers.transport.temporal.motion import Motion, motion_between
from renderers.transport.temporal.plane_sampling import PlaneReprojection, TemporalPlaneSampler
from renderers.transport.temporal.prediction import RayCast
from renderers.transport.threads import chunks

SCENES = ("cube-in-a-box@5", "moving-light@10", "bouncing-spheres@100", "interior@240", "interior@400")
SIDE = 64
COLUMNS = ("sampling", "recasting", "reprojection, CPU", "reprojection, OpenGL", "of it drawing, CPU", "of it drawing, OpenGL")


def main() -> None:
    """Run it from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", action="append", help="scene and frame, NAME@FRAME")
    parser.add_argument("--records", type=int, default=128)
    parser.add_argument("--repeats", type=int, default=5)
    asked = parser.parse_args()
    print(" | ".join(("scene", "triangles", *COLUMNS, "drawing, CPU : sampling")))
    for text in asked.scene or SCENES:
        name, _, frame = text.partition("@")
        scene = load_scene(name)
        motion = motion_between(scene.world(int(frame)), scene.world(int(frame) + 1))
        found = costs(motion, asked.records, asked.repeats)
        share = found["of it drawing, CPU"] / found["sampling"]
        print(" | ".join((text, str(len(motion.before.triangles)), *(f"{found[c]:.3f}" for c in COLUMNS), f"{share:.1%}")))


def costs(motion: Motion, records: int, repeats: int) -> dict[str, float]:
    """CPU milliseconds a record."""
    sites = resting(motion, records)
    places, sampler = (
        np.arange(records),
        TemporalPlaneSampler(motion.before, SIDE, ReflectedDirectLight(motion.before), 0, Counter()),
    )
    later = ReflectedDirectLight(motion.after)
    ways = {name: PlaneReprojection(motion, sampler, later, draw_of(name)) for name in ("cpu", "gl")}
    parts = chunks(records, RAYS_PER_TASK // SIDE**2)
    clouds = [ways["cpu"].cloud(sampler.cast(sites.rows(part), places[part])[0])[0] for part in parts]
    points = np.concatenate([cloud.points[cloud.moves.any(axis=1)] for cloud in clouds])
    spent = medians(
        {
            "sampling": lambda: sampler.sample(sites, places),
            "recasting": lambda: sampler.sample(sites, places, RayCast(motion, sampler, later)),
            "reprojection, CPU": lambda: sampler.sample(sites, places, ways["cpu"]),
            "reprojection, OpenGL": lambda: sampler.sample(sites, places, ways["gl"]),
            "of it drawing, CPU": lambda: draw_of("cpu")(points, SIDE, HALF_WIDTH),
            "of it drawing, OpenGL": lambda: draw_of("gl")(points, SIDE, HALF_WIDTH),
        },
        repeats,
    )
    for name in COLUMNS[1:4]:
        spent[name] -= spent["sampling"]
    return {name: 1e3 * seconds / records for name, seconds in spent.items()}


def resting(motion: Motion, count: int) -> Sites:
    """Random visible places on surfaces that don't move, or, where all do, on any."""
    gbuffer = cast_gbuffer(motion.before, (64, 48))
    covered = gbuffer.covered.ravel()
    rests = np.flatnonzero(covered & ~motion.moved[gbuffer.triangle.ravel()])
    rows = np.random.default_rng(0).choice(rests if len(rests) else np.flatnonzero(covered), count)
    return Sites(*receivers_of(motion.before, gbuffer, rows))


def medians(works: dict[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """Median CPU seconds of each, taking turns, after one round that isn't counted."""
    spent: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(repeats + 1):
        for name, work in works.items():
            start = time.process_time()
            work()
            spent[name].append(time.process_time() - start)
    return {name: float(np.median(values[1:])) for name, values in spent.items()}


if __name__ == "__main__":
    main()
