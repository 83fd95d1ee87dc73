"""The five transports as estimators of one path: Color3f of (scene, sampler, ray, active).

direct, one-bounce, full: Mitsuba's `path` with max_depth 2, 3 and unbounded; `full` plays Russian roulette from depth RR_DEPTH on,
with survival min(0.95, largest throughput), weighted by its inverse: unbiased.

one-bounce-unoccluded: direct + ∫ f(x, ω, v) cos θ Σ_k L_k(ω) dω, the sum over EVERY surface y_k that the ray pierces, L_k the
direct light, shadow-tested, that y_k reflects towards x. ω is drawn from the receiver's BRDF (cosine-distributed for Lambert) and
weighted f·cos/pdf. The variance is finite, unlike that of drawing y by area (1/d²). Emission of y_k is direct light and doesn't
count again.

ambient-occlusion: share of cosine-distributed directions that hit nothing (within `radius`); background 0. The scene is exported
as clay: albedo-1 Lambert, no lights, no emitters.
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from renderers.method import Transport
from renderers.reference.sampling import Estimator
from renderers.reference.variant import mitsuba

mi = mitsuba()
DEPTHS = {"direct": 2, "one-bounce": 3, "full": -1}
RR_DEPTH = 5


def estimator(transport: Transport, scene: Any, radius: float | None = None) -> Estimator:
    """The estimator of a transport for `scene`. radius: World units, ambient occlusion only; None = infinite."""
    if transport == "ambient-occlusion":
        return lambda scene, sampler, ray, active: ambient_occlusion(scene, sampler, ray, active, radius)
    if transport == "one-bounce-unoccluded":
        return unoccluded(scene)
    path = mi.load_dict({"type": "path", "max_depth": DEPTHS[transport], "rr_depth": RR_DEPTH})
    return lambda scene, sampler, ray, active: path.sample(scene, sampler, mi.RayDifferential3f(ray), None, active)[0]


def ambient_occlusion(scene: Any, sampler: Any, ray: Any, active: Any, radius: float | None) -> Any:
    """Cosine-weighted visibility of the sky at the first hit: one direction, 0 or 1."""
    si = scene.ray_intersect(ray, active)
    active = active & si.is_valid()
    local = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
    local.z = dr.select(mi.Frame3f.cos_theta(si.wi) < 0, -local.z, local.z)
    probe = si.spawn_ray(si.to_world(local))
    if radius is not None:
        probe.maxt = radius
    return mi.Color3f(dr.select(active & ~scene.ray_test(probe, active), 1.0, 0.0))


def unoccluded(scene: Any) -> Estimator:
    """Estimator of `one-bounce-unoccluded`. A ray pierces each triangle once, so their number bounds the loop."""
    path = mi.load_dict({"type": "path", "max_depth": DEPTHS["direct"]})
    triangles = sum(shape.face_count() for shape in scene.shapes())
    extended = any(not is_delta(e) for e in scene.emitters())

    def estimate(scene: Any, sampler: Any, ray: Any, active: Any) -> Any:
        radiance = path.sample(scene, sampler, mi.RayDifferential3f(ray), None, active)[0]
        si = scene.ray_intersect(ray, active)
        active = active & si.is_valid()
        sample, weight = si.bsdf().sample(mi.BSDFContext(), si, sampler.next_1d(active), sampler.next_2d(active), active)
        active &= dr.any(weight != 0)
        probe = si.spawn_ray(si.to_world(sample.wo))
        return radiance + dr.select(active, weight, 0) * pierced(scene, sampler, probe, active, triangles, extended)

    return estimate


def is_delta(emitter: Any) -> bool:
    """Whether an emitter is a point or a direction, which no ray hits by chance."""
    return bool(mi.has_flag(emitter.flags(), mi.EmitterFlags.Delta))


@dr.syntax
def pierced(scene: Any, sampler: Any, ray: Any, active: Any, triangles: int, extended: bool) -> Any:
    """Σ of the direct light that all surfaces along `ray` reflect back to its origin: Color3f."""
    total = mi.Color3f(0)
    count = mi.UInt32(0)
    active = mi.Bool(active)
    while active & (count < triangles):
        si = scene.ray_intersect(ray, active)
        active &= si.is_valid()
        total += reflected(scene, sampler, si, active, extended)
        ray = si.spawn_ray(ray.d)
        count += 1
    return total


def reflected(scene: Any, sampler: Any, si: Any, active: Any, extended: bool) -> Any:
    """Direct light, shadow-tested, that si reflects along si.wi: Color3f.

    One light sample and, where lights have extent, one BSDF sample, weighted by the balance heuristic.
    """
    context = mi.BSDFContext()
    bsdf = si.bsdf()
    ds, weight = scene.sample_emitter_direction(si, sampler.next_2d(active), True, active)
    seen = active & (ds.pdf != 0)
    f, density = bsdf.eval_pdf(context, si, si.to_local(ds.d), seen)
    share = dr.select(ds.delta, 1.0, ds.pdf / (ds.pdf + density))
    radiance = dr.select(seen, weight * f * share, 0)
    if not extended:
        return radiance
    sample, weight = bsdf.sample(context, si, sampler.next_1d(active), sampler.next_2d(active), active)
    drawn = active & dr.any(weight != 0)
    hit = scene.ray_intersect(si.spawn_ray(si.to_world(sample.wo)), drawn)
    emitter = hit.emitter(scene, drawn)
    drawn &= emitter != None  # noqa: E711  (compared lane by lane)
    density = scene.pdf_emitter_direction(si, mi.DirectionSample3f(scene, hit, si), drawn)
    share = sample.pdf / (sample.pdf + density)
    return radiance + dr.select(drawn, weight * emitter.eval(hit, drawn) * share, 0)
