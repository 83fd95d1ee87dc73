"""Typed, range-checked access into the JSON of a file that nobody vouches for.

Every getter either returns a value of the asked type and range or raises a SceneError of one line: `<file>: <element>: <reason>`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from renderers.scene.model import SceneError


@dataclass(frozen=True)
class Element:
    """One JSON object of a document: `file` and `where` name it in messages, `data` is its content."""

    file: str
    where: str
    data: dict[str, Any]

    def error(self, reason: str) -> SceneError:
        """The refusal of this element; raise it."""
        return SceneError(f"{self.file}: {self.where}: {reason}")

    def has(self, key: str) -> bool:
        """Whether the element says anything under `key`."""
        return key in self.data

    def child(self, key: str) -> Element:
        """The object under `key`; an absent one is empty."""
        value = self.data.get(key, {})
        if not isinstance(value, dict):
            raise self.error(f"{key} must be an object")
        return Element(self.file, f"{self.where} {key}", value)

    def extension(self, name: str) -> Element | None:
        """The extension object called `name`, or None."""
        extensions = self.child("extensions")
        return extensions.child(name) if extensions.has(name) else None

    def objects(self, key: str) -> list[Element]:
        """The array of objects under `key`, each named by its index and its own name; absent means empty."""
        prefix = "" if self.where == "glTF" else f"{self.where} "
        found = []
        for index, value in enumerate(self.array(key)):
            if not isinstance(value, dict):
                raise self.error(f"{key}[{index}] must be an object")
            name = value.get("name")
            label = f" {quoted(name)}" if isinstance(name, str) and name else ""
            found.append(Element(self.file, f"{prefix}{key}[{index}]{label}", value))
        return found

    def array(self, key: str) -> list[Any]:
        """The array under `key`; absent means empty."""
        value = self.data.get(key, [])
        if not isinstance(value, list):
            raise self.error(f"{key} must be an array")
        return value

    def number(
        self, key: str, default: float | None = None, low: float = -math.inf, high: float = math.inf, *, above: bool = False
    ) -> float:
        """A finite number in [low, high] ((low, high) with `above`); required without a default."""
        if key not in self.data and default is not None:
            return default
        return self._number(key, self.data.get(key), low, high, above)

    def numbers(
        self, key: str, length: int, default: Sequence[float] | None = None, low: float = -math.inf, high: float = math.inf
    ) -> tuple[float, ...]:
        """`length` finite numbers in [low, high]."""
        if key not in self.data and default is not None:
            return tuple(default)
        values = self.array(key)
        if len(values) != length:
            raise self.error(f"{key} must have {length} numbers")
        return tuple(self._number(key, v, low, high) for v in values)

    def integer(self, key: str, default: int | None = None, low: int = 0, high: int = 2**53) -> int:
        """An integer in [low, high]; 3.0 counts as 3."""
        value = self.data.get(key, default)
        whole = isinstance(value, int) or (isinstance(value, float) and value.is_integer())
        if isinstance(value, bool) or value is None or not whole or not low <= value <= high:
            raise self.error(f"{key} must be an integer of {low} to {high}, got {quoted(value)}")
        return int(value)

    def index(self, key: str, count: int, of: str) -> int | None:
        """A reference into an array of `count` elements called `of`; None when absent."""
        if key not in self.data:
            return None
        value = self.data[key]
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < count:
            raise self.error(f"{key} {quoted(value)} names none of the {count} {of}")
        return value

    def indices(self, key: str, count: int, of: str) -> list[int]:
        """An array of references into `count` elements called `of`."""
        found = self.array(key)
        for value in found:
            if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < count:
                raise self.error(f"{key} {quoted(value)} names none of the {count} {of}")
        return found

    def text(self, key: str, default: str = "") -> str:
        """A string that can be encoded as UTF-8 (lone surrogates become question marks)."""
        value = self.data.get(key, default)
        if not isinstance(value, str):
            raise self.error(f"{key} must be a string")
        return value.encode("utf-8", "replace").decode("utf-8")

    def choice(self, key: str, options: Sequence[str], default: str | None = None) -> str:
        """One of `options`."""
        value = self.data.get(key, default)
        if value not in options:
            raise self.error(f"{key} must be one of {', '.join(options)}, got {quoted(value)}")
        return str(value)

    def flag(self, key: str) -> bool:
        """A boolean, false when absent."""
        value = self.data.get(key, False)
        if not isinstance(value, bool):
            raise self.error(f"{key} must be true or false")
        return value

    def _number(self, key: str, value: object, low: float, high: float, above: bool = False) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > 1.7e308:
            raise self.error(f"{key} must be a finite number, got {quoted(value)}")
        inside = low < value < high if above else low <= value <= high
        if not inside:
            ends = "()" if above else "[]"
            raise self.error(f"{key} must lie in {ends[0]}{low:g}, {high:g}{ends[1]}, got {quoted(value)}")
        return float(value)


def quoted(value: object) -> str:
    """`value` as one printable line of at most 48 characters."""
    line = ascii(value) if not isinstance(value, str) else repr(value)
    return line if len(line) <= 48 else line[:44] + " ..."
