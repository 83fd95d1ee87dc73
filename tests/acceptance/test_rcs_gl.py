"""Radiance cache splatting on OpenGL: hemicubes as the sampler of irradiance and radiance records."""

from dataclasses import replace

import numpy as np
import pytest
from caching_rooms import room_2
from numpy.typing import NDArray

import renderers
from renderers.gl.hemicube import Triangles
from renderers.methods.rcs import RadianceCacheSplatting, RcsSettings, sampler_of, shadows_of
from renderers.scene.model import Phong
from renderers.transport.brdf import evaluate, materials_at
from renderers.transport.caching.cube import cube_tables
from renderers.transport.caching.hemicube import HemicubeSampler
from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.caching.records import Sites
from renderers.transport.caching.reflectance import Lobes, gloss_of
from renderers.transport.direct import receivers_of
from renderers.transport.primary import cast_gbuffer
from renderers.transport.raycast import OFFSET

pytestmark = pytest.mark.gl
METHOD = RadianceCacheSplatting()
SIZE = (24, 18)


def indirect(scene: renderers.Scene, **settings: object) -> NDArray[np.float32]:
    return METHOD.render(scene, RcsSettings(**settings), size=SIZE).layers["indirect"]  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def by_rays() -> NDArray[np.float32]:
    return indirect(room_2(), sampler="polar", rays=4096)


@pytest.mark.parametrize("shadows", ["cast", "mapped"])
def test_hemicubes_give_the_picture_of_polar_hemispheres(by_rays: NDArray[np.float32], shadows: str) -> None:
    """Room 2. At 4096 samples polar hemispheres are off by 1.3 %, hemicubes by 3.0 % in the RMS: together 3.3 % of the mean, and
    zones of other radii, which a = 0.15 keeps within 1 %."""
    found = indirect(room_2(), sampler="hemicube", rays=4096, hemicube_shadows=shadows)
    assert np.sqrt(np.mean((found - by_rays) ** 2)) <= 0.05 * by_rays.mean()
    assert found.mean() == pytest.approx(by_rays.mean(), rel=0.02)


def test_hemicubes_know_curvature_and_all_bounces() -> None:
    polar, cubes = (indirect(room_2(), sampler=s, rays=1024, placement="hessian", bounces="all") for s in ("polar", "hemicube"))
    assert cubes.mean() == pytest.approx(polar.mean(), rel=0.03)


def test_radiance_records_from_hemicubes() -> None:
    """A glossy wall: records of hemicubes are no further from those of rays than twice what two seeds of rays are apart."""
    scene = renderers.load_scene("cornell-glossy")
    polar, again, cubes = (
        METHOD.render(scene, RcsSettings(sampler=s, rays=1024, glossy_rays=4096), size=SIZE, seed=seed)
        for s, seed in (("polar", 0), ("polar", 1), ("hemicube", 0))
    )
    assert cubes.counters["radiance_records"] > 0
    assert cubes.counters["texels"] > 0
    noise, difference = (f.layers["indirect"] - polar.layers["indirect"] for f in (again, cubes))
    assert np.sqrt(np.mean(difference**2)) <= 2 * np.sqrt(np.mean(noise**2))
    assert cubes.layers["indirect"].mean() == pytest.approx(polar.layers["indirect"].mean(), rel=0.05)


def test_r28_reflected_light_of_radiance_records_against_quadrature() -> None:
    """Phong exponent 20, order 10, drawn hemicubes of 64²: Σ c_i λ_i against the sum over the texels with the BRDF itself, RMS
    at most 0.03 of the mean."""
    material = Phong("p", (0.3, 0.2, 0.1), (0.5, 0.4, 0.6), 20.0)
    scene = room_2()
    world = replace(scene, materials=tuple(replace(material, name=m.name) for m in scene.materials)).world()
    gbuffer, gloss = cast_gbuffer(world, (12, 9)), gloss_of(world, 10)
    rows = np.flatnonzero(gloss.cached(gbuffer))[::9]
    assert len(rows) > 8
    here = Sites(*receivers_of(world, gbuffer, rows))
    sampler = HemicubeSampler(world, 64, ReflectedDirectLight(world), order=gloss.order, rasteriser=Triangles(world, OFFSET))
    records, plain = sampler(here), HemicubeSampler(world, 64, ReflectedDirectLight(world))
    assert records.coefficients is not None
    found = np.einsum("pci,pic->pc", Lobes(world, gbuffer, rows, gloss)(slice(0, len(rows))), records.coefficients)
    cast, tables, exact = plain.hemispheres(here)[0], cube_tables(64), np.empty_like(found)
    m = materials_at(world.materials, gbuffer.material.ravel()[rows], gbuffer.base.reshape(-1, 3)[rows])
    for k in range(len(rows)):
        light = tables.direction @ np.concatenate([cast.tangents[k], here.normal[[k]]])
        view = gbuffer.eye - here.position[k]
        normal, view = (np.tile(v / np.linalg.norm(v), (len(light), 1)) for v in (here.normal[k], view))
        f = evaluate(m.rows(np.full(len(light), k)), normal, light, view)
        weight = tables.solid * tables.direction[:, 2]
        exact[k] = (f * weight[:, None] * cast.radiance[k].reshape(-1, 3)).sum(axis=0)
    assert np.sqrt(np.mean((found - exact) ** 2)) <= 0.03 * np.mean(exact)


def test_same_bytes_again() -> None:
    first, second = (indirect(room_2(), sampler="hemicube", rays=256, hemicube_shadows="mapped") for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_the_tables_behind_auto() -> None:
    software, hardware = "llvmpipe (LLVM 15.0.6, 256 bits)", "NVIDIA H100 80GB HBM3/PCIe/SSE2"
    assert [sampler_of(name) for name in ("auto", "plane", "hemicube")] == ["polar", "plane", "hemicube"]
    assert [shadows_of("auto", "one", d) for d in (software, hardware)] == ["cast", "mapped"]
    assert shadows_of("auto", "all", hardware) == "cast"
    assert shadows_of("mapped", "one", software) == "mapped"
    with pytest.raises(ValueError, match="bounces=all"):
        RcsSettings(hemicube_shadows="mapped", bounces="all")


def test_records_of_earlier_views_splatted_on_the_device() -> None:
    """Four sub-pixel views: the last three take their records from GL's splat. Pixels at the rim of a zone, where float32 decides
    whether a record counts, may differ: the mean by 10⁻⁴ at most, all but a hundredth of the pixels by 10⁻³ of the mean."""
    cpu, gl = (METHOD.render(room_2(), RcsSettings(rays=256, subpixels=2, backend=b), size=SIZE) for b in ("cpu", "gl"))
    images = [f.layers["indirect"] for f in (cpu, gl)]
    assert images[1].mean() == pytest.approx(images[0].mean(), rel=1e-4)
    assert (np.abs(images[1] - images[0]).max(axis=2) <= 1e-3 * images[0].mean()).mean() >= 0.99
    assert gl.counters["splat_tests"] > 0
