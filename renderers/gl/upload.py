"""A World on the GPU: pyrender uploads the triangles, moderngl the tables beside them. Kept for the last few Worlds."""

from __future__ import annotations

import itertools
import weakref
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.gl.context import check, context, device
from renderers.scene.model import Texture
from renderers.scene.world import World

CAPACITY = 4
VERTEX_FLOATS = 8
MATERIAL = np.dtype(
    [
        ("base", "f4", 3),
        ("kind", "i4"),
        ("specular", "f4", 3),
        ("exponent", "f4"),
        ("emission", "f4", 3),
        ("emits_both", "i4"),
        ("metallic", "f4"),
        ("alpha", "f4"),
        ("texture", "i4"),
        ("unused", "i4"),
    ]
)
MATERIALS, TRIANGLE_MATERIAL, VERTICES, INDICES, PAYLOAD = range(5)


@dataclass(frozen=True, eq=False)
class Uploaded:
    """Buffers of one World. `runs`: (first triangle, count, texture index or -1) in triangle order.

    vertices: position, normal, uv, interleaved float32; indices: uint32; both are pyrender's buffers, wrapped. `node`:
    pyrender's node.
    """

    node: Any
    vertices: Any
    indices: Any
    materials: Any
    triangle_material: Any
    textures: tuple[Any, ...]
    runs: tuple[tuple[int, int, int], ...]
    triangles: int

    def bind(self) -> None:
        """Bind the tables that `surface.glsl` and `brdf.glsl` read."""
        self.materials.bind_to_storage_buffer(MATERIALS)
        self.triangle_material.bind_to_storage_buffer(TRIANGLE_MATERIAL)
        self.vertices.bind_to_storage_buffer(VERTICES)
        self.indices.bind_to_storage_buffer(INDICES)

    def vertex_array(self, program: Any, *attributes: str) -> Any:
        """Vertex array of a program that reads some of in_position, in_normal, in_uv (a prefix of them)."""
        widths = {"in_position": 3, "in_normal": 3, "in_uv": 2}
        layout = " ".join(f"{widths[a]}f" for a in attributes)
        rest = VERTEX_FLOATS - sum(widths[a] for a in attributes)
        layout += f" {4 * rest}x" if rest else ""
        return context().vertex_array(
            program, [(self.vertices, layout, *attributes)], index_buffer=self.indices, index_element_size=4
        )  # fmt: skip


_uploads: weakref.WeakKeyDictionary[World, Uploaded] = weakref.WeakKeyDictionary()


def upload(world: World) -> Uploaded:
    """The World's buffers, uploaded on the first call; the last CAPACITY living Worlds are kept."""
    if world not in _uploads:
        while len(_uploads) >= CAPACITY:
            del _uploads[next(iter(_uploads))]
        node = _pyrender_node(world)
        _uploads[world] = _tables(world, node)
    return _uploads[world]


@cache
def _scene() -> Any:
    """The pyrender scene whose meshes are the uploaded Worlds, one node each."""
    return device().pyrender.Scene()


def _pyrender_node(world: World) -> Any:
    """Let pyrender upload the triangles, and delete those of Worlds that are gone.

    A World without triangles gets one of zero area.
    """
    pyrender = device().pyrender
    scene, kept = _scene(), {uploaded.node for uploaded in _uploads.values()}
    for node in set(scene.mesh_nodes) - kept:
        scene.remove_node(node)
    empty = not len(world.triangles)
    primitive = pyrender.Primitive(
        positions=np.zeros((3, 3), np.float32) if empty else world.positions,
        normals=np.zeros((3, 3), np.float32) if empty else world.normals,
        texcoord_0=np.zeros((3, 2), np.float32) if empty else world.uvs,
        indices=np.array([[0, 1, 2]]) if empty else world.triangles,
        material=pyrender.MetallicRoughnessMaterial(),
    )
    node = scene.add(pyrender.Mesh([primitive]))
    device().renderer._update_context(scene, 0)
    return node


def _tables(world: World, node: Any) -> Uploaded:
    ctx = context()
    primitive = node.mesh.primitives[0]
    vertices, _, indices = primitive._buffers
    material = world.material if len(world.material) else np.zeros(1, np.int32)
    uploaded = Uploaded(
        node=node,
        vertices=ctx.external_buffer(vertices, len(primitive.positions) * VERTEX_FLOATS * 4),
        indices=ctx.external_buffer(indices, primitive.indices.size * 4),
        materials=ctx.buffer(material_rows(world).tobytes()),
        triangle_material=ctx.buffer(np.ascontiguousarray(material).tobytes()),
        textures=tuple(_texture(t) for t in world.textures),
        runs=texture_runs(world),
        triangles=len(world.triangles),
    )
    check(ctx, "upload")
    return uploaded


def material_rows(world: World) -> NDArray[Any]:
    """The material table as GLSL's `Material[]` (std430), at least one row."""
    table = world.materials
    rows = np.zeros(max(len(table.kind), 1), MATERIAL)
    for name in MATERIAL.names or ():
        if name != "unused" and len(table.kind):
            rows[name] = getattr(table, name)
    return rows


def texture_runs(world: World) -> tuple[tuple[int, int, int], ...]:
    """Longest runs of triangles with one texture (or none): (first, count, texture index or -1)."""
    if not len(world.triangles):
        return ()
    texture = world.materials.texture[world.material]
    starts = np.concatenate([[0], np.flatnonzero(np.diff(texture)) + 1, [len(texture)]])
    return tuple((int(a), int(b - a), int(texture[a])) for a, b in itertools.pairwise(starts))


def _texture(texture: Texture) -> Any:
    """8-bit texels as stored, row 0 at v = 0. The shader decodes and filters: llvmpipe's sRGB decoding is off by up to 2.5 %."""
    height, width, _ = texture.pixels.shape
    return context().texture((width, height), 3, np.ascontiguousarray(texture.pixels).tobytes(), alignment=1)


@cache
def srgb_table() -> Any:
    """256 × 1 R32F texture: linear value of each sRGB byte."""
    v = np.arange(256) / 255.0
    linear = np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4).astype(np.float32)
    return context().texture((256, 1), 1, linear.tobytes(), dtype="f4")
