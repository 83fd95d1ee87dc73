"""What follows for the levels of forward light cuts from a scene and few settings: their number, reach, law, and words for them."""

from __future__ import annotations

from math import ceil, inf, log
from typing import TYPE_CHECKING, Any, NamedTuple

from renderers.scene.model import Scene
from renderers.scene.surface import rest_surface
from renderers.scene.world import rest_bounds

if TYPE_CHECKING:
    from renderers.transport.cuts import Family

DEFAULT_REACH = 0.3
LEAST_LAST = 32
FEW_LAST = 10


class Calibration(NamedTuple):
    """What follows from settings and scene. first: R_1 in metres; epsilon_omega: sr; levels: K."""

    vpls: int
    reach: float
    first: float
    levels: int
    q_n: float
    epsilon_omega: float


def calibrate(scene: Scene, settings: Any) -> Calibration:
    """R_1 from reach, or from ε_Ω by a_1 = |S|/(N μ_1) = ε_Ω R_1²; then the smallest K whose last level spans the scene.

    A last level of fewer than LEAST_LAST drawn VPLs would leave the far light to a handful of them: K ends before. Roulette has
    no last level, every light being near for all of them (μ_1 = 1), and is only asked for K = 1.
    """
    radius = rest_bounds(scene)[1]
    vpls = settings.vpls or round(1024 * 64**settings.quality)
    q_n = settings.q_n or settings.q_a
    surface = rest_surface(scene)
    roulette = settings.family == "roulette"
    # Of the discrete levels, μ_1 of an endless geometric law: K isn't known yet, and changes it by the last term only.
    first_area = surface / vpls / (1.0 if roulette else 1 - 1 / q_n)
    reach = settings.reach
    if reach is None:
        reach = DEFAULT_REACH if settings.epsilon_omega is None else (first_area / settings.epsilon_omega) ** 0.5 / radius
    epsilon = settings.epsilon_omega or first_area / (reach * radius) ** 2
    levels = settings.levels or level_count(inf if roulette else vpls, reach, settings.q_a, q_n)
    return Calibration(vpls, reach, reach * radius, levels, q_n, epsilon)


def level_count(vpls: float, reach: float, q_a: float, q_n: float) -> int:
    """Smallest K with reach² q_a^(K-1) ≥ 1, as long as level K gets LEAST_LAST VPLs on average; 1 … 32."""
    count = 1
    if reach < 1:
        count = min(32, 1 + ceil(-2 * log(reach) / log(q_a) - 1e-9))
    while count > 1 and vpls * last_share(count, q_n) < LEAST_LAST:
        count -= 1
    return count


def last_share(count: int, q_n: float) -> float:
    """μ_K of a geometric law."""
    return q_n ** (1 - count) * (1 - 1 / q_n) / (1 - q_n**-count)


def family_of(scene: Scene, settings: Any) -> Family:
    """Support functions of resolved settings, their areas being squared reaches in World units, of radius 1."""
    from renderers.transport.cuts import DiscreteLevels, LinearLevels, RidgeLevels, geometric_levels

    if settings.family == "roulette":
        from renderers.transport.roulette import RouletteLevels

        return RouletteLevels(settings.reach**2)
    areas, shares = geometric_levels(settings.levels, settings.reach**2, settings.q_a, settings.q_n)
    if settings.family == "ridge":
        return RidgeLevels(log(settings.q_n), 1 / log(settings.q_a), settings.reach**2 / (settings.q_a - 1))
    if settings.family == "linear":
        return LinearLevels(areas, log(settings.q_n))
    return DiscreteLevels(areas, shares, settings.family == "c0")


def notes_of(scene: Scene, settings: Any) -> tuple[str, ...]:
    """The levels in words; and a warning where the last one is nearly empty."""
    first = settings.reach * rest_bounds(scene)[1]
    if settings.family == "ridge":
        return (f"flc: N = {settings.vpls}, continuous levels, λ_L = {log(settings.q_n):.4g}, λ_D = {1 / log(settings.q_a):.4g}, "
                f"R_1 = {first:.4g} m",)  # fmt: skip
    if settings.family == "roulette":
        return (
            f"flc: N = {settings.vpls}, roulette, R_1 = {first:.4g} m at mean brightness, ε_Ω = {settings.epsilon_omega:.4g} sr",
        )
    note = f"flc: N = {settings.vpls}, K = {settings.levels}, R_1 = {first:.4g} m, ε_Ω = {settings.epsilon_omega:.4g} sr"
    last = settings.vpls * last_share(settings.levels, settings.q_n)
    if last < FEW_LAST:
        return note, f"flc: the last level gets {last:.1f} VPLs on average: far light is noisy; fewer levels or more VPLs"
    return (note,)
