"""What a rendering method is, and the registry that finds it by name.

A method is one module (or small folder) in `renderers/methods` whose last line registers it. Its module must be cheap to import
(no pyrender, numba or mitsuba at module level): settings are validated before any of those is loaded.
"""

from __future__ import annotations

import importlib
import os
import pkgutil
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field

from renderers.frame import Frame, Stopwatch
from renderers.scene.model import NEEDS, Scene

Transport = Literal["direct", "one-bounce", "one-bounce-unoccluded", "full", "ambient-occlusion"]
TRANSPORTS: tuple[Transport, ...] = ("direct", "one-bounce", "one-bounce-unoccluded", "full", "ambient-occlusion")


class UnsupportedScene(ValueError):
    """The scene needs something the method refuses; raised before any work."""


class UnknownMethod(KeyError):
    """No method of that name; the message lists those there are."""

    def __str__(self) -> str:
        return str(self.args[0])


class Settings(BaseModel):
    """Base of every method's settings: frozen, unknown names refused. Fields are made with `setting`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    subpixels: int = Field(
        1, ge=1, le=8, description="k: average k×k G-buffers per pixel", json_schema_extra={"unit": "1", "source": "luxmeter"}
    )


def setting(default: Any, description: str, *, unit: str = "1", source: str = "luxmeter", **limits: Any) -> Any:
    """A settings field: default, one-line description, unit, source (thesis section or paper), limits such as ge=1."""
    return Field(default, description=description, json_schema_extra={"unit": unit, "source": source}, **limits)


@dataclass(frozen=True)
class Claim:
    """How a method meets one need of a scene. `how` is one sentence, shown in every result, where it is approximated."""

    support: Literal["exact", "approximated", "refused"] = "exact"
    how: str = ""


@dataclass(frozen=True)
class Context:
    """What a render call is about, besides scene and settings. size is (width, height)."""

    size: tuple[int, int]
    seed: int
    frame: int
    watch: Stopwatch


class Method(ABC):
    """A rendering algorithm. Subclasses set the class attributes and implement `transport` and `_render`."""

    name: ClassVar[str]
    title: ClassVar[str]
    source: ClassVar[str]
    Settings: ClassVar[type[Any]] = Settings
    claims: ClassVar[Mapping[str, Claim]] = {}

    @abstractmethod
    def transport(self, settings: Any) -> Transport:
        """Light paths that an image of these settings contains."""

    def resolve(self, scene: Scene, settings: Any, device: str) -> Any:
        """Settings with every `auto` and derived value filled in, by table look-up on the GL device string; pure."""
        return settings

    @abstractmethod
    def _render(self, scene: Scene, settings: Any, context: Context) -> Frame:
        """Render with resolved settings."""

    def claim(self, need: str) -> Claim:
        """The method's claim about one need; exact where the method says nothing."""
        return self.claims.get(need, Claim())

    def check(self, scene: Scene) -> tuple[str, ...]:
        """Sentences on what is approximated for this scene. Raises UnsupportedScene naming each refused need."""
        refused = [n for n in NEEDS if n in scene.needs and self.claim(n).support == "refused"]
        if refused:
            raise UnsupportedScene(f"{self.name} can't render {scene.name}: needs {', '.join(refused)}")
        return tuple(f"{n}: {self.claim(n).how}" for n in NEEDS if n in scene.needs and self.claim(n).support == "approximated")

    def render(
        self, scene: Scene, settings: Any = None, *, size: tuple[int, int] = (320, 180), seed: int = 0, frame: int = 0
    ) -> Frame:
        """Render one frame: a pure function of its arguments, same bytes in any process and at any thread count.

        size is (width, height) in pixels. Raises UnsupportedScene, ValueError (size, settings of another method) or
        FloatingPointError.
        """
        return self._render(scene, self._ready(scene, settings, size), Context(size, seed, frame, Stopwatch()))

    def render_frames(
        self, scene: Scene, settings: Any = None, *, size: tuple[int, int] = (320, 180), seed: int = 0, frames: tuple[int, int]
    ) -> Iterator[Frame]:
        """Render the frames `frames[0]` … `frames[1]`, both included, one after the other; otherwise as `render`.

        Frame k of (A, B) has the bytes of frame k of (A, k). Without state between frames (`SequenceMethod` has one) it has those
        of `render(frame=k)` too.
        """
        if not 0 <= frames[0] <= frames[1]:
            raise ValueError(f"frames must be (A, B) with 0 ≤ A ≤ B, got {frames}")
        settings = self._ready(scene, settings, size)
        contexts = (Context(size, seed, frame, Stopwatch()) for frame in range(frames[0], frames[1] + 1))
        return self._render_frames(scene, settings, contexts)

    def _render_frames(self, scene: Scene, settings: Any, contexts: Iterable[Context]) -> Iterator[Frame]:
        """Each frame by itself, from a scene that nothing has been cached for: its timings are those of a frame alone."""
        for context in contexts:
            yield self._render(replace(scene), settings, context)

    def _ready(self, scene: Scene, settings: Any, size: tuple[int, int]) -> Any:
        """Settings as `_render` takes them, after everything that can be refused has been checked."""
        settings = self.Settings() if settings is None else settings
        if not isinstance(settings, self.Settings):
            raise ValueError(f"{self.name} takes {self.Settings.__qualname__}, got {type(settings).__qualname__}")
        if not all(1 <= n <= 8192 for n in size):
            raise ValueError(f"size must lie in 1..8192 pixels, got {size[0]}x{size[1]}")
        self.check(scene)
        return self.resolve(scene, settings, device_string())


class SequenceMethod(Method):
    """A method that keeps state from frame to frame. Subclasses implement `_render_frames` instead of `_render`.

    The state belongs to one call of `render_frames`: it begins empty at the first frame asked for, and is a function of the frames
    up to the present one alone, so that a range can be cut short or begun again and gives the same bytes.
    """

    @abstractmethod
    def _render_frames(self, scene: Scene, settings: Any, contexts: Iterable[Context]) -> Iterator[Frame]:
        """Render consecutive frames with resolved settings, each with its own watch."""

    def _render(self, scene: Scene, settings: Any, context: Context) -> Frame:
        return next(iter(self._render_frames(scene, settings, [context])))


def device_string() -> str:
    """Renderer string of this machine's OpenGL device, such as `llvmpipe (LLVM 15.0.6, 256 bits)`; asked once per process."""
    from renderers.gl.device import device_string as ask

    return ask()


_METHODS: dict[str, Method] = {}


def register(method: type[Method]) -> type[Method]:
    """Make a method known by its name. Raises ValueError on a name taken by another class, or on a claim about an unknown need."""
    unknown = set(method.claims) - set(NEEDS)
    if unknown:
        raise ValueError(f"{method.name} claims unknown needs: {sorted(unknown)}")
    if method.name in _METHODS and type(_METHODS[method.name]) is not method:
        raise ValueError(f"method {method.name!r} is registered already")
    _METHODS[method.name] = method()
    return method


def registered_methods() -> dict[str, Method]:
    """All registered methods by name, sorted: those of `renderers.methods` and of the modules that LUXMETER_PLUGINS lists."""
    import renderers.methods as package

    for module in pkgutil.iter_modules(package.__path__):
        importlib.import_module(f"renderers.methods.{module.name}")
    for plugin in os.environ.get("LUXMETER_PLUGINS", "").replace(",", " ").split():
        importlib.import_module(plugin)
    return dict(sorted(_METHODS.items()))


def get_method(name: str) -> Method:
    """The method registered under `name`. Raises UnknownMethod listing the known names."""
    known = registered_methods()
    if name not in known:
        raise UnknownMethod(f"unknown method {name!r}; known: {', '.join(known)}")
    return known[name]
