"""The photon map: photons in kd-tree order, ready for neighbour queries; saved as Parquet or EXR for inspection."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.images import write_exr
from renderers.scene.world import World
from renderers.transport.photons.surface import UNMEASURED, Surface
from renderers.transport.photons.tracing import Photons, Traced
from renderers.transport.photons.tree import Tree, build

EXR_WIDTH = 1024


@dataclass(frozen=True, eq=False)
class PhotonMap:
    """Photons in tree order. order int64 (N,): row of each in tracing order; emitted: N_e; flux (3,): emitted, W.

    surface: points that measure area, where records are to be made on curved surfaces.
    """

    photons: Photons
    tree: Tree
    order: NDArray[np.int64]
    emitted: int
    flux: NDArray[np.float64]
    notes: tuple[str, ...] = ()
    surface: Surface = UNMEASURED

    def __len__(self) -> int:
        """Number of photons."""
        return len(self.photons)

    @cached_property
    def bytes(self) -> int:
        """Memory of photons, tree and surface points."""
        points = self.surface.tree
        columns = (
            *self.photons, self.order, self.tree.axis, self.tree.value,
            points.axis, points.value, points.positions, points.normals,
        )  # fmt: skip
        return int(sum(column.nbytes for column in columns))

    def columns(self, world: World) -> dict[str, NDArray[Any]]:
        """The photons in tracing order, lengths and fluxes in the scene's units (metres, W).

        position, direction, flux, normal float32 (N, 3), distance float32 (N,), bounce int16 (N,), triangle int32 (N,).
        """
        p = self.photons.rows(np.argsort(self.order))
        # lengths shrink by `scale`, intensities by scale²: flux in the World is scale² that of the scene
        floats: dict[str, NDArray[Any]] = {
            "position": p.position / world.scale + world.centre,
            "direction": p.direction,
            "flux": p.flux / world.scale**2,
            "normal": p.normal,
            "distance": p.distance / world.scale,
        }
        return {name: column.astype(np.float32) for name, column in floats.items()} | {"bounce": p.bounce, "triangle": p.triangle}

    def save(self, path: Path | str, world: World) -> None:
        """Write `columns` for inspection, by the ending of the path; raises ValueError for any but these two.

        .parquet: a row a photon, vectors as three columns `position_x` …; .exr: a pixel a photon, row by row of an image EXR_WIDTH
        wide, layers of the same names (integers as floats, exact below 2²⁴), zeros after the last.
        """
        ending = Path(path).suffix.lower()
        if ending == ".parquet":
            self._save_parquet(path, self.columns(world))
        elif ending == ".exr":
            self._save_exr(path, self.columns(world))
        else:
            raise ValueError(f"photons are saved as .parquet or .exr, got {ending!r}")

    def _save_parquet(self, path: Path | str, columns: dict[str, NDArray[Any]]) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        table: dict[str, Any] = {}
        for name, column in columns.items():
            table |= {name: column} if column.ndim == 1 else {f"{name}_{c}": column[:, k] for k, c in enumerate("xyz")}
        about = {"luxmeter:emitted": str(self.emitted)}
        pq.write_table(pa.table(table).replace_schema_metadata(about), str(path), compression="zstd")

    def _save_exr(self, path: Path | str, columns: dict[str, NDArray[Any]]) -> None:
        rows = max(1, -(-len(self) // EXR_WIDTH))
        layers: dict[str, NDArray[np.float32]] = {}
        for name, column in columns.items():
            layer = np.zeros((rows * EXR_WIDTH, *column.shape[1:]), np.float32)
            layer[: len(self)] = column
            layers[name] = layer.reshape(rows, EXR_WIDTH, *column.shape[1:])
        write_exr(path, layers, emitted=str(self.emitted), stored=str(len(self)))


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
