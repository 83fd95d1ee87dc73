"""Methods without mathematics, to test what carries methods out. Named in LUXMETER_PLUGINS, as any method kept outside the tree."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from jobs import points
from renderers import Claim, Frame, Method, Scene, SequenceMethod, Settings, Transport, register, setting
from renderers.method import Context


class FlatSettings(Settings):
    """How bright, and how to misbehave."""

    level: float = setting(0.5, "radiance of every pixel", unit="W·sr⁻¹·m⁻²", ge=0, le=10)
    mode: Literal["good", "raise", "abort", "segfault", "hang", "grow", "nan", "fickle"] = setting(
        "good", "what to do instead of rendering"
    )


class Flat(Method):
    """One colour, brighter with the frame number; refuses environments."""

    name = "flat"
    title = "One flat colour"
    source = "luxmeter's tests"
    Settings = FlatSettings
    claims: ClassVar = {"environment": Claim("refused"), "glossy": Claim("approximated", "drawn flat")}

    def transport(self, settings: FlatSettings) -> Transport:
        return "direct"

    def _render(self, scene: Scene, settings: FlatSettings, context: Any) -> Frame:
        if settings.mode == "raise":
            raise ValueError("no such colour")
        if settings.mode == "abort":
            os.abort()
        if settings.mode == "segfault":
            os.kill(os.getpid(), signal.SIGSEGV)
        if settings.mode == "hang":
            threading.Event().wait()  # for ever: who sees an end has ended it
        hoard = [np.ones(2**23, np.uint8) for _ in range(64)] if settings.mode == "grow" else []
        if hoard:
            time.sleep(5)
        with context.watch("fill"):
            image = np.full((context.size[1], context.size[0], 3), settings.level * (1 + context.frame), np.float32)
        if settings.mode == "nan":
            image[0, 0] = np.nan
        if settings.mode == "fickle":
            image[0, 0] *= 1 + int.from_bytes(os.urandom(2)) / 2**18
        count(context.size)
        return Frame({"beauty": image}, context.watch.timings, {"pixels": image.size // 3})


class BudgetSettings(Settings):
    """Work, or a time that a pilot turns into work."""

    steps: int = setting(1, "work", ge=1)
    seconds: float | None = setting(None, "wanted time", unit="s", gt=0)


class Budget(Method):
    """Brightness is the amount of work; the pilot knows that a step takes 0.1 s."""

    name = "budget"
    title = "Work for a time"
    source = "luxmeter's tests"
    Settings = BudgetSettings

    def transport(self, settings: BudgetSettings) -> Transport:
        return "full"

    def plan(self, scene: Scene, settings: BudgetSettings, size: tuple[int, int]) -> BudgetSettings:
        """Settings that state the work."""
        return BudgetSettings(steps=round((settings.seconds or 0) * 10))

    def _render(self, scene: Scene, settings: BudgetSettings, context: Any) -> Frame:
        image = np.full((context.size[1], context.size[0], 3), settings.steps, np.float32)
        return Frame({"beauty": image}, context.watch.timings, {"steps": settings.steps})


class Tally(SequenceMethod):
    """Brightness is how many frames this one call has rendered."""

    name = "tally"
    title = "Frames counted"
    source = "luxmeter's tests"

    def transport(self, settings: Settings) -> Transport:
        return "direct"

    def _render_frames(self, scene: Scene, settings: Settings, contexts: Iterable[Context]) -> Iterator[Frame]:
        for done, context in enumerate(contexts, start=1):
            with context.watch("fill"):
                image = np.full((context.size[1], context.size[0], 3), done, np.float32)
            age = np.full_like(image, min(done / 8, 1.0))
            layers = {"beauty": image, "debug.age-of-state": age}
            captions = {"debug.age-of-state": "white: eight frames or more"}
            yield Frame(layers, context.watch.timings, {"frame": context.frame}, captions=captions)


def count(size: tuple[int, int]) -> None:
    """Add a line for this render to the file `rendered` in the data folder, where there is one."""
    counts = Path(os.environ.get("LUXMETER_HOME", ""), "rendered")
    if counts.is_file():
        with counts.open("a") as stream:
            print(*size, file=stream)


def kill_child(label: str) -> None:
    """Kill this process at the point that the file `kill` in the data folder names. The file goes first: it happens once."""
    order = Path(os.environ.get("LUXMETER_HOME", ""), "kill")
    if order.is_file() and order.read_text() == label:
        order.unlink()
        os.kill(os.getpid(), signal.SIGKILL)


if Path(sys.argv[0]).match("jobs/child.py"):
    points.hook = kill_child
register(Flat)
register(Budget)
register(Tally)
