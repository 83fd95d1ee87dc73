"""The Cornell box with a glossy back wall of Gautron 2006, section 4.8: records of both kinds, their cost and their error."""

from __future__ import annotations

from typing import Any

import numpy as np

from jobs.claims.bench import Bench, render_seconds
from jobs.claims.model import Measurement, PublishedClaim, held, row
from jobs.claims.registry import register

SCENE, SIZE, SEEDS = "cornell-glossy", (256, 256), 3
ACCURACY, ORDER, RAYS = 0.25, 10, 4096
PUBLISHED_IRRADIANCE, PUBLISHED_RADIANCE, PUBLISHED_SECONDS = 3023, 869, 12.18
SPLAT_SHARE = 100 * (0.06591 + 0.9355) / PUBLISHED_SECONDS
SETTINGS: dict[str, Any] = {
    "a": ACCURACY, "glossy_a": ACCURACY, "harmonics": ORDER, "rays": RAYS, "glossy_rays": RAYS, "glossy_pixels": 1,
    "placement": "bounded",
}  # fmt: skip
REFERENCE_NOISE, REFERENCE_SECONDS = 0.01, 150.0


def measure(bench: Bench) -> Measurement:
    """Records, seconds, and the error of the indirect light of the glossy wall, beside that of a diffuse one in its place."""
    from renderers.scene.world import LAMBERT
    from renderers.transport.primary import cast_gbuffer

    scene = bench.open(SCENE)
    found = bench.reference(scene, "one-bounce", size=SIZE, noise=REFERENCE_NOISE, max_seconds=REFERENCE_SECONDS)
    direct = bench.render(scene, "rcs", size=SIZE, rays=16, a=1.0, glossy="diffuse", light_samples=256).layers["direct"]
    truth, world = found.image.astype(np.float64) - direct, scene.scene.world()
    gbuffer = cast_gbuffer(world, SIZE)
    wall = gbuffer.covered & (world.materials.kind[gbuffer.material] != LAMBERT)
    noise = float(np.mean(np.asarray(found.variance, np.float64)[wall]))

    def error(indirect: Any) -> float:
        return float(np.sqrt(max(np.mean((indirect - truth)[wall] ** 2) - noise, 0.0)) / truth[wall].mean())

    names = ("irradiance", "radiance", "seconds", "splat", "error", "diffuse")
    values: dict[str, list[float]] = {name: [] for name in names}
    for seed in range(SEEDS):
        frame = bench.render(scene, "rcs", size=SIZE, seed=seed, **SETTINGS)
        spent = {t.name: t.cpu_s for t in frame.timings if t.stage == "render"}
        glossy = frame.counters["radiance_records"]
        values["irradiance"].append(frame.counters["records"] - glossy)
        values["radiance"].append(glossy)
        values["seconds"].append(render_seconds(frame, cpu=True))
        values["splat"].append(100 * (spent["glossy splat"] + spent.get("splat", 0.0)) / sum(spent.values()))
        values["error"].append(error(frame.layers["indirect"]))
        stand_in = bench.render(scene, "rcs", size=SIZE, seed=seed, **(SETTINGS | {"glossy": "diffuse"}))
        values["diffuse"].append(error(stand_in.layers["indirect"]))
    rows = [
        row("irradiance_records", "records of irradiance", "1", PUBLISHED_IRRADIANCE, values["irradiance"], comparable=False),
        row("radiance_records", "records of radiance", "1", PUBLISHED_RADIANCE, values["radiance"], comparable=False),
        row("seconds", "CPU time of the picture", "s", PUBLISHED_SECONDS, values["seconds"], "lower", comparable=False),
        row("splat_share", "share of splatting in it", "%", SPLAT_SHARE, values["splat"], "lower", comparable=False),
        row("error", "RMSE over mean of the glossy wall's indirect light", "1", None, values["error"], "lower"),
        row("error_as_diffuse", "the same where the wall counts as a diffuse one", "1", None, values["diffuse"], "lower"),
        held("better_than_diffuse", "radiance records are nearer to the truth than a diffuse wall",
             [a < b for a, b in zip(values["error"], values["diffuse"], strict=True)], comparable=False),
        held("fewer_radiance_records", "fewer records of radiance than of irradiance",
             [a < b for a, b in zip(values["radiance"], values["irradiance"], strict=True)]),
    ]  # fmt: skip
    notes = [
        f"{SIZE[0]}x{SIZE[1]} instead of 1000x1000, exponent and box as near to the publication as it prints them; {SETTINGS}; "
        f"only the order of the two numbers of records is compared: the published ones belong to another camera and image size",
        "errors have the reference's own noise subtracted; splats made while records are placed count as placement",
    ]
    return Measurement(f"{SCENE} (built-in)", rows, notes)


register(PublishedClaim("rcs-cornell-glossy", "The Cornell box with a glossy back wall", "Gautron 2006 section 4.8", measure))
