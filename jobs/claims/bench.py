"""What measuring a claim needs: renders of fresh scenes, references from the data folder, metrics at one exposure, progress."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jobs.scenes import NamedScene, open_scene
from jobs.settings import validate
from jobs.store import Store
from renderers import Frame, Transport, get_method
from renderers.images import display_values, luminance
from renderers.method import device_string

if TYPE_CHECKING:
    from renderers.reference import Reference

# divisible by all numbers of interleaved sub-images
WARM_UP_SIZE = (32, 16)


@dataclass
class Bench:
    """One claim's bench. report takes one line on what is going on."""

    report: Callable[[str], None]
    store: Store = field(default_factory=Store)
    _warm: set[tuple[str, str, str]] = field(default_factory=set)

    def open(self, scene: str) -> NamedScene:
        """A scene by the text that the command line takes. Raises SceneError."""
        return open_scene(scene)

    def settings(self, scene: NamedScene, method: str, **values: Any) -> Any:
        """Validated and resolved settings of a method for this scene and device. Raises RequestError by name."""
        chosen = get_method(method)
        return chosen.resolve(scene.scene, validate(chosen, values), device_string())

    def render(
        self, scene: NamedScene, method: str, *, size: tuple[int, int], seed: int = 0, frame: int = 0, **values: Any
    ) -> Frame:
        """One frame, from a scene that nothing is cached for; a small untimed one goes before the first of its kind."""
        chosen = get_method(method)
        settings = self.settings(scene, method, **values)
        kind = (scene.text, method, str(getattr(settings, "visibility", "")) + str(getattr(settings, "backend", "")))
        if kind not in self._warm:
            self.report(f"{scene.name}: {method}, warm-up")
            chosen.render(replace(scene.scene), settings, size=WARM_UP_SIZE, seed=seed, frame=frame)
            self._warm.add(kind)
        self.report(f"{scene.name}: {method}, seed {seed}")
        return chosen.render(replace(scene.scene), settings, size=size, seed=seed, frame=frame)

    def reference(
        self, scene: NamedScene, transport: Transport, *, size: tuple[int, int], noise: float, max_seconds: float, frame: int = 0
    ) -> Reference:
        """A path-traced reference, kept in the data folder; `max_seconds` stops it, and its `noise` says how far it came."""
        from renderers import reference

        def told(replicates: int, reached: float, eta: float) -> None:
            self.report(f"{scene.name}: reference {transport}, {replicates} replicates, noise {reached:.4f}")

        return reference.render(
            scene.scene, transport, size=size, noise=noise, frame=frame, store=self.store.references, max_seconds=max_seconds,
            progress=told,
        )  # fmt: skip

    def exposure(self, scene: NamedScene, image: NDArray[np.floating]) -> float:
        """The scene's stored exposure; before its first full reference 1 / 99th percentile luminance of `image`."""
        stored = scene.scene.exposure or self.store.exposure(scene.scene.hash)
        if stored is not None:
            return stored
        bright = float(np.percentile(luminance(image), 99))
        return 1 / bright if bright > 0 else 1.0

    @cached_property
    def device(self) -> str:
        """What this process renders on, in one line."""
        from jobs.rendering import device

        found = device()
        return f"{found['gl']} · {found['cpu']} · {found['threads']} threads"


def display_rmse(image: NDArray[np.floating], truth: NDArray[np.floating], exposure: float) -> float:
    """Root mean squared difference of display values, 0-255, of two linear images (H, W, 3)."""
    return float(np.sqrt(np.mean((display_values(image, exposure) - display_values(truth, exposure)) ** 2)))


def render_seconds(frame: Frame, *, cpu: bool = False, without: tuple[str, ...] = ()) -> float:
    """Wall (or CPU) seconds of a frame's render stage, without the named passes."""
    return sum(t.cpu_s if cpu else t.wall_s for t in frame.timings if t.stage == "render" and t.name not in without)
