"""`extras.luxmeter`: what glTF can't say, beside a glTF approximation of it. The format is described in docs/scenes.md.

Foreign extras are kept as compact JSON text in the `extras` field of what they belong to, and written back.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.scene.gltf.accessors import Accessors
from renderers.scene.gltf.element import Element
from renderers.scene.model import SceneError

KEY, VERSION = "luxmeter", 1
DTYPES: dict[str, np.dtype[Any]] = {"float32": np.dtype("<f4"), "float64": np.dtype("<f8")}


def own_extras(element: Element) -> Element | None:
    """The `extras.luxmeter` object of an element, or None. Raises SceneError for a version that isn't ours."""
    extras = element.data.get("extras")
    if not isinstance(extras, dict) or KEY not in extras:
        return None
    own = Element(element.file, f"{element.where} extras", extras).child(KEY)
    if own.integer("version") != VERSION:
        raise own.error(f"version {own.data['version']} is not supported, only {VERSION}")
    return own


def foreign_extras(element: Element) -> str:
    """The element's extras without ours, as compact JSON text; '' where there are none."""
    extras = element.data.get("extras")
    if extras is None:
        return ""
    if isinstance(extras, dict):
        own = extras.get(KEY)
        wrapped = own.get("extras") if isinstance(own, dict) else None
        rest = {k: v for k, v in extras.items() if k != KEY}
        if wrapped is not None or (not rest and KEY in extras):
            return "" if wrapped is None else compact(wrapped)
        extras = rest
    return compact(extras)


def compact(value: object) -> str:
    """JSON text in one spelling: no spaces, ASCII only."""
    return json.dumps(value, separators=(",", ":"))


def put_extras(data: dict[str, Any], text: str, own: dict[str, Any] | None = None, where: str = "element") -> dict[str, Any]:
    """`data` with foreign extras `text` and our own content; foreign extras that are no object go inside ours."""
    extras: Any = None
    if text:
        try:
            extras = json.loads(text)
        except ValueError:
            raise SceneError(f"{where}: extras: must be JSON text") from None
    if own is None:
        return data if extras is None else {**data, "extras": extras}
    marked = {"version": VERSION, **own}
    if extras is None:
        return {**data, "extras": {KEY: marked}}
    # an empty object or one with our key would not come back as it was if it were merged
    if isinstance(extras, dict) and extras and KEY not in extras:
        return {**data, "extras": {**extras, KEY: marked}}
    return {**data, "extras": {KEY: {**marked, "extras": extras}}}


def read_array(own: Element, key: str, accessors: Accessors, ndim: int) -> NDArray[Any]:
    """A raw little-endian array {"bufferView", "type", "shape"} that `write_array` of the writer stored under `key`."""
    item = own.child(key)
    dtype = DTYPES[item.choice("type", tuple(DTYPES))]
    shape = item.array("shape")
    if len(shape) != ndim or any(isinstance(n, bool) or not isinstance(n, int) or not 0 < n < 2**31 for n in shape):
        raise item.error(f"shape must be {ndim} positive integers")
    view = item.index("bufferView", accessors.view_count(), "buffer views")
    data = accessors.view(view) if view is not None else memoryview(b"")
    size = dtype.itemsize
    for n in shape:
        size *= n
    if size != len(data):
        raise item.error(f"shape needs {size} bytes, its bufferView has {len(data)}")
    values: NDArray[Any] = np.frombuffer(data, dtype).reshape(shape).copy()
    if not np.isfinite(values).all():
        raise item.error("holds values that are not finite")
    return values
