"""Penumbra deep shadow maps: construction, memory, lookups, and error at equal time.

Run on an idle machine: `LUXMETER_SCENES=folder python -m benchmarks.pdsm [PART …]`; parts are build, size,
memory, threads, lookup, equal-time. Construction and lookups are of a scanned model under a square light (a procedural knot without
the folder), on a ground that receives only. Prints medians or single runs.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from collections.abc import Callable

import numpy as np

import renderers
from benchmarks.shared.clock import measured
from jobs.claims.bench import Bench
from jobs.claims.pdsm_stage import Stage, bytes_of_steps, peak_bytes, scanned_model, stage_of
from renderers.images import luminance
from renderers.transport.penumbra.build import LightShadows
from renderers.transport.penumbra.shading import cast_hidden
from renderers.transport.primary import cast_gbuffer

MIB = 2.0**20
CASES = ((64, 256, 256), (64, 512, 512), (256, 256, 512), (256, 512, 512))


def construction(stage: Stage) -> None:
    """Seconds over samples and resolution, at 2 %."""
    stage.build(4, 64, 64)
    for samples, resolution, maps in CASES:
        tally = Counter[str]()
        wall, cpu = measured(lambda n=samples, r=resolution, m=maps, t=tally: stage.build(n, r, m, t), 1)  # type: ignore[misc]
        rate = tally["texels_walked"] / cpu / 1e6
        print(f"build N {samples:3d}, {resolution}² pixels, {maps}² texels: {wall:.2f} s wall {cpu:.2f} s CPU", end=" ")
        print(f"{rate:.0f} Mtexels/CPU-s", flush=True)


def compression(stage: Stage) -> None:
    """Sizes of the default case."""
    plain = bytes_of_steps(stage.build(256, 512, 512, compression="none"))
    print(f"uncompressed {plain / MIB:.1f} MiB", flush=True)
    for metric in ("vertical", "perpendicular"):
        for epsilon in (0.02, 0.05, 0.1):
            small = stage.build(256, 512, 512, compression=metric, epsilon=epsilon).bytes
            print(f"{metric} {epsilon:.0%}: {small / MIB:.2f} MiB, {plain / small:.1f} times smaller", flush=True)


def memory(stage: Stage) -> None:
    """Peak resident memory over the user's bound, the result included, and what a tight bound costs."""
    stage.build(64, 512, 512)
    for samples, across, bounds in ((64, 512, (64, 128, 1024)), (256, 512, (64, 128, 1024)), (256, 256, (24, 48, 64))):
        for bound in bounds:
            kept: list[tuple[int, float]] = []
            tally = Counter[str]()

            def work(
                n: int = samples, r: int = across, b: int = bound, k: list[tuple[int, float]] = kept, t: Counter[str] = tally
            ) -> None:
                start = time.process_time()
                size = stage.build(n, r, r, t, memory=b << 20).bytes
                k.append((size, time.process_time() - start))

            peak = peak_bytes(work)
            size, cpu = kept[0]
            print(
                f"{samples} maps of {across}², bound {bound} MiB: peak {peak / MIB:.0f} MiB, result {size / MIB:.1f} MiB,", end=" "
            )
            print(f"{tally['shadow_maps']} maps drawn, {cpu:.1f} s CPU", flush=True)


def threads(stage: Stage) -> None:
    """Construction on one and on two threads (A28: at least 1.5 times as fast on two idle cores)."""
    import numba

    most, walls = numba.get_num_threads(), {}
    stage.build(4, 64, 64)
    try:
        for count in (1, min(2, most)):
            numba.set_num_threads(count)
            wall, cpu = measured(lambda: stage.build(64, 512, 512), 3)
            walls[count] = wall
            print(f"{count} threads: {wall:.2f} s wall {cpu:.2f} s CPU, {walls[1] / wall:.2f} times as fast as one", flush=True)
    finally:
        numba.set_num_threads(most)


def lookups(stage: Stage) -> None:
    """A picture of 1280×720 from functions, and from shadow rays to the same 256 light points (every 16th pixel, scaled)."""
    made = LightShadows(stage.lamp, (stage.build(256, 512, 512),))
    gbuffer = cast_gbuffer(stage.world, (1280, 720))
    rows = np.flatnonzero(gbuffer.covered)
    where = gbuffer.position.reshape(-1, 3)[rows].astype(np.float64)
    normals = stage.world.face_normals[gbuffer.triangle.ravel()[rows]]
    made.hidden(where[:10])
    ours = {name: measured(lambda f=name: made.hidden(where, filter=f), 5) for name in ("nearest", "bilinear")}  # type: ignore[misc]
    few, points = slice(None, None, 16), stage.lamp.points(256, 0)
    rays = measured(lambda: cast_hidden(stage.world, stage.lamp, points, where[few], normals[few], Counter()), 1)
    for name, (wall, cpu) in ours.items():
        ratio = 16 * rays[1] / cpu
        print(f"lookup {name}: {len(where)} points {wall * 1e3:.0f} ms wall {cpu * 1e3:.0f} ms CPU", end="; ")
        print(f"rays to 256 points: {ratio:.0f} times the CPU seconds", flush=True)


def equal_time(name: str, size: tuple[int, int] = (160, 112)) -> None:
    """Preparation, seconds a frame and error against Mitsuba's direct light, of pdsm and its peers."""
    from renderers import reference

    scene = renderers.load_scene(name)
    truth = reference.render(scene, "direct", size=size, noise=0.004, max_seconds=60)
    white = float(np.percentile(luminance(truth.image), 99))
    cases: list[tuple[str, dict[str, object]]] = [
        ("pdsm", {"samples": n, "resolution": 256, "map_resolution": 256}) for n in (16, 64, 256)
    ]
    cases += [("averaged-shadow-maps", {"samples": n}) for n in (16, 64, 256)]
    cases += [("ray-cast-area-light", {"samples": n}) for n in (16, 64, 256)]
    cases += [("pcss", {}), ("moment-shadow-map", {}), ("shadow-map", {}), ("layered-attenuation-map", {"map_resolution": 512})]
    cases += [("pt", {"spp": n, "transport": "direct"}) for n in (1, 4, 16, 64)]
    for method_name, settings in cases:
        method = renderers.get_method(method_name)
        extra = {} if method_name == "pt" else {"light_samples": 16}
        frame = method.render(scene, method.Settings(**settings, **extra), size=size)
        error = luminance(frame.layers["direct"] if method_name != "pt" else frame.layers["beauty"]) - luminance(truth.image)
        prepare = sum(t.cpu_s for t in frame.timings if t.stage == "prepare" and t.name != "warm-up")
        render = sum(t.cpu_s for t in frame.timings if t.stage == "render")
        rmse = float(np.sqrt((error**2).mean())) / white
        print(
            f"{name} {method_name} {settings}: {prepare:.2f} s once, {render:.2f} s a frame (CPU), RMSE {rmse:.2%} of white",
            flush=True,
        )


PARTS: dict[str, Callable[[Stage], None]] = {
    "build": construction, "size": compression, "memory": memory, "threads": threads, "lookup": lookups,
    "equal-time": lambda stage: equal_time("leaves"),
}  # fmt: skip


def main() -> None:
    """Every part, or those named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", nargs="*", help=", ".join(PARTS))
    asked = parser.parse_args().part or list(PARTS)
    if unknown := set(asked) - set(PARTS):
        parser.error(f"no such part: {', '.join(sorted(unknown))}; there are {', '.join(PARTS)}")
    stage = stage_of(scanned_model(Bench(lambda line: None)))
    print(stage.name)
    for name in asked:
        PARTS[name](stage)


if __name__ == "__main__":
    main()
