"""Embree's tree over triangles, asked with packets of 16 rays.

embreex answers ray after ray. The library it carries answers packets as well, up to three times as many a second where those of a
packet start near each other and go the same way ("coherent"). So the tree is made by the library's own interface (Embree 4 API
reference, rtcIntersect16), in `Packets`; where the library isn't found beside embreex, `Singles` asks embreex. Hits are the same to
the last bit, but for coherent rays through an edge: which of its triangles they hit may depend on others of the packet.
"""

from __future__ import annotations

import ctypes
import weakref
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeAlias

import embreex
import numba
import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

F32 = NDArray[np.float32]
I32 = NDArray[np.int32]
WIDTH = 16
TRIANGLES, ROBUST, INDICES, VERTICES, UINT3, FLOAT3, COHERENT, EVERYTHING = 0, 4, 0, 1, 0x5003, 0x9003, 1 << 16, 0xFFFFFFFF
# Rows of a packet: origin 0-2, nearest 3, direction 4-6, time 7, farthest 8, mask 9, number 10, flags 11, normal 12-14, u 15, v 16,
# triangle 17, mesh 18, instance 19; up to row 23 more is left for what later versions of the library may write. The last row says
# which rays there are. All rows must start on 64-byte boundaries.
NEAREST, DIRECTION, FARTHEST, MASK, U, V, TRIANGLE, MESH, VALID, ROWS = 3, 4, 8, 9, 15, 16, 17, 18, 24, 25
Grid: TypeAlias = tuple[int, int]


class Tree(Protocol):
    """Triangles (T, 3) of vertices (V, 3), to be hit by rays from origins (N, 3) along directions (N, 3), C-contiguous float32."""

    def nearest(self, origins: F32, directions: F32, grid: Grid | None, hits: tuple[I32, F32, F32, F32]) -> None:
        """Put triangle, t, u and v of closest hits where they are nearer than those of `hits` (triangle -1: none yet), (N,) each.

        grid: (rows, columns) of the grids that the rays are, one after the other, in which neighbours are coherent; no packet holds
        rays of two grids. None: they aren't coherent.
        """

    def blocked(self, origins: F32, directions: F32, reach: F32) -> NDArray[np.bool_]:
        """Whether anything lies on origin + s·direction for 0 < s < reach, (N,)."""


def tree_of(vertices: F32, triangles: I32) -> Tree:
    """A tree, built."""
    return Singles(vertices, triangles) if library() is None else Packets(vertices, triangles)


class Library(NamedTuple):
    """Functions of Embree, a device, and addresses of what kernels call."""

    call: Callable[..., Any]
    device: int
    intersect: int
    occluded: int


@cache
def library() -> Library | None:
    """The library that embreex carries, loaded once; None where it isn't found."""
    home = Path(embreex.__file__).parent
    for path in sorted((*home.parent.glob("embreex.libs/libembree4*"), *home.glob(".dylibs/libembree4*"))):
        loaded = ctypes.CDLL(str(path))
        address = [ctypes.cast(getattr(loaded, name), ctypes.c_void_p).value for name in ("rtcIntersect16", "rtcOccluded16")]

        def call(name: str, *arguments: Any, of: ctypes.CDLL = loaded) -> Any:
            function = getattr(of, name)
            function.restype = ctypes.c_void_p
            return function(*arguments)

        device = call("rtcNewDevice", None)
        if device and all(address):
            return Library(call, device, address[0] or 0, address[1] or 0)
    return None


class Packets:
    """`Tree` by packets. Raises RuntimeError where the library isn't found."""

    def __init__(self, vertices: F32, triangles: I32) -> None:
        found = library()
        if found is None:
            raise RuntimeError("Embree's library isn't beside embreex")
        self._library = found
        call, pointer = found.call, ctypes.c_void_p
        scene, mesh = call("rtcNewScene", pointer(found.device)), call("rtcNewGeometry", pointer(found.device), TRIANGLES)
        self._scene = int(scene)
        weakref.finalize(self, call, "rtcReleaseScene", pointer(scene)).atexit = False
        call("rtcSetSceneFlags", pointer(scene), ROBUST)
        for kind, layout, values in ((VERTICES, FLOAT3, vertices), (INDICES, UINT3, triangles)):
            rows, size = len(values), ctypes.c_size_t
            buffer = call("rtcSetNewGeometryBuffer", pointer(mesh), kind, 0, layout, size(12), size(rows))
            ctypes.memmove(buffer, np.ascontiguousarray(values).ctypes.data, values.nbytes)
        call("rtcCommitGeometry", pointer(mesh))
        call("rtcAttachGeometry", pointer(scene), pointer(mesh))
        call("rtcReleaseGeometry", pointer(mesh))
        call("rtcCommitScene", pointer(scene))

    def nearest(self, origins: F32, directions: F32, grid: Grid | None, hits: tuple[I32, F32, F32, F32]) -> None:
        """See `Tree`."""
        flags, shape = (0, (1, max(1, len(origins)))) if grid is None else (COHERENT, grid)
        _nearest(self._library.intersect, self._scene, flags, origins, directions, (shape[0], shape[1]), tuple(hits))

    def blocked(self, origins: F32, directions: F32, reach: F32) -> NDArray[np.bool_]:
        """See `Tree`."""
        out = np.empty(len(origins), np.bool_)
        _blocked(self._library.occluded, self._scene, origins, directions, reach, out)
        return out


class Singles:
    """`Tree` by embreex, ray by ray."""

    def __init__(self, vertices: F32, triangles: I32) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene = EmbreeScene(robust=True)
        self._mesh = TriangleMesh(self._scene, np.ascontiguousarray(vertices), np.ascontiguousarray(triangles))
        # Embree builds the tree when the first ray comes; it belongs to the preparation, not to the pass of that ray
        ray = np.ones((1, 3), np.float32)
        self.blocked(ray, ray, np.ones(1, np.float32))

    def nearest(self, origins: F32, directions: F32, grid: Grid | None, hits: tuple[I32, F32, F32, F32]) -> None:
        """See `Tree`."""
        found = self._scene.run(origins, directions, output=1)
        number = found["primID"]
        nearer = (number >= 0) & ((hits[0] < 0) | (found["tfar"] < hits[1]))
        for target, name in zip(hits, ("primID", "tfar", "u", "v"), strict=True):
            target[nearer] = found[name][nearer]

    def blocked(self, origins: F32, directions: F32, reach: F32) -> NDArray[np.bool_]:
        """See `Tree`."""
        if not len(origins):
            return np.zeros(0, bool)
        return np.asarray(self._scene.run(origins, directions, reach, query="OCCLUDED") == 0)


def _c_call(typing, function, valid, scene, packet, arguments):  # type: ignore[no-untyped-def]
    """Call a C function of four pointers by its address; all are given as integers."""

    def generate(context, builder, signature, values):  # type: ignore[no-untyped-def]
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer] * 4)
        builder.call(builder.inttoptr(values[0], kind.as_pointer()), [builder.inttoptr(value, pointer) for value in values[1:]])
        return context.get_dummy_value()

    return types.void(*[types.intp] * 5), generate


_call: Any = intrinsic(_c_call)


@numba.njit(inline="always")
def _prepared(flags):  # type: ignore[no-untyped-def]
    """A packet (ROWS, WIDTH) on a 64-byte boundary, and the query's flags."""
    memory = np.zeros((ROWS + 1) * WIDTH, np.float32)
    start = (64 - memory.ctypes.data % 64) % 64 // 4
    packet = memory[start : start + ROWS * WIDTH].reshape(ROWS, WIDTH)
    arguments = np.zeros(8, np.uint64)
    arguments[0] = np.uint64(flags) | (np.uint64(EVERYTHING) << np.uint64(32))
    return packet, packet.view(np.int32), arguments


@numba.njit(inline="always")
def _load(packet, words, i, origins, directions, ray):  # type: ignore[no-untyped-def]
    """Put a ray into a place of the packet."""
    for c in range(3):
        packet[c, i] = origins[ray, c]
        packet[DIRECTION + c, i] = directions[ray, c]
    packet[NEAREST, i] = 0
    words[MASK, i] = words[VALID, i] = -1


@numba.njit(nogil=True, cache=True)
def _nearest(function, scene, flags, origins, directions, grid, hits):  # type: ignore[no-untyped-def]
    """Packets are tiles of 4 × 4 neighbours, or 1 × 16 where a grid has one row."""
    triangle, t, u, v = hits
    packet, words, arguments = _prepared(flags)
    rays = np.empty(WIDTH, np.int64)
    rows, columns = grid
    tall = 4 if rows > 1 else 1
    wide = WIDTH // tall
    for first in range(0, len(origins), rows * columns):
        for top in range(0, rows, tall):
            for left in range(0, columns, wide):
                count = 0
                for row in range(top, min(top + tall, rows)):
                    start = first + row * columns
                    for ray in range(start + left, min(start + min(left + wide, columns), len(origins))):
                        rays[count] = ray
                        _load(packet, words, count, origins, directions, ray)
                        packet[FARTHEST, count] = np.inf
                        words[TRIANGLE, count] = words[MESH, count] = -1
                        count += 1
                for i in range(count, WIDTH):
                    words[VALID, i] = 0
                _call(function, words[VALID].ctypes.data, scene, packet.ctypes.data, arguments.ctypes.data)
                for i in range(count):
                    ray = rays[i]
                    if words[MESH, i] != -1 and (triangle[ray] < 0 or packet[FARTHEST, i] < t[ray]):
                        triangle[ray], t[ray] = words[TRIANGLE, i], packet[FARTHEST, i]
                        u[ray], v[ray] = packet[U, i], packet[V, i]


@numba.njit(nogil=True, cache=True)
def _blocked(function, scene, origins, directions, reach, out):  # type: ignore[no-untyped-def]
    packet, words, arguments = _prepared(0)
    for start in range(0, len(origins), WIDTH):
        count = min(WIDTH, len(origins) - start)
        for i in range(count):
            _load(packet, words, i, origins, directions, start + i)
            packet[FARTHEST, i] = reach[start + i]
        for i in range(count, WIDTH):
            words[VALID, i] = 0
        _call(function, words[VALID].ctypes.data, scene, packet.ctypes.data, arguments.ctypes.data)
        for i in range(count):
            out[start + i] = packet[FARTHEST, i] < 0
