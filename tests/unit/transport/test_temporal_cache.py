"""The cache in time by itself: which places are computed in which frame, foreseen, kept, deleted. Light is a formula."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, Self

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray
from temporal_toy import hold_places

from renderers.transport.caching.limits import Limits
from renderers.transport.caching.placement import Placement
from renderers.transport.caching.records import Records, Sites
from renderers.transport.caching.splat import Canvas
from renderers.transport.temporal.cache import Policy, Stage, TemporalCache, View
from renderers.transport.temporal.records import Timed

F64 = NDArray[np.float64]
A, RADIUS = 0.25, 4.0  # zones of radius 1
APART = np.array([[10.0 * k, 0.0] for k in range(5)])  # pixels that share no record
UP = np.array([[0.0, 0, 1]])


@dataclass
class Lab:
    """A floor under light that is the same everywhere. light: irradiance (3,) at a frame; slope (3,): translation gradient at a
    frame. live, counters: after each frame; asked: frames in which something was foreseen, with how many records."""

    light: Callable[[int], ArrayLike]
    policy: Policy
    slope: Callable[[int], ArrayLike] = lambda frame: np.zeros(3)
    limits: Limits = field(default_factory=lambda: Limits(RADIUS, RADIUS, gradient=False))
    live: list[Timed] = field(default_factory=list)
    counters: list[Counter[str]] = field(default_factory=list)
    asked: dict[int, int] = field(default_factory=dict)
    axes: list[Any] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.cache = TemporalCache(self.policy)

    def step(self, *views: ArrayLike, still: bool = False, changed: int | None = None) -> Timed:
        """One frame before so many views of floor points (P, 2)."""
        frame, counter = len(self.live), Counter[str]()

        def at(t: int, sites: Sites) -> Records:
            count = len(sites.position)
            irradiance = np.tile(np.asarray(self.light(t), np.float64), (count, 1))
            slopes = np.tile(np.asarray(self.slope(t), np.float64), (count, 3, 1))
            return Records(sites.position, sites.normal, np.full(count, 1.0), irradiance, slopes, 0 * slopes)

        def sample(sites: Sites, places: Any, ahead: Any, tangents: Any = None) -> tuple[Records, Records]:
            counter["records"] += len(places)
            self.axes.append(tangents)
            if ahead is None:
                return at(frame, sites), at(frame, sites)
            self.asked[frame] = self.asked.get(frame, 0) + len(places)
            return at(frame, sites), at(frame + 1, sites)

        sampler: Any = SimpleNamespace(sample=sample, distances=lambda sites: np.full(len(sites.position), RADIUS), world=None)
        ahead: Any = None if still else object()
        since = frame if changed is None else changed
        stage = Stage(frame, sampler, sampler, ahead, Placement(A, limits=self.limits), still, since)
        self.cache.step(stage, [view_of(points) for points in views], counter)
        self.live.append(self.cache.live)
        self.counters.append(counter)
        return self.cache.live

    def run(self, frames: int, points: ArrayLike = APART) -> Self:
        """So many frames before one view."""
        for _ in range(frames):
            self.step(points)
        return self

    def pixels(self, frame: int) -> list[int]:
        """Numbers of the pixels of APART that places lie at after a frame."""
        return sorted((self.live[frame].sites.position[:, 0] / 10).astype(int).tolist())

    @property
    def births(self) -> list[int]:
        """Frames in which all places were computed, which must be the same."""
        assert all((live.born == live.born[0]).all() for live in self.live)
        return sorted({int(live.born[0]) for live in self.live})


def view_of(points: ArrayLike) -> View:
    xy = np.asarray(points, np.float64).reshape(-1, 2)
    position, normal = np.column_stack([xy, np.zeros(len(xy))]), np.repeat(UP, len(xy), axis=0)
    return View(Canvas(np.arange(len(xy)), max(len(xy), 1), position, normal), Sites(position, normal, normal))


@pytest.fixture(autouse=True)
def _held(monkeypatch: pytest.MonkeyPatch) -> None:
    hold_places(monkeypatch)


def plain(**policy: Any) -> Policy:
    """Lives by the rate of change alone, guarded."""
    return Policy(**{"stagger": False, "follows": False, **policy})


@pytest.mark.parametrize(("longest", "every"), [(1, 1), (2, 2), (3, 3), (5, 5), (20, 5)])
def test_lives_end_at_the_longest_or_at_the_change_that_may_be(longest: int, every: int) -> None:
    """Light grows by 1.2 % a frame: ⌊0.05 / 0.012⌋ + 1 = 5 frames; nothing lives longer than δ_max, and where light
    is steady all do for so long."""
    growing = Lab(lambda t: np.full(3, 1.012**t), plain(longest=longest)).run(22)
    assert growing.births == list(range(0, 22, every))
    steady = Lab(lambda t: np.ones(3), plain(longest=longest)).run(22)
    assert steady.births == list(range(0, 22, longest))
    assert all((live.life == longest).all() for live in steady.live)


def test_first_lives_are_staggered_and_later_ones_aren_t() -> None:
    points = np.array([[10.0 * k, 0.0] for k in range(40)])
    lab = Lab(lambda t: np.ones(3), plain(longest=8, stagger=True)).run(9, points)
    assert sorted(set(lab.live[0].life.tolist())) == list(range(1, 9))
    late = lab.live[8]
    assert (late.life[late.born > 0] == 8).all()


def test_a_guarded_place_is_foreseen_after_1_3_7_and_15_frames_of_rest() -> None:
    """Light doubles and halves in turn: every life is one frame, every place is computed in every frame. A long
    life ends the rests."""
    wild = lambda t: np.full(3, 1.0 + (t % 2) * (t < 20))  # noqa: E731
    lab = Lab(wild, plain(longest=4)).run(42)
    assert list(lab.asked) == [0, 2, 6, 14, 30, 34, 38]
    assert set(lab.asked.values()) == {len(APART)}
    assert [c["records"] for c in lab.counters[:31]] == [len(APART)] * 31
    unguarded = Lab(wild, plain(longest=4, guard=False)).run(20)
    assert list(unguarded.asked) == list(range(20))


def test_new_places_rest_where_most_places_do() -> None:
    lab = Lab(lambda t: np.full(3, 1.0 + t % 2), plain(longest=4))
    for t in range(4):
        lab.step(APART[: 3 if t < 3 else 5])
    assert list(lab.asked) == [0, 2]
    assert lab.counters[3]["records_new"] == 2
    assert (lab.live[3].life == 1).all()


def test_h11_a_place_that_reaches_no_pixel_in_its_last_frame_is_deleted() -> None:
    """δ_max = 4: born in frame 0, it counts in its last frame, 3. Any view may need it. Here all places have a surface."""
    for gone, other, lives in ((1, False, False), (3, False, False), (4, False, True), (3, True, True)):
        lab = Lab(lambda t: np.ones(3), plain(longest=4))
        for t in range(5):
            lab.step(APART if t < gone else APART[:3], APART[3:] if other else APART[:1])
        assert lab.pixels(4) == [0, 1, 2, *([3, 4] if lives else [])]
        assert lab.counters[4]["records_deleted"] == (0 if lives else 2)
        assert all(len(live) == 5 for live in lab.live[:4])


def test_a_place_without_surface_is_deleted_although_pixels_lie_in_its_zone(monkeypatch: pytest.MonkeyPatch) -> None:
    lab = Lab(lambda t: np.ones(3), plain(longest=2)).run(2)
    hold_places(monkeypatch, lambda position: position[:, 0] < 25)
    lab.step(APART)
    assert lab.counters[2]["records_deleted"] == lab.counters[2]["records_new"] == 2
    renewed = lab.live[2].rows(lab.live[2].place < 5)
    assert sorted(renewed.sites.position[:, 0].tolist()) == [0, 10, 20]


def test_nothing_is_computed_where_nothing_changed_and_all_that_may_have() -> None:
    """Light changes between frames 5 and 6, which frame 5 foresees: records that end in it are computed, as are those that end
    later and were made before. Else they are kept."""
    lab = Lab(lambda t: np.full(3, 1.0 + (t > 5)), plain(longest=5, a_t=10.0))
    for t in range(12):
        lab.step(APART, still=t != 5, changed=0 if t <= 5 else 6)
    computed = {t for t, counter in enumerate(lab.counters) if counter["records"]}
    assert computed == {0, 5, 10}
    assert list(lab.asked) == [5]
    # those of frame 5 live until 9, and were made before the change
    np.testing.assert_array_equal(lab.live[11].records.irradiance, 2)
    kept = Lab(lambda t: np.ones(3), plain(longest=5))
    for _ in range(12):
        kept.step(APART, still=True, changed=0)
    assert [c["records_kept"] for c in kept.counters] == [5 * (t in (5, 10)) for t in range(12)]
    assert kept.births == [0, 5, 10]


def crowded(light: Callable[[int], ArrayLike], frames: int, **policy: Any) -> Lab:
    """Three pixels, none in the zone of another's record; from the second frame on one pixel that the zones of all three hold."""
    corners = 0.69 * np.array([[np.cos(k), np.sin(k)] for k in 2 * np.pi / 3 * np.arange(3)])
    lab = Lab(light, plain(**policy))
    for t in range(frames):
        lab.step(corners if t == 0 else np.zeros((1, 2)))
    assert len(lab.live[0]) == 3
    return lab


def test_a_place_whose_pixels_two_others_reach_ends_when_it_is_renewed() -> None:
    """It is computed once more, serves that frame alone, and is gone."""
    lab = crowded(lambda t: np.ones(3), 10, longest=4)
    assert [len(live) for live in lab.live] == [3] * 5 + [2] * 5
    assert lab.counters[4]["records"] == 3
    assert lab.live[4].life.tolist() == [4, 4, 1]
    assert [len(live) for live in crowded(lambda t: np.ones(3), 10, longest=4, guard=False).live] == [3] * 10


def test_where_all_rest_places_that_others_stand_in_for_are_given_up() -> None:
    flicker = lambda t: np.full(3, 1.0 + t % 2)  # noqa: E731
    lab = crowded(flicker, 6, longest=4)
    assert [len(live) for live in lab.live] == [3] + [1] * 5
    assert lab.counters[1]["records_deleted"] == 2
    assert [len(live) for live in crowded(flicker, 6, longest=4, guard=False).live] == [3] * 6


def test_lives_by_chords_double_under_light_that_changes_steadily() -> None:
    """Light grows by 0.03 a frame from 1: by its rate a record lives for 2 frames, or 3; a chord is exact, so that lives double up
    to δ_max. Under lives by the rate alone there is no doubling."""
    light = lambda t: np.full(3, 1 + 0.03 * t)  # noqa: E731
    assert Lab(light, plain(curved=True)).run(60).births == [0, 2, 6, 14, 30, 50]
    assert Lab(light, plain()).run(7).births == [0, 2, 4, 6]


def test_a_place_that_chords_make_live_longer_never_rests() -> None:
    """Light that grows by 0.08 a frame lets a record live for one frame by its rate. Places rest once, as nothing is known of the
    first; then chords double their lives, and each of their records is foreseen."""
    lab = Lab(lambda t: np.full(3, 1 + 0.08 * t), plain(curved=True)).run(40)
    assert lab.births == [0, 1, 2, 4, 8, 16, 32]
    assert list(lab.asked) == [0, 2, 4, 8, 16, 32]


def test_limits_shorten_trends_of_gradients_as_they_shorten_gradients() -> None:
    """R = 1 is enlarged to 4: translation gradients count a quarter, and so does their change."""
    lab = Lab(lambda t: np.ones(3), plain(longest=4), slope=lambda t: [0.1 + 0.02 * t, 0, 0])
    lab.step(APART)
    np.testing.assert_allclose(lab.live[0].records.translation[..., 0], 0.1 / 4)
    np.testing.assert_allclose(lab.live[0].trends.translation[..., 0], 0.02 / 4)
    frozen = Lab(lambda t: np.full(3, 1.0 + t), plain(longest=4, frozen=True), slope=lambda t: [0.1 + 0.02 * t, 0, 0])
    frozen.step(APART)
    assert not frozen.live[0].trends.translation.any()
    assert not frozen.live[0].trends.irradiance.any()


def test_a_place_that_turned_is_renewed_in_its_turned_axes() -> None:
    lab = Lab(lambda t: np.ones(3), plain(longest=2)).run(2)
    c, s = np.cos(0.3), np.sin(0.3)
    turn = np.tile([[c, -s, 0], [s, c, 0], [0, 0, 1.0]], (5, 1, 1))
    lab.cache.live = lab.cache.live.carried(np.arange(5), turn, np.zeros((5, 3)))
    before = lab.live[1].tangents
    live = lab.step(APART)
    assert (live.born == 2).all()
    np.testing.assert_allclose(lab.axes[-1], np.einsum("kij,ktj->kti", turn, before), atol=1e-12)
    np.testing.assert_allclose(live.turn, turn, atol=1e-12)
