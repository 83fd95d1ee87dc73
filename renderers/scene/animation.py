"""Keyframe animation as glTF 2.0 defines it (section 3.11, appendix C): STEP, LINEAR (slerp for rotations), CUBICSPLINE."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.scene.model import Channel, Scene


def posed(scene: Scene, frame: int) -> Scene:
    """The static scene at `frame` (time = frame / fps). Any integer frame is defined: values hold before and after the keys."""
    time = frame / scene.fps
    parts: dict[str, list[Any]] = {"node": list(scene.nodes), "light": list(scene.lights), "camera": list(scene.cameras)}
    for channel in scene.channels:
        value = sample(channel, time)
        if channel.path in ("intensity", "color"):
            # a spline may overshoot below zero; light can't
            value = np.maximum(value, 0.0)
        new: Any = float(value[0]) if len(value) == 1 else tuple(float(v) for v in value)
        parts[channel.target][channel.index] = replace(parts[channel.target][channel.index], **{channel.path: new})
    return replace(scene, nodes=tuple(parts["node"]), lights=tuple(parts["light"]), cameras=tuple(parts["camera"]), channels=())


def sample(channel: Channel, time: float) -> NDArray[np.float64]:
    """Value of one channel at `time` in seconds, float64 (C,)."""
    times = channel.times
    cubic = channel.interpolation == "CUBICSPLINE"
    values = channel.values[:, 1] if cubic else channel.values
    if time <= times[0]:
        return np.asarray(values[0])
    if time >= times[-1]:
        return np.asarray(values[-1])
    k = int(np.searchsorted(times, time, side="right")) - 1
    span = times[k + 1] - times[k]
    u = (time - times[k]) / span
    if channel.interpolation == "STEP":
        return np.asarray(values[k])
    if cubic:
        value = (
            (2 * u**3 - 3 * u**2 + 1) * values[k]
            + span * (u**3 - 2 * u**2 + u) * channel.values[k, 2]
            + (-2 * u**3 + 3 * u**2) * values[k + 1]
            + span * (u**3 - u**2) * channel.values[k + 1, 0]
        )
        return np.asarray(value / np.linalg.norm(value) if channel.path == "rotation" else value)
    if channel.path == "rotation":
        return slerp(values[k], values[k + 1], float(u))
    return np.asarray((1 - u) * values[k] + u * values[k + 1])


def slerp(a: NDArray[np.float64], b: NDArray[np.float64], u: float) -> NDArray[np.float64]:
    """Spherical interpolation of unit quaternions along the shorter arc."""
    dot = float(a @ b)
    if dot < 0:
        b, dot = -b, -dot
    angle = np.arccos(min(dot, 1.0))
    straight = angle < 1e-6
    value = (1 - u) * a + u * b if straight else (np.sin((1 - u) * angle) * a + np.sin(u * angle) * b) / np.sin(angle)
    return np.asarray(value / np.linalg.norm(value))
