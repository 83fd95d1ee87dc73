"""Holes of reprojected hemispheres: which way of filling them foresees best (A14)."""

import numpy as np
import pytest
from numpy.typing import NDArray
from temporal_frames import polar, sampled
from temporal_rooms import floor, toy_box

from renderers.transport.caching.incoming import ReflectedDirectLight
from renderers.transport.temporal import reprojection
from renderers.transport.temporal.motion import motion_between
from renderers.transport.temporal.prediction import Reprojection

F32 = NDArray[np.float32]
I64 = NDArray[np.int64]


def black(f: int, depth: F32, source: I64, radiance: F32, out: F32, near: F32) -> None:
    """`reprojection._average` of single points, where holes are still holes: no light comes from them."""
    found = source.ravel()
    out[:] = np.where(found[:, None] >= 0, radiance[found], 0)
    near[:] = np.where(found >= 0, 1 / np.maximum(depth.ravel(), 1e-6), 0)


def nearest(depth: F32, source: I64, holes: I64, cyclic: bool = True) -> int:
    """`reprojection.filled` by the known cell that is nearest in the grid, whatever its depth."""
    known = np.argwhere(source >= 0)
    rows, columns = np.divmod(holes, depth.shape[1])
    away = np.abs(known[None] - np.stack([rows, columns], axis=1)[:, None])
    away[..., 1] = np.minimum(away[..., 1], depth.shape[1] - away[..., 1])
    taken = tuple(known[(away**2).sum(axis=2).argmin(axis=1)].T)
    source[rows, columns], depth[rows, columns] = source[taken], depth[taken]
    return 1


def mean_error(frames: tuple[int, ...] = (5, 24, 40, 58, 77, 101), count: int = 16) -> float:
    """Of the irradiance that single points foresee at random places on the box's floor, relative."""
    scene, rng, errors = toy_box(), np.random.default_rng(1), []
    for frame in frames:
        motion = motion_between(scene.world(frame), scene.world(frame + 1))
        places, now = floor(motion.before, rng.uniform(-0.95, 0.95, (count, 2))), polar(motion.before)
        truth = sampled(polar(motion.after), places)[1].irradiance[:, 0]
        ahead = Reprojection(motion, now, ReflectedDirectLight(motion.after), 1)
        errors.append(np.abs(sampled(now, places, ahead)[1].irradiance[:, 0] / truth - 1))
    return float(np.mean(errors))


def test_a14_the_deepest_neighbour_fills_holes_best(monkeypatch: pytest.MonkeyPatch) -> None:
    """No worse in the mean than the nearest known cell, which is no worse than leaving holes black."""
    deep = mean_error()
    with monkeypatch.context() as patch:
        patch.setattr(reprojection, "filled", nearest)
        near = mean_error()
    monkeypatch.setattr(reprojection, "filled", lambda depth, source, holes, cyclic=True: 0)
    monkeypatch.setattr(reprojection, "_average", black)
    assert deep <= near <= mean_error()
