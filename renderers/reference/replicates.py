"""Render references: replicates of `spp` samples a pixel, seed = replicate number, added until the asked noise or a stated cap."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from renderers.images import luminance
from renderers.method import TRANSPORTS, Transport
from renderers.reference import store as folder
from renderers.reference.image import PixelMode, Reference
from renderers.scene.model import Scene
from renderers.scene.world import World

# Fewest replicates by samples a replicate. Means of 64 path-traced samples are skewed: on the Cornell box, 95 % intervals of 16
# replicates held in 92 % of the pixels, of 48 in 94 %; 16 replicates of 256 samples held in 95 %.
LEAST_REPLICATES = {64: 48, 256: 16}
MOST_REPLICATES = 4096
SAVE_SECONDS = 30.0
Progress = Callable[[int, float, float], None]
Draw = Callable[[int], NDArray[np.float64]]


def render(
    scene: Scene,
    transport: Transport,
    size: tuple[int, int] = (320, 180),
    noise: float = 0.004,
    pixel: PixelMode = "centre",
    frame: int = 0,
    store: Path | str | None = None,
    max_seconds: float | None = None,
    max_replicates: int = MOST_REPLICATES,
    progress: Progress | None = None,
    *,
    spp: Literal[64, 256] = 64,
    radius: float | None = None,
) -> Reference:
    """Path-traced mean of one (scene, frame, size, transport) with its variance.

    size is (width, height). noise: wanted `Reference.noise` (relative, > 0). pixel: "centre" starts every path at the pixel centre,
    "box" spreads them over the pixel. store: folder of references; a stored one is returned if its noise suffices and otherwise
    continued, bit-equal to one long run. max_seconds, max_replicates: caps; one that stops the rendering is named in
    `Reference.notes`. At least LEAST_REPLICATES are rendered unless a cap forbids (never fewer than 2).
    progress(replicates, noise, estimated seconds to go) is called after every replicate. spp: samples a pixel and replicate.
    radius: reach of ambient occlusion in metres, None = infinite.

    Raises ValueError for arguments out of range, ReferenceUnavailable when Mitsuba can't run here, FloatingPointError for a path
    that is not finite.
    """
    _check(transport, size, noise, pixel, max_replicates, spp, radius)
    world = scene.world(frame)
    frame = frame if scene.channels else 0
    parts = folder.identity(scene.hash, frame, size, transport, pixel, spp, radius)
    where = None if store is None else Path(store)
    known = None if where is None else folder.load(where, parts)
    if known is not None and known.n >= LEAST_REPLICATES[spp] and known.noise <= noise:
        return _noted(known, transport)
    reference = _continued(world, parts, known, noise, max_seconds, max_replicates, progress, where, radius)
    if where is not None:
        folder.save(where, parts, reference)
    return _noted(reference, transport)


def _check(
    transport: str, size: tuple[int, int], noise: float, pixel: str, max_replicates: int, spp: int, radius: float | None
) -> None:
    if transport not in TRANSPORTS:
        raise ValueError(f"unknown transport {transport!r}; known: {', '.join(TRANSPORTS)}")
    if not all(1 <= n <= 8192 for n in size):
        raise ValueError(f"size must lie in 1..8192 pixels, got {size[0]}x{size[1]}")
    if not 0 < noise < np.inf:
        raise ValueError(f"noise must be a positive number, got {noise}")
    if pixel not in ("centre", "box"):
        raise ValueError(f"pixel must be 'centre' or 'box', got {pixel!r}")
    if not 2 <= max_replicates <= 1 << 16:
        raise ValueError(f"max_replicates must lie in 2..65536, got {max_replicates}")
    if spp not in LEAST_REPLICATES:
        raise ValueError(f"spp must be 64 or 256, got {spp}")
    if radius is not None and (transport != "ambient-occlusion" or not 0 < radius < np.inf):
        raise ValueError("radius is a positive number of metres and belongs to ambient-occlusion")


def _continued(
    world: World, parts: dict[str, str], known: Reference | None, noise: float, max_seconds: float | None,
    max_replicates: int, progress: Progress | None, where: Path | None, radius: float | None,
) -> Reference:  # fmt: skip
    """Add replicates to `known`, or to nothing, until noise or cap."""
    started = saved = time.monotonic()
    draw, reference = _prepared(world, parts, radius)
    reference = reference if known is None else known
    before = reference.n
    while True:
        elapsed = time.monotonic() - started
        if reference.n >= 2:
            if progress is not None and reference.n > before:
                progress(reference.n, reference.noise, _to_go(reference, noise, elapsed / (reference.n - before)))
            if reference.n >= LEAST_REPLICATES[reference.spp] and reference.noise <= noise:
                return reference
            cap = _cap(reference.n, elapsed, max_seconds, max_replicates)
            if cap is not None:
                return replace(reference, notes=(f"stopped at {cap} with noise {reference.noise:.4g}, asked {noise:g}",))
        reference = _with_replicate(reference, draw(reference.n))
        if where is not None and time.monotonic() - saved > SAVE_SECONDS and reference.n >= 2:
            folder.save(where, parts, reference)
            saved = time.monotonic()


def _prepared(world: World, parts: dict[str, str], radius: float | None) -> tuple[Draw, Reference]:
    """What draws the mean image of a replicate, and a Reference of none. Mitsuba isn't asked where the answer is black."""
    width, height = (int(n) for n in parts["size"].split("x"))
    transport: Transport = parts["transport"]  # type: ignore[assignment]
    black = np.zeros((height, width, 3))
    draw, surface = _black(black)
    if is_lit(world, transport):
        draw, surface = _traced(world, transport, (width, height), int(parts["spp"]), parts["pixel"] == "centre", radius)
    return draw, Reference(
        total=black, squares=black, squares_y=black[..., 0], alternating=black, surface=surface, n=0, spp=int(parts["spp"]),
        scene_hash=parts["scene"], transport=transport, pixel=parts["pixel"], frame=int(parts["frame"]),  # type: ignore[arg-type]
    )  # fmt: skip


def _black(image: NDArray[np.float64]) -> tuple[Draw, NDArray[np.bool_]]:
    return (lambda replicate: image), np.zeros(image.shape[:2], bool)


def _traced(
    world: World, transport: Transport, size: tuple[int, int], spp: int, centre: bool, radius: float | None
) -> tuple[Draw, NDArray[np.bool_]]:
    from renderers.reference.export import mitsuba_scene
    from renderers.reference.sampling import CENTRE, mean_image, reference_stream
    from renderers.reference.transports import estimator
    from renderers.reference.visible import hits_of

    scene = mitsuba_scene(world, size, clay=transport == "ambient-occlusion")
    estimate = estimator(transport, scene, None if radius is None else radius * world.scale)
    hits = hits_of(scene, size)

    def draw(replicate: int) -> NDArray[np.float64]:
        return mean_image(scene, estimate, size, spp, reference_stream(replicate), CENTRE if centre else None)

    return draw, hits["coverage"] & ~hits["emitter"]


def is_lit(world: World, transport: Transport) -> bool:
    """Whether an image of this transport can show anything at all."""
    if transport == "ambient-occlusion":
        return True
    lights = any(np.any(light.intensity > 0) for light in world.lights)
    sky = world.environment is not None and any(world.environment.radiance)
    return lights or sky or bool(len(world.emissive))


def _with_replicate(reference: Reference, mean: NDArray[np.float64]) -> Reference:
    return replace(
        reference,
        total=reference.total + mean,
        squares=reference.squares + mean**2,
        squares_y=reference.squares_y + luminance(mean) ** 2,
        alternating=None if reference.alternating is None else reference.alternating + (-1) ** reference.n * mean,
        n=reference.n + 1,
        notes=(),
    )


def _to_go(reference: Reference, noise: float, seconds_each: float) -> float:
    """Seconds until `noise` at the present speed: variance falls with the number of replicates."""
    wanted = max(reference.n * (reference.noise / noise) ** 2, LEAST_REPLICATES[reference.spp])
    return max(0.0, wanted - reference.n) * seconds_each


def _cap(n: int, elapsed: float, max_seconds: float | None, max_replicates: int) -> str | None:
    if n >= max_replicates:
        return f"{n} replicates"
    if max_seconds is not None and elapsed >= max_seconds:
        return f"{max_seconds:g} s"
    return None


def _noted(reference: Reference, transport: Transport) -> Reference:
    """Say why an image is black."""
    if reference.total.any():
        return reference
    if transport == "ambient-occlusion" and reference.surface.any():
        return replace(reference, notes=(*reference.notes, "no point sees the sky: ambient occlusion of a closed scene is 0"))
    return replace(reference, notes=(*reference.notes, "nothing that shines reaches the camera: the image is black"))
