"""The photon map: photons in kd-tree order, ready for neighbour queries; saved as Parquet for inspection."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.scene.world import World
from renderers.transport.photons.tracing import Photons, Traced
from renderers.transport.photons.tree import Tree, build


@dataclass(frozen=True, eq=False)
class PhotonMap:
    """Photons in tree order. order int64 (N,): row of each in tracing order; emitted: N_e; flux (3,): emitted, W."""

    photons: Photons
    tree: Tree
    order: NDArray[np.int64]
    emitted: int
    flux: NDArray[np.float64]
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Number of photons."""
        return len(self.photons)

    @cached_property
    def bytes(self) -> int:
        """Memory of photons and tree."""
        columns = (*self.photons, self.order, self.tree.axis, self.tree.value)
        return int(sum(column.nbytes for column in columns))

    def save(self, path: Path | str, world: World) -> None:
        """Write the photons in tracing order as Parquet, positions, distances and fluxes in the scene's units (metres, W)."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        rows = np.argsort(self.order)
        p = self.photons.rows(rows)
        metres = p.position / world.scale + world.centre
        # lengths shrink by `scale`, intensities by scale²: flux in the World is scale² that of the scene
        vectors: dict[str, NDArray[Any]] = {
            "position": metres,
            "direction": p.direction,
            "flux": p.flux / world.scale**2,
            "normal": p.normal,
        }
        table: dict[str, Any] = {
            f"{name}_{c}": v[:, k].astype(np.float32) for name, v in vectors.items() for k, c in enumerate("xyz")
        }
        table |= {"distance": (p.distance / world.scale).astype(np.float32), "bounce": p.bounce, "triangle": p.triangle}
        about = {"luxmeter:emitted": str(self.emitted)}
        pq.write_table(pa.table(table).replace_schema_metadata(about), str(path), compression="zstd")


def photon_map(traced: Traced) -> PhotonMap:
    """Build the kd-tree over traced photons."""
    axis, value, levels, order = build(traced.photons.position)
    photons = traced.photons.rows(order)
    notes = []
    if traced.capped:
        notes.append(f"{traced.capped} photon paths were cut at the bounce limit: surfaces absorb almost nothing")
    if traced.full:
        notes.append(f"the photon map is full: tracing ended after {traced.emitted} emitted photons")
    tree = Tree(axis, value, levels, photons.position, photons.normal)
    return PhotonMap(photons, tree, order, traced.emitted, traced.flux, tuple(notes))
