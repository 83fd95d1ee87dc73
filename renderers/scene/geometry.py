"""Clean triangles: what every file reader does before a Mesh is made of what it found.

Zero-area and duplicate triangles are dropped, unusable normals are computed anew from the faces, each with a count; indices that
point nowhere and positions that are no numbers are for the caller to refuse.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
U32 = NDArray[np.uint32]
# A triangle lower than this share of its longest edge is a line: float32 can't tell its corners from collinear points.
SLIVER = 2.0**-23
# Normals this close to length 1 are kept as they are (float rounding of exporters), others are scaled.
UNIT_TOLERANCE = 1e-3


@dataclass(frozen=True)
class Findings:
    """Counts of what `cleaned` met and did."""

    zero_area: int = 0
    duplicates: int = 0
    missing_normals: int = 0
    bad_normals: int = 0
    scaled_normals: int = 0
    against_winding: int = 0


def cleaned(
    positions: F32, normals: F32 | None, triangles: U32, uvs: F32 | None = None
) -> tuple[F32, F32, U32, F32 | None, Findings]:
    """(positions, normals, triangles, uvs, findings) without zero-area and duplicate triangles, with a unit normal at every vertex.

    Without normals, each triangle gets vertices and a flat normal of its own. positions must be finite, indices within them.
    """
    solid = triangles[~degenerate(positions, triangles)]
    kept = solid[first_of_each(positions, solid)]
    counts = {"zero_area": len(triangles) - len(solid), "duplicates": len(solid) - len(kept)}
    if normals is None:
        flat = np.repeat(_unit(crosses(positions, kept)), 3, axis=0).astype(np.float32)
        corners = kept.reshape(-1)
        own = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
        return positions[corners], flat, own, None if uvs is None else uvs[corners], Findings(**counts, missing_normals=len(kept))
    normals, bad, scaled = usable_normals(positions, normals, kept)
    against = int(np.count_nonzero(np.sum(crosses(positions, kept) * normals[kept].astype(np.float64).sum(axis=1), axis=1) < 0))
    found = Findings(**counts, bad_normals=bad, scaled_normals=scaled, against_winding=against)
    return positions, normals, kept, uvs, found


def crosses(positions: F32, triangles: NDArray[np.integer]) -> F64:
    """Edge cross products float64 (T, 3): twice the area along the geometric normal."""
    p = positions[triangles].astype(np.float64)
    return np.asarray(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]))


def degenerate(positions: F32, triangles: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Which triangles have no area to float32 precision, bool (T,)."""
    p = positions[triangles].astype(np.float64)
    edges = p - np.roll(p, 1, axis=1)
    longest = np.sum(edges * edges, axis=-1).max(axis=1, initial=0.0)
    return np.asarray(np.linalg.norm(np.cross(edges[:, 1], edges[:, 2]), axis=-1) <= SLIVER * longest)


def first_of_each(positions: F32, triangles: U32) -> NDArray[np.intp]:
    """Rows of the first of all triangles with the same three corners in the same turn, ascending, int (K,).

    Corners are compared by position, so copied vertices don't hide a copied face: light on a doubled face must not double.
    """
    # + 0.0 turns -0 into 0, so that equal numbers have equal bytes
    welded = _labels(positions + np.float32(0))[triangles]
    start = np.argmin(welded, axis=1)
    turned = np.take_along_axis(welded, (start[:, None] + np.arange(3)) % 3, axis=1)
    return np.flatnonzero(_labels(turned, first=True) == np.arange(len(turned)))


def _labels(rows: NDArray[np.generic], *, first: bool = False) -> NDArray[np.intp]:
    """Equal rows get equal numbers; with `first`, the number is the first such row."""
    order = np.lexsort(rows.T[::-1])
    ordered = rows[order]
    new = np.ones(len(rows), bool)
    new[1:] = np.any(ordered[1:] != ordered[:-1], axis=1)
    group = np.cumsum(new) - 1
    labels = np.empty(len(rows), np.intp)
    # lexsort is stable: the first of a group in sorted order is the first in the array
    labels[order] = order[np.flatnonzero(new)][group] if first else group
    return labels


def usable_normals(positions: F32, normals: F32, triangles: U32) -> tuple[F32, int, int]:
    """(unit normals, number computed anew, number scaled). NaN, infinite and zero ones are computed from the faces around."""
    lengths = np.linalg.norm(normals.astype(np.float64), axis=1)
    bad = ~np.isfinite(lengths) | (lengths < 1e-12)
    scaled = ~bad & (np.abs(lengths - 1) > UNIT_TOLERANCE)
    if not bad.any() and not scaled.any():
        return normals, 0, 0
    fixed = normals.astype(np.float64)
    fixed[scaled] /= lengths[scaled, None]
    if bad.any():
        smooth = np.zeros(fixed.shape)
        np.add.at(smooth, triangles.reshape(-1), np.repeat(crosses(positions, triangles), 3, axis=0))
        fixed[bad] = _unit(smooth[bad])
    return fixed.astype(np.float32), int(bad.sum()), int(scaled.sum())


def _unit(vectors: F64) -> F64:
    """Unit vectors (N, 3); zero ones, of vertices without faces, become +Y."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1.0), [0.0, 1.0, 0.0])
