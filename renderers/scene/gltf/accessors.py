"""Accessors: typed arrays inside buffers (glTF 2.0, 3.6.2), interleaved, sparse or normalised, checked against their buffers.

An accessor without a bufferView is all zeros and may claim any size: MAX_ZEROS bounds it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.scene.gltf.container import Document
from renderers.scene.gltf.element import Element

MAX_ZEROS = 4_000_000
COMPONENTS: dict[int, np.dtype[Any]] = {
    5120: np.dtype("<i1"),
    5121: np.dtype("<u1"),
    5122: np.dtype("<i2"),
    5123: np.dtype("<u2"),
    5125: np.dtype("<u4"),
    5126: np.dtype("<f4"),
}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


class Accessors:
    """All accessors of a document, decoded on demand."""

    def __init__(self, document: Document) -> None:
        self._buffers = document.buffers()
        self._views = document.root.objects("bufferViews")
        self._items = document.root.objects("accessors")

    def __len__(self) -> int:
        return len(self._items)

    def item(self, index: int) -> Element:
        """The JSON of one accessor."""
        return self._items[index]

    def count(self, index: int) -> int:
        """Number of elements that accessor `index` claims (not yet checked against its buffer)."""
        return self._items[index].integer("count", low=1)

    def view(self, index: int) -> memoryview:
        """Bytes of a buffer view."""
        item = self._views[index]
        buffer = item.index("buffer", len(self._buffers), "buffers")
        if buffer is None:
            raise item.error("names no buffer")
        start, length = item.integer("byteOffset", 0), item.integer("byteLength", low=1)
        if start + length > len(self._buffers[buffer]):
            raise item.error(f"{length} bytes from {start} run past the buffer of {len(self._buffers[buffer])}")
        return self._buffers[buffer][start : start + length]

    def view_count(self) -> int:
        """Number of buffer views."""
        return len(self._views)

    def floats(self, index: int, kinds: tuple[str, ...]) -> NDArray[np.float32]:
        """Decoded values float32 (N, width), integers normalised where the accessor says so; `kinds` are the allowed types."""
        raw, item = self._raw(index, kinds), self._items[index]
        if raw.dtype.kind == "f":
            return np.asarray(raw, np.float32).copy()
        if not item.flag("normalized"):
            return np.asarray(raw, np.float32).copy()
        scaled = raw.astype(np.float64) / np.iinfo(raw.dtype).max
        return np.asarray(np.maximum(scaled, -1.0), np.float32)

    def indices(self, index: int) -> NDArray[np.uint32]:
        """Unsigned integers, uint32 (N,)."""
        raw = self._raw(index, ("SCALAR",))
        if raw.dtype.kind != "u":
            raise self._items[index].error("indices must be unsigned integers")
        return np.asarray(raw[:, 0], np.uint32).copy()

    def is_integer(self, index: int) -> bool:
        """Whether the stored components are integers (quantised)."""
        return self._items[index].data.get("componentType") != 5126

    def _raw(self, index: int, kinds: tuple[str, ...]) -> NDArray[Any]:
        item = self._items[index]
        kind = item.choice("type", kinds)
        dtype = COMPONENTS.get(item.integer("componentType"))
        if dtype is None:
            raise item.error("unknown componentType")
        count, width = self.count(index), WIDTHS[kind]
        view = item.index("bufferView", len(self._views), "buffer views")
        if view is None:
            if count > MAX_ZEROS:
                raise item.error(f"count {count} is over the limit of {MAX_ZEROS} without a bufferView")
            values: NDArray[Any] = np.broadcast_to(np.zeros(1, dtype), (count, width))
        else:
            stride = self._views[view].integer("byteStride", 0, high=252)
            values = self._strided(item, view, item.integer("byteOffset", 0), (count, width), dtype, stride)
        return self._patched(item, values, dtype) if item.has("sparse") else values

    def _strided(
        self, item: Element, view: int, start: int, shape: tuple[int, int], dtype: np.dtype[Any], stride: int = 0
    ) -> NDArray[Any]:
        data = self.view(view)
        count, width = shape
        tight = width * dtype.itemsize
        if 0 < stride < tight:
            raise item.error(f"byteStride {stride} is less than the {tight} bytes of an element")
        step = stride or tight
        needed = start + (count - 1) * step + tight
        if needed > len(data):
            raise item.error(f"{count} elements need {needed} bytes, bufferViews[{view}] has {len(data)}")
        return np.ndarray(shape, dtype, data, start, (step, dtype.itemsize))

    def _patched(self, item: Element, values: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
        sparse = item.child("sparse")
        count = sparse.integer("count", low=1, high=len(values))
        parts = []
        for key, width in (("indices", 1), ("values", values.shape[1])):
            part = sparse.child(key)
            view = part.index("bufferView", len(self._views), "buffer views")
            kind = COMPONENTS.get(part.integer("componentType")) if key == "indices" else dtype
            if view is None or kind is None:
                raise part.error("needs a bufferView and a componentType")
            parts.append(self._strided(part, view, part.integer("byteOffset", 0), (count, width), kind))
        where = parts[0][:, 0].astype(np.int64)
        if where.min() < 0 or where.max() >= len(values):
            raise sparse.error(f"index {int(where.max())} is outside the {len(values)} elements")
        patched = values.copy()
        patched[where] = parts[1]
        return patched
