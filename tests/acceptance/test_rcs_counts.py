"""Records of room 2 as the specification tabulates them (R23, R24, H3): 64×64 pixels, sampling plane, linear order."""

from typing import NamedTuple

import numpy as np
import pytest
from caching_rooms import ROOM, metres, room_2
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.limits import Limits
from renderers.transport.caching.placement import Placement, fill
from renderers.transport.caching.plane import PlaneSampler
from renderers.transport.caching.records import Records, Sites
from renderers.transport.caching.splat import Canvas, gather
from renderers.transport.direct import receivers_of
from renderers.transport.primary import cast_gbuffer

# a, records, RMSE / mean with gradients, without them, and the percentages of pixels off by more than 2 %
PUBLISHED = [
    (0.05, 2682, 0.0074, 0.0127, 1.4, 3.5),
    (0.10, 1433, 0.0165, 0.0233, 6.8, 13.2),
    (0.15, 951, 0.0263, 0.0333, 10.4, 21.5),
    (0.20, 682, 0.0337, 0.0451, 18.4, 32.5),
    (0.25, 522, 0.0348, 0.0539, 27.4, 45.2),
    (0.35, 328, 0.0665, 0.0734, 45.4, 56.5),
    (0.50, 201, 0.0955, 0.1589, 64.3, 71.2),
]
NO_LIMITS = Limits(1e-6, 1000.0, gradient=False)


class Everywhere(NamedTuple):
    """Room 2's pixels, with a record at each of them."""

    world: World
    canvas: Canvas
    sites: Sites
    records: Records
    place: dict[bytes, int]

    def __call__(self, sites: Sites, first: int = 0) -> Records:
        """The records at some of the pixels, as a sampler gives them: those of the plane depend on their place alone."""
        return self.records.rows([self.place[p.tobytes()] for p in sites.position])


@pytest.fixture(scope="module")
def everywhere() -> Everywhere:
    world = room_2().world()
    gbuffer = cast_gbuffer(world, (64, 64))
    canvas = Canvas.of(gbuffer, dtype=np.float64)
    sites = Sites(*receivers_of(world, gbuffer, canvas.rows))
    records = PlaneSampler(world, ReflectedDirectLight(world))(sites)
    return Everywhere(world, canvas, sites, records, {p.tobytes(): i for i, p in enumerate(sites.position)})


def errors(everywhere: Everywhere, value: NDArray[np.floating]) -> tuple[float, float]:
    """RMSE over mean, and the percentage of pixels off by more than 2 %, against a record at every pixel."""
    exact = everywhere.records.irradiance[:, 0]
    error = value[:, 0] - exact
    return float(np.sqrt(np.mean(error**2)) / exact.mean()), float(100 * np.mean(np.abs(error) > 0.02 * exact))


@pytest.mark.parametrize("row", PUBLISHED, ids=lambda row: f"a={row[0]}")
def test_r23_r24_records_and_interpolation_errors(everywhere: Everywhere, row: tuple[float, ...]) -> None:
    """Counts within 10 %, errors within 25 %; gradients reduce both errors at every a ≤ 0.25."""
    a, count, *published = row
    everywhere.canvas.clear()
    how = Placement(a=a, limits=NO_LIMITS, order="sequential")
    records = fill(everywhere.canvas, everywhere.sites, everywhere, lambda sites: np.zeros(0), how)
    plain, _ = gather(everywhere.canvas.position, everywhere.canvas.normal, records, a, gradients=False)
    found, without = errors(everywhere, everywhere.canvas.irradiance), errors(everywhere, plain)
    assert len(records) == pytest.approx(count, rel=0.10)
    assert (found[0], without[0]) == pytest.approx(published[:2], rel=0.25)
    if a <= 0.25:
        assert found[0] < without[0]
        assert found[1] < without[1]


def test_h3_creases_and_corners_do_not_swallow_the_records(everywhere: Everywhere) -> None:
    """a = 0.25, R_min = 0.1 m: R goes down to millimetres before limits, after them never below R_min; less than half of the
    records lie within 10 cm of an edge of the room."""
    world, canvas, sites, _, _ = everywhere
    assert everywhere.records.radius.min() / world.scale < 0.01
    canvas.clear()
    limits = Limits(0.1 * world.scale, 1000.0, gradient=False)
    how = Placement(a=0.25, limits=limits, order="sequential")
    records = fill(canvas, sites, everywhere, lambda sites: np.zeros(0), how)
    assert records.radius.min() >= 0.1 * world.scale * (1 - 1e-6)
    p, low, high = metres(world, records.position), *np.array(ROOM)
    near_walls = ((p < low + 0.1) | (p > high - 0.1)).sum(axis=1)
    assert (near_walls >= 2).mean() < 0.5
