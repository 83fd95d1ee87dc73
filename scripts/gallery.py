"""Contact sheet of every method on a row of scenes: image, matched reference, error map. Look at it after each change.

python scripts/gallery.py --out gallery [--scene S]… [--method M]… [--size 160x90] [--noise 0.02]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from reports.maps import over_2pct_mask

import renderers
import renderers.reference
from renderers.images import display_values

SCENES = ("cornell-box", "cornell-glossy", "colonnade", "bouncing-spheres", "leaves", "gears", "kite", "moving-light")
CAPTION = 14


def panel(rgb8: NDArray[np.uint8], caption: str) -> Image.Image:
    """One picture with a line of text under it."""
    height, width = rgb8.shape[:2]
    sheet = Image.new("RGB", (width, height + CAPTION), "white")
    sheet.paste(Image.fromarray(rgb8), (0, 0))
    ImageDraw.Draw(sheet).text((2, height + 1), caption, fill="black")
    return sheet


def tone(rgb: NDArray[np.float32], exposure: float) -> NDArray[np.uint8]:
    """8-bit sRGB at the scene's exposure."""
    return np.rint(display_values(rgb, exposure)).astype(np.uint8)


def row(name: str, methods: list[str], size: tuple[int, int], noise: float, store: Path) -> list[Image.Image]:
    """Panels of one scene: for each method the image, its matched reference and the over-2 % mask."""
    scene = renderers.load_scene(name)
    full = renderers.reference.render(scene, "full", size, noise, store=store)
    exposure = renderers.reference.exposure(full)
    panels = []
    for key in methods:
        method = renderers.get_method(key)
        settings = method.Settings()
        frame = method.render(scene, settings, size=size)
        transport = method.transport(settings)
        truth = full if transport == "full" else renderers.reference.render(scene, transport, size, noise, store=store)
        mask = over_2pct_mask(frame.layers["beauty"], truth, exposure)
        panels += [
            panel(tone(frame.layers["beauty"], exposure), f"{name} · {key}"),
            panel(tone(truth.image, exposure), transport),
            panel(mask, "over 2 %"),
        ]
    return panels


def main() -> None:
    """Parse the command line and write gallery.png."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("gallery"))
    parser.add_argument("--scene", action="append")
    parser.add_argument("--method", action="append")
    parser.add_argument("--size", default="160x90")
    parser.add_argument("--noise", type=float, default=0.02)
    options = parser.parse_args()
    width, height = (int(n) for n in options.size.split("x"))
    options.out.mkdir(parents=True, exist_ok=True)
    methods = options.method or list(renderers.methods())
    rows = [row(s, methods, (width, height), options.noise, options.out / "references") for s in options.scene or SCENES]
    sheet = Image.new("RGB", (len(rows[0]) * (width + 4), len(rows) * (height + CAPTION + 4)), "white")
    for y, panels in enumerate(rows):
        for x, picture in enumerate(panels):
            sheet.paste(picture, (x * (width + 4), y * (height + CAPTION + 4)))
    sheet.save(options.out / "gallery.png")
    print(options.out / "gallery.png")


if __name__ == "__main__":
    main()
