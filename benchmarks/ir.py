"""Instant radiosity: pixel-lights per CPU-second of the gather, and rays per CPU-second of its occluded form.

Run on an idle machine: `python -m benchmarks.ir`. Prints the median of five repeats; wall seconds depend on the cores, so compare
the figures per CPU-second.
"""

from __future__ import annotations

from collections import Counter

import numpy as np

import renderers
from benchmarks.shared.clock import measured
from renderers.gbuffer import GBuffer
from renderers.transport.gather import gather, warm_up
from renderers.transport.primary import cast_gbuffer
from renderers.transport.raycast import caster_of
from renderers.transport.vpl import emit_vpls


def filled(gbuffer: GBuffer) -> GBuffer:
    """The same pixels with background ones replaced by covered ones: every pixel does full work."""
    source = np.flatnonzero(gbuffer.covered)
    rows = np.resize(source, gbuffer.triangle.size)

    def spread(image: np.ndarray) -> np.ndarray:
        flat = image.reshape(gbuffer.triangle.size, *image.shape[2:])
        return flat[rows].reshape(image.shape)

    return GBuffer(
        spread(gbuffer.position), spread(gbuffer.normal), spread(gbuffer.base), spread(gbuffer.emission),
        spread(gbuffer.triangle), spread(gbuffer.material), gbuffer.eye,
    )  # fmt: skip


def main() -> None:
    """Print one line a case."""
    for scene, size, lights, occluded in (
        ("cornell-box", (1024, 1024), 1024, False),
        ("cornell-glossy", (256, 256), 1024, False),
        ("cornell-box", (256, 256), 256, True),
    ):
        world = renderers.load_scene(scene).world()
        pixels = filled(cast_gbuffer(world, size))
        vpls = emit_vpls(world, 4 * lights)
        arrays = [a[:lights] for a in (vpls.positions, vpls.normals, vpls.intensities)]
        caster = caster_of(world) if occluded else None
        warm_up(occluded, True)
        counters = Counter[str]()
        gather(pixels, world, *arrays, 1e-4, caster, counters)
        wall, cpu = measured(lambda a=arrays, p=pixels, w=world, c=caster: gather(p, w, *a, 1e-4, c), 5)  # type: ignore[misc]
        pairs = counters["light_evaluations"]
        print(
            f"{scene} {size[0]}x{size[1]} x {len(arrays[0])} lights{', occluded' if occluded else ''}: "
            f"{pairs / cpu / 1e6:.0f} M pixel-lights per CPU-second, {pairs / wall / 1e6:.0f} M per second, "
            f"{counters['rays'] / cpu / 1e6:.1f} M rays per CPU-second"
        )


if __name__ == "__main__":
    main()
