"""The texels of a hemicube: five faces of a cube around a record, the upper one whole, those at the sides above the horizon.

Texels lie between planes through the record, and the edge between two of them in one such plane. All weights are exact:

    V_p = ∫_p ω dω = ½ Σ_edges φ_e m_e             n·V_p: cosine-weighted solid angle; n × V_p: share of the rotation gradient
    E   = Σ_p n·V_p L_p
    ∇_tE = Σ_e m_e ∫_e n·ω dφ (L_b - L_a) / min(r_a, r_b)
    H    = Σ_e 2 (m_e I_eᵀ + I_e m_eᵀ) (L_b - L_a) / min(r_a, r_b)²,   I_e = ∫_e (n·ω) ω dφ

with m_e the unit normal of an edge's plane, from texel a to texel b, φ_e its angle. A record that moves by δ sees the edge move by
-δ·m_e / r, and the nearer of two surfaces decides (Ward & Heckbert 1992; Schwarzhaupt et al. 2012): the sums of `gradients` with
other cells. Edges on the horizon stay where they are; edges between faces are edges like all others.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from renderers.transport.hemispherical.basis import hemispherical_harmonics
from renderers.transport.hemispherical.quadrature import gauss_legendre

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
NODES = 3
ANGLES = 3

# Of each face, in the frame (tangent, other tangent, normal) of a record: right, up, forward. Sides look along azimuths 0, 90, …
FACES = np.array(
    [[(1, 0, 0), (0, 1, 0), (0, 0, 1)]]
    + [[(-s, c, 0), (0, 0, 1), (c, s, 0)] for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1))],
    np.float64,
)  # fmt: skip


def size_of(samples: int) -> int:
    """Texels along a face's side, even, such that all five have nearest to so many: 3 size². Raises ValueError under 12."""
    if samples < 12:
        raise ValueError(f"a hemicube needs at least 12 samples, got {samples}")
    return 2 * max(1, round(float(np.sqrt(samples / 12))))


class CubeTables(NamedTuple):
    """Constants of a hemicube with P = 3 size² texels and E edges between them, in the frame of a record.

    direction (P, 3): unit, through the centres. cosine, solid (P,): (cosine-weighted) solid angles. turn (P, 2): tangent components
    of n × V. first, second (E,): the texels of an edge. sweep (E, 2): tangent components of m ∫ n·ω dφ. bend (E, 3): elements
    xx, xy, yy of 2 (m Iᵀ + I mᵀ).
    """

    direction: F64
    cosine: F64
    solid: F64
    turn: F64
    first: NDArray[np.int64]
    second: NDArray[np.int64]
    sweep: F64
    bend: F64


class _Edges(NamedTuple):
    """first, second (E,): texels; begin, end (E, 3): unit; across (E, 3): unit, from first to second."""

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    begin: F64
    end: F64
    across: F64


@lru_cache(maxsize=8)
def cube_tables(size: int) -> CubeTables:
    """See `CubeTables`. size: even. Texels are numbered face by face, row by row upwards, x growing to the right."""
    centre, right, up = _texels(size)
    vector = _vector_solid_angles(centre, right, up)
    edges = _edges(size)
    directions, angles = _along(edges)
    cosine = np.einsum("ea,ea->e", angles, directions[..., 2])
    inner = np.einsum("ea,ea,ead->ed", angles, directions[..., 2], directions)
    x, y = edges.across[:, 0], edges.across[:, 1]
    bend = np.stack([4 * x * inner[:, 0], 2 * (x * inner[:, 1] + y * inner[:, 0]), 4 * y * inner[:, 1]], axis=1)
    return CubeTables(
        direction=_unit(centre),
        cosine=np.ascontiguousarray(vector[:, 2]),
        solid=_solid_angles(centre, right, up),
        turn=np.stack([-vector[:, 1], vector[:, 0]], axis=1),
        first=edges.first,
        second=edges.second,
        sweep=edges.across[:, :2] * cosine[:, None],
        bend=bend,
    )


class HarmonicTables(NamedTuple):
    """What hemispherical harmonics of an order n make of a hemicube: inside float32 (n², P): ∫_p H_i dω; sweep float32 (2 n², E):
    tangent components of m ∫ H_i dφ over edges, first all of the first tangent."""

    inside: F32
    sweep: F32


@lru_cache(maxsize=2)
def harmonic_tables(size: int, order: int) -> HarmonicTables:
    """See `HarmonicTables`. Integrals by 3 × 3 points a texel and 3 points an edge of Gauss & Legendre's."""
    centre, right, up = _texels(size)
    nodes, share = gauss_legendre(NODES, -1, 1)
    inside = np.zeros((len(centre), order**2))
    for s, a in zip(nodes, share, strict=True):
        for t, b in zip(nodes, share, strict=True):
            point = centre + s * right + t * up
            reach = np.linalg.norm(point, axis=1)
            # faces at distance 1: dω = dA / q³, texels have half sides 1 / size
            inside += hemispherical_harmonics(point / reach[:, None], order) * (a * b / size**2 / reach**3)[:, None]
    edges = _edges(size)
    directions, angles = _along(edges)
    around = sum(hemispherical_harmonics(directions[:, k], order) * angles[:, k, None] for k in range(ANGLES))
    sweep = np.concatenate([around * edges.across[:, :1], around * edges.across[:, 1:2]], axis=1)
    return HarmonicTables(np.ascontiguousarray(inside.T, np.float32), np.ascontiguousarray(sweep.T, np.float32))


def _texels(size: int) -> tuple[F64, F64, F64]:
    """Centres (P, 3) on the faces at distance 1, and half sides (P, 3) to the right and upwards."""
    if size < 2 or size % 2:
        raise ValueError(f"a hemicube's faces have an even number of texels a side, got {size}")
    across = (np.arange(size) + 0.5) * (2 / size) - 1
    centres, rights, ups = [], [], []
    for index, (right, up, forward) in enumerate(FACES):
        y, x = np.meshgrid(across if index == 0 else across[size // 2 :], across, indexing="ij")
        centres.append((forward + x[..., None] * right + y[..., None] * up).reshape(-1, 3))
        rights.append(np.broadcast_to(right / size, centres[-1].shape))
        ups.append(np.broadcast_to(up / size, centres[-1].shape))
    return np.concatenate(centres), np.concatenate(rights), np.concatenate(ups)


def _edges(size: int) -> _Edges:
    """All edges that two texels share, within faces and between them: those whose middles are one point of the cube."""
    centre, right, up = _texels(size)
    count = len(centre)
    outwards = np.concatenate([right, up, -right, -up])
    along = np.concatenate([up, right, up, right])
    texel = np.tile(np.arange(count), 4)
    middle = centre[texel] + outwards
    # in halves of a texel's side all coordinates are whole
    key = np.round(middle * size).astype(np.int64) + size
    flat = (key[:, 0] * (2 * size + 1) + key[:, 1]) * (2 * size + 1) + key[:, 2]
    order = np.argsort(flat, kind="stable")
    shared = np.flatnonzero(flat[order][1:] == flat[order][:-1])
    one, other = order[shared], order[shared + 1]
    begin, end = _unit(middle[one] - along[one]), _unit(middle[one] + along[one])
    across = _unit(np.cross(begin, end))
    towards = _unit(centre)[texel[other]] - _unit(centre)[texel[one]]
    across *= np.sign(np.einsum("ed,ed->e", across, towards))[:, None]
    return _Edges(texel[one], texel[other], begin, end, across)


def _along(edges: _Edges) -> tuple[F64, F64]:
    """Points of Gauss & Legendre's on the arcs of edges, unit directions (E, A, 3), and their shares of the angle (E, A)."""
    sine = np.linalg.norm(np.cross(edges.begin, edges.end), axis=1)
    angle = np.arctan2(sine, np.einsum("ed,ed->e", edges.begin, edges.end))
    nodes, share = gauss_legendre(ANGLES, 0, 1)
    beside = _unit(edges.end - edges.begin * np.cos(angle)[:, None])
    turned = angle[:, None] * nodes
    directions = np.cos(turned)[..., None] * edges.begin[:, None] + np.sin(turned)[..., None] * beside[:, None]
    return directions, angle[:, None] * share


def _vector_solid_angles(centre: F64, right: F64, up: F64) -> F64:
    """∫ ω dω of texels, (P, 3)."""
    corners = [_unit(centre + a * right + b * up) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    total = np.zeros_like(centre)
    for k in range(4):
        cross = np.cross(corners[k], corners[(k + 1) % 4])
        sine = np.linalg.norm(cross, axis=1)
        angle = np.arctan2(sine, np.einsum("pd,pd->p", corners[k], corners[(k + 1) % 4]))
        total += cross * (angle / (2 * sine))[:, None]
    return total


def _solid_angles(centre: F64, right: F64, up: F64) -> F64:
    """Solid angles of texels (P,), two triangles each (Van Oosterom & Strackee 1983)."""
    a, b, c, d = (_unit(centre + s * right + t * up) for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    return _triangle(a, b, c) + _triangle(a, c, d)


def _triangle(a: F64, b: F64, c: F64) -> F64:
    volume = np.einsum("pd,pd->p", a, np.cross(b, c))
    rest = 1 + np.einsum("pd,pd->p", a, b) + np.einsum("pd,pd->p", b, c) + np.einsum("pd,pd->p", c, a)
    return np.asarray(2 * np.arctan2(np.abs(volume), rest))


def _unit(vectors: F64) -> F64:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
