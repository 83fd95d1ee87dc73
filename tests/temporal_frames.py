"""Small runs of temporal caching, and what tests ask of them. Needs the fixture `software_device`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from renderers import Frame
from renderers.methods.trc import TemporalRadianceCaching, TrcSettings
from renderers.scene.model import Scene
from renderers.scene.world import World
from renderers.transport.caching.hemisphere import grid_of
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.records import Records, Sites
from renderers.transport.temporal.cache import Stage, TemporalCache, View
from renderers.transport.temporal.records import Timed
from renderers.transport.temporal.sampling import Ahead, TemporalSampler

F64 = NDArray[np.float64]
METHOD = TemporalRadianceCaching()
SIZE = (24, 24)
COARSE = {"rays": 128, "a": 0.4, "glossy_rays": 256, "glossy_a": 0.4, "lobe_rays": 8}
MODES = pytest.mark.parametrize("mode", ["none", "extrapolated", "interpolated"])


def frames_of(scene: Scene, count: int, first: int = 0, size: tuple[int, int] = SIZE, **settings: object) -> list[Frame]:
    """Frames first … first + count - 1, by few rays and few records."""
    chosen = TrcSettings(**{**COARSE, **settings})  # type: ignore[arg-type]
    return list(METHOD.render_frames(scene, chosen, size=size, frames=(first, first + count - 1)))


def total(frames: Sequence[Frame], counter: str) -> int:
    """A counter, over all frames."""
    return sum(frame.counters[counter] for frame in frames)


def bytes_of(frame: Frame) -> bytes:
    """Of its light."""
    return frame.layers["beauty"].tobytes() + frame.layers["indirect"].tobytes()


def assert_beginnings_agree(scene: Scene, count: int, first: int, cuts: Sequence[int], **settings: object) -> list[Frame]:
    """So many frames, which must have the bytes of shorter ranges that begin in the same frame."""
    whole = frames_of(scene, count, first, **settings)  # type: ignore[arg-type]
    for cut in cuts:
        part = frames_of(scene, cut, first, **settings)  # type: ignore[arg-type]
        assert [bytes_of(f) for f in part] == [bytes_of(f) for f in whole[:cut]]
    return whole


def assert_computed_once(scene: Scene) -> Frame:
    """A still scene: every record lives; those at the end of their lives are kept as they are. Returns the first frame."""
    frames = frames_of(scene, 4, delta_max=2)
    assert len({bytes_of(f) for f in frames}) == 1
    assert frames[0].counters["records_new"] > 0
    for frame in frames[1:]:
        assert frame.counters["records"] == 0
        assert frame.counters["records_renewed"] == frame.counters["records_kept"]
    return frames[0]


def assert_any_number_of_threads(scene: Scene) -> None:
    """The same bytes by one thread and by all of them."""
    threads, images = numba.get_num_threads(), []
    try:
        for count in (1, threads):
            numba.set_num_threads(count)
            images.append([bytes_of(f) for f in frames_of(scene, 3, delta_max=2)])
    finally:
        numba.set_num_threads(threads)
    assert images[0] == images[1]


def caches_of(
    monkeypatch: pytest.MonkeyPatch, scene: Scene, count: int, **settings: object
) -> list[tuple[Timed, Stage, list[View]]]:
    """What lives after each frame, and what the frame was computed with."""
    found: list[tuple[Timed, Stage, list[View]]] = []
    step = TemporalCache.step

    def watched(cache: TemporalCache, stage: Stage, views: list[View], counters: Counter[str]) -> Timed:
        renewed = step(cache, stage, views, counters)
        found.append((cache.live, stage, views))
        return renewed

    with monkeypatch.context() as patch:
        patch.setattr(TemporalCache, "step", watched)
        frames_of(scene, count, **settings)  # type: ignore[arg-type]
    return found


def polar(world: World, rays: int = 4096, sparse: int = 1, order: int | None = None) -> TemporalSampler:
    """Whole hemispheres of a World's direct light."""
    return TemporalSampler(world, grid_of(rays), ReflectedDirectLight(world), 0, Counter(), sparse, order)


def sampled(sampler: TemporalSampler, sites: Sites, ahead: Ahead | None = None) -> tuple[Records, Records]:
    """Records at sites numbered from 0, and what they will be, or are where nothing foresees."""
    return sampler.sample(sites, np.arange(len(sites.position)), ahead)
