"""Trace a scene's photons and save them.

Run: `python -m scripts.photons SCENE --out photons.parquet [--photons N] [--seed N] [--direct]`.
The ending chooses the format, .parquet or .exr (`renderers.transport.photons.map.PhotonMap.save`). They are the photons that
`photon-map` and `pmic` with the same number and seed use; `--direct` keeps those straight from a light as well.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import renderers
from renderers.transport.photons.map import photon_map
from renderers.transport.photons.tracing import trace


def main() -> None:
    """Trace, save, say how many."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--photons", type=int, default=400_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--direct", action="store_true")
    arguments = parser.parse_args()
    world = renderers.load_scene(arguments.scene).world()
    photons = photon_map(trace(world, arguments.photons, arguments.seed, arguments.direct))
    photons.save(arguments.out, world)
    print(f"{arguments.out}: {len(photons)} photons of {photons.emitted} emitted")


if __name__ == "__main__":
    main()
