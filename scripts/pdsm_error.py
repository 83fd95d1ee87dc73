"""Penumbra deep shadow maps: error over samples, resolution and compression, and which approximation it comes from.

Run: `LUXMETER_SCENES=folder PYTHONPATH=. python scripts/pdsm_error.py [scene …]`. Prints Markdown tables; a minute or two a scene
on two cores. For the brightest area light of each scene, at every pixel that it lights: the hidden share of the whole light, then
that of its part before the receiver's plane (the shadow term of the picture), against shadow rays to 1,024 points of the light; and
the whole image against Mitsuba's direct light. One line adds one approximation to that above it:

    rays      shadow rays to N light points              light sampling
    maps      N shadow maps read at the point itself     map resolution and bias
    rays of the pyramid, uncompressed                    projection centre
    compressed                                           compression
    as rendered                                          shadow rays where part of the light is behind the plane
"""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from skimage.metrics import structural_similarity

import renderers
from jobs.scenes import open_scene
from renderers.gbuffer import GBuffer
from renderers.scene.model import Scene
from renderers.scene.world import World
from renderers.transport.direct import Receivers, direct, receivers_of
from renderers.transport.penumbra.assemble import Construction, recompressed
from renderers.transport.penumbra.build import LightShadows, Slope, build
from renderers.transport.penumbra.emitters import Emitter, Pattern, emitters_of
from renderers.transport.penumbra.filtered import FilteredMaps, averaged
from renderers.transport.penumbra.shading import before_plane, cast_before, count_behind, shaded, shining
from renderers.transport.primary import cast_gbuffer

SCENES = ("leaves", "armadillo", "spot", "cornell-box:light=area", "rectangle-light", "jungle")
SIZE = (96, 72)
BIAS = 2.5e-4
TRUTH_POINTS = 1024
PATTERN: Pattern = "hammersley"
# of the light without shadows; both decide which pixels it reaches
LIGHT_SAMPLES, SEED = 256, 1
F64 = NDArray[np.float64]


class Case(NamedTuple):
    """One scene's lit pixels, and the share of its brightest lamp hidden there: of the whole, and of what is before the plane."""

    scene: Scene
    world: World
    gbuffer: GBuffer
    lamp: Emitter
    rows: NDArray[np.intp]
    at: Receivers
    whole: F64
    truth: F64


def case_of(name: str) -> Case:
    """Open a scene and cast its truth."""
    scene = open_scene(name).scene
    world = scene.world()
    gbuffer = cast_gbuffer(world, SIZE)
    lamp = emitters_of(world)[0]
    free = direct(shining(world, lamp.triangles), gbuffer, LIGHT_SAMPLES, SEED, "none").reshape(-1, 3)
    rows = np.flatnonzero(free.any(axis=1))
    at = receivers_of(world, gbuffer, rows)
    away = np.einsum("ij,ij->i", at.geometric, at.normal) < 0
    at = at._replace(geometric=np.where(away[:, None], -at.geometric, at.geometric))
    points = lamp.points(TRUTH_POINTS, 99)
    truth = cast_before(world, lamp, points, at, Counter())
    return Case(scene, world, gbuffer, lamp, rows, at, with_behind(truth, at, points), truth)


def with_behind(before: F64, at: Receivers, points: F64) -> F64:
    """Hidden share of the whole light: what is behind the receiver's plane is hidden by its surface."""
    behind = np.zeros(len(before))
    count_behind(at.position, at.normal, points, points.mean(axis=0), behind)
    return behind + (1 - behind) * before


def covered(case: Case, points: F64, hidden: NDArray[np.floating]) -> F64:
    """V, ray cast where maps don't reach."""
    v = np.array(hidden, np.float64)
    missing = np.flatnonzero(v < 0)
    there = Receivers(*(column[missing] for column in case.at))
    v[missing] = with_behind(cast_before(case.world, case.lamp, points, there, Counter()), there, points)
    return v


def figures(case: Case, points: F64, v: F64, horizon: Literal["rays", "share"] = "share") -> str:
    """RMSE, pixels over 2 %, mean error and SSIM of V of the whole light; then RMSE, over 2 % and SSIM of that before the plane."""
    counters = Counter[str]()
    before = before_plane(case.world, case.lamp, points, case.at, v, horizon, counters)
    if horizon == "rays":
        v = with_behind(before, case.at, points)
    cells = []
    for found, truth in ((v, case.whole), (before, case.truth)):
        error = found - truth
        cells.append(f"{np.sqrt((error**2).mean()):.4f} | {(np.abs(error) > 0.02).mean():.1%} | {ssim(case, truth, found):.4f}")
    cast = f"{counters['points_at_horizon'] / len(v):.1%}"
    return " | ".join([*cells, cast])


def ssim(case: Case, truth: F64, v: F64) -> float:
    """SSIM of pictures of V, data range 1, over the pixels that the lamp lights."""
    images = []
    for values in (truth, v):
        image = np.zeros(case.gbuffer.triangle.size)
        image[case.rows] = values
        images.append(image.reshape(case.gbuffer.triangle.shape))
    _, local = structural_similarity(
        *images, data_range=1.0, gaussian_weights=True, sigma=1.5, use_sample_covariance=False, full=True
    )
    return float(local.ravel()[case.rows].mean())


def causes(case: Case, name: str, samples: int, resolution: int) -> LightShadows:
    """Print the chain of approximations at one setting; returns the uncompressed structure."""
    points = case.lamp.points(samples, 0, pattern=PATTERN)
    rays = with_behind(cast_before(case.world, case.lamp, points, case.at, Counter()), case.at, points)
    print(f"| {name} | rays, N {samples} | {figures(case, points, rays)} |")
    maps = FilteredMaps(case.world, case.lamp, points, points, resolution, 1.0, Counter())
    tests = maps.hidden(case.at.position, case.at.geometric, averaged(BIAS))
    print(f"| | + maps {resolution}² | {figures(case, points, covered(case, points, tests))} |")
    made = built(case, samples, resolution)
    plain = covered(case, points, made.hidden(case.at.position))
    print(f"| | + pyramid {resolution}² | {figures(case, points, plain)} |", flush=True)
    small = covered(case, points, compressed(made, 0.02).hidden(case.at.position))
    print(f"| | + compression 2 % | {figures(case, points, small)} |")
    print(f"| | as rendered | {figures(case, points, small, 'rays')} |", flush=True)
    return made


def built(case: Case, samples: int, resolution: int) -> LightShadows:
    """The uncompressed structure."""
    how = Construction(bias=BIAS, compression="none")
    points = case.lamp.points(samples, 0, pattern=PATTERN)
    return build(case.world, case.lamp, points, resolution=resolution, map_resolution=resolution, how=how, slope=Slope())


def compressed(made: LightShadows, epsilon: float) -> LightShadows:
    """The same with a tolerance."""
    how = Construction(bias=BIAS, epsilon=epsilon)
    return replace(made, maps=tuple(recompressed(one, how) for one in made.maps))


def grid(
    case: Case, name: str, samples: tuple[int, ...], resolutions: tuple[int, ...], known: dict[tuple[int, int], LightShadows]
) -> None:
    """Print error over samples, resolution and tolerance."""
    for n, r in [(n, r) for n in samples for r in resolutions]:
        points = case.lamp.points(n, 0, pattern=PATTERN)
        made = known.get((n, r)) or built(case, n, r)
        cells = []
        for epsilon in (0.0, 0.02, 0.05):
            used = compressed(made, epsilon) if epsilon else made
            v = covered(case, points, used.hidden(case.at.position))
            error = before_plane(case.world, case.lamp, points, case.at, v, "rays", Counter()) - case.truth
            cells.append(f"{np.sqrt((error**2).mean()):.4f} / {(np.abs(error) > 0.02).mean():.1%}")
        print(f"| {name} | {n} | {r} | {' | '.join(cells)} |", flush=True)


def against_mitsuba(case: Case, name: str, made: LightShadows) -> None:
    """Print metrics of the whole picture: pdsm, and the same with the true V, against Mitsuba's direct light."""
    from renderers import reference
    from reports.metrics import Pair
    from reports.registry import METRICS

    truth = reference.render(case.scene, "direct", size=SIZE, noise=0.004, max_seconds=20)
    exposure = reference.exposure(truth)
    lamps = emitters_of(case.world)
    points = case.lamp.points(256, 0, pattern=PATTERN)
    found = covered(case, points, made.hidden(case.at.position))
    ours = before_plane(case.world, case.lamp, points, case.at, found, "rays", Counter())
    for label, values in (("true V", case.truth), ("pdsm", ours)):
        image = shaded(
            case.world, case.gbuffer, [case.lamp], [case.lamp.points(64, 0)], lambda k, p, n, v=values: v.astype(np.float32),
            LIGHT_SAMPLES, SEED, Counter(), horizon="ignored",
        )  # fmt: skip
        pair = Pair(image, truth.image, exposure)
        metric = {m: METRICS[m].function(pair) for m in ("rmse", "ssim", "over_2pct")}  # type: ignore[misc]
        rest = "" if len(lamps) == 1 else f", {len(lamps) - 1} other area lights ray cast"
        row = f"{metric['rmse']:.2f} | {metric['ssim']:.4f} | {metric['over_2pct']:.1%} | {truth.noise:.4f}"
        print(f"| {name} | {label}{rest} | {row} |", flush=True)


def asked(case: Case, name: str) -> LightShadows:
    """Print the error of what is asked of the method: 256 light points, 512², 2 %; returns the structure."""
    points = case.lamp.points(256, 0, pattern=PATTERN)
    small = compressed(built(case, 256, 512), 0.02)
    found = covered(case, points, small.hidden(case.at.position))
    for horizon in ("share", "rays"):
        row = figures(case, points, found, horizon)
        print(f"| {name} | N 256, 512², 2 %, {horizon} | {row} |", flush=True)
    return small


def main() -> None:
    """Four tables for each scene."""
    renderers.registered_methods()
    for name in sys.argv[1:] or SCENES:
        case = case_of(name)
        print(f"\n{name}: {case.lamp.kind}, {len(case.rows)} pixels\n", flush=True)
        known = {(64, 256): causes(case, name, 64, 256)}
        grid(case, name, (16, 64), (128, 256), known)
        against_mitsuba(case, name, asked(case, name))


if __name__ == "__main__":
    main()
