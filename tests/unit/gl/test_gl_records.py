"""Irradiance records splatted on GL against the CPU's splat (R19)."""

from collections import Counter

import numpy as np
import pytest
from gl_oracle import room

from renderers.gbuffer import GBuffer
from renderers.gl.caching import KINDS, splat_records
from renderers.gl.gbuffer import render_gbuffer, render_resident
from renderers.scene.world import World
from renderers.transport.caching.records import Records
from renderers.transport.caching.splat import Canvas
from renderers.transport.caching.weights import WEIGHTS, Weight

pytestmark = pytest.mark.gl
SIZE = (70, 45)


@pytest.fixture(scope="module")
def view() -> tuple[World, GBuffer]:
    world = room().world()
    return world, render_gbuffer(world, SIZE)


def records_on(gbuffer: GBuffer, count: int) -> Records:
    """Records at random covered pixels, with radii, gradients and colours drawn at random; some behind the camera."""
    rng = np.random.default_rng(4)
    rows = rng.choice(np.flatnonzero(gbuffer.covered), count)
    position, normal = (a.reshape(-1, 3)[rows].astype(np.float64) for a in (gbuffer.position, gbuffer.normal))
    position[: count // 20] = 2 * gbuffer.eye - position[: count // 20]
    slopes = rng.normal(size=(2, count, 3, 3))
    return Records(position, normal, rng.uniform(0.05, 0.6, count), rng.random((count, 3)), *slopes).astype(np.float32)


def test_kinds_are_those_of_the_kernels() -> None:
    assert KINDS == WEIGHTS


@pytest.mark.parametrize("weight", ["ward", "shifted", "tent"])
@pytest.mark.parametrize("gradients", [True, False])
def test_r19_the_sums_are_those_of_the_cpu(view: tuple[World, GBuffer], weight: Weight, gradients: bool) -> None:
    """Same coverage but for ≤ 0.1 % of the pixels, at rims; where it agrees, weights and values to 10⁻⁴ of the pixel's own.

    A float32 error of 10⁻⁷ in e near a zone's rim decides whether a record counts at all: pixels within 10⁻⁵ of a rim are left out
    of the second check.
    """
    world, gbuffer = view
    records = records_on(gbuffer, 300)
    canvas = Canvas.of(gbuffer)
    counters = Counter[str]()
    canvas.add(records, 0.3, weight, gradients, counters)
    image, pairs = splat_records(gbuffer, world, records.columns(np.float32), 0.3, weight, gradients)
    found, expected = image.reshape(-1, 4)[canvas.rows], canvas.sums
    assert ((found[:, 3] > 0) != (expected[:, 3] > 0)).mean() <= 1e-3
    assert counters["splats"] <= pairs
    assert not image[~gbuffer.covered].any()
    apart = np.linalg.norm(canvas.position[:, None] - records.position, axis=2) / records.radius
    bend = np.linalg.norm(canvas.normal[:, None] - records.normal, axis=2) / np.sqrt(2)
    e = np.maximum(apart, bend) if weight == "tent" else apart + bend
    clear = (np.abs(e - 0.3) > 1e-5).all(axis=1)
    assert clear.mean() > 0.95
    scale = np.maximum(expected[:, 3:], 1e-6)
    assert (np.abs(found - expected) <= 1e-4 * scale * (1 + np.abs(records.translation).max()))[clear].all()


def test_a_resident_g_buffer_and_many_batches_give_the_same_bytes(
    view: tuple[World, GBuffer], monkeypatch: pytest.MonkeyPatch
) -> None:
    world, gbuffer = view
    records = records_on(gbuffer, 200)
    resident = render_resident(world, SIZE)
    images = [splat_records(g, world, records.columns(np.float32), 0.2)[0] for g in (gbuffer, resident)]
    monkeypatch.setattr("renderers.gl.splat.MOST", 64)
    images.append(splat_records(gbuffer, world, records.columns(np.float32), 0.2)[0])
    resident.release()
    for image in images[1:]:
        np.testing.assert_array_equal(images[0], image)


def test_no_records(view: tuple[World, GBuffer]) -> None:
    world, gbuffer = view
    image, pairs = splat_records(gbuffer, world, Records.empty().columns(np.float32), 0.2)
    assert pairs == 0
    assert not image.any()
