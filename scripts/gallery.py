"""Contact sheet: a row for each method, and of each scene its image, the matched reference and a map of the signed relative error.

    python scripts/gallery.py --out gallery [--scene S]… [--method M]… [--size 160x90] [--noise 0.02]

Red is too bright, blue too dark, full colour at ±25 %. Look at it after each change: most rendering bugs are visible.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

import renderers
import renderers.reference
from renderers.images import display_values
from reports.metrics import Pair, over_2pct, rmse, signed_relative_error

SCENES = ("cornell-box", "cornell-glossy", "colonnade", "bouncing-spheres", "leaves", "gears", "kite", "moving-light")
CAPTION, GAP = 14, 4
FULL_SCALE = 0.25


def tone(rgb: NDArray[np.float32], exposure: float) -> NDArray[np.uint8]:
    """8-bit sRGB (H, W, 3) at the scene's exposure."""
    return np.rint(display_values(rgb, exposure)).astype(np.uint8)


def diverging(error: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Signed relative error (H, W) as white, towards red where positive and blue where negative, (H, W, 3)."""
    strength = np.clip(np.abs(error) / FULL_SCALE, 0, 1)[..., None]
    hue = np.where((error > 0)[..., None], np.array([178, 24, 43]), np.array([33, 102, 172]))
    return np.rint(255 * (1 - strength) + hue * strength).astype(np.uint8)


def panel(pixels: NDArray[np.uint8], caption: str) -> Image.Image:
    """One picture with a line of text under it."""
    height, width = pixels.shape[:2]
    sheet = Image.new("RGB", (width, height + CAPTION), "white")
    sheet.paste(Image.fromarray(pixels), (0, 0))
    ImageDraw.Draw(sheet).text((2, height + 1), caption, fill="black")
    return sheet


def panels_of(scene_name: str, methods: list[str], size: tuple[int, int], noise: float, store: Path) -> list[Image.Image]:
    """Three panels a method: its image, the reference of its light paths, the error."""
    scene = renderers.load_scene(scene_name)
    full = renderers.reference.render(scene, "full", size, noise, store=store)
    exposure = renderers.reference.exposure(full)
    panels = []
    for key in methods:
        method = renderers.get_method(key)
        try:
            image = method.render(scene, size=size).layers["beauty"]
        except renderers.UnsupportedScene as refusal:
            blank = np.full((size[1], size[0], 3), 238, np.uint8)
            panels += [panel(blank, f"{scene_name} · {key}"), panel(blank, str(refusal)[: size[0] // 6]), panel(blank, "")]
            continue
        transport = method.transport(method.Settings())
        truth = full if transport == "full" else renderers.reference.render(scene, transport, size, noise, store=store)
        pair = Pair(image, truth.image, exposure, truth.luminance_variance, truth.n)
        panels += [
            panel(tone(image, exposure), f"{scene_name} · {key}"),
            panel(tone(truth.image, exposure), transport),
            panel(diverging(signed_relative_error(pair)), f"RMSE {rmse(pair):.1f} · {over_2pct(pair):.0%} over 2 %"),
        ]
    return panels


def main() -> None:
    """Parse the command line and write `gallery.png`."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("gallery"))
    parser.add_argument("--scene", action="append", help="repeatable; built-in name or path")
    parser.add_argument("--method", action="append", help="repeatable; all methods by default")
    parser.add_argument("--size", default="160x90")
    parser.add_argument("--noise", type=float, default=0.02)
    options = parser.parse_args()
    width, height = (int(n) for n in options.size.split("x"))
    methods = options.method or list(renderers.registered_methods())
    options.out.mkdir(parents=True, exist_ok=True)
    scenes = options.scene or SCENES
    step_x, step_y = width + GAP, height + CAPTION + GAP
    sheet = Image.new("RGB", (3 * len(scenes) * step_x, len(methods) * step_y), "white")
    for column, scene in enumerate(scenes):
        panels = panels_of(scene, methods, (width, height), options.noise, options.out / "references")
        for number, picture in enumerate(panels):
            sheet.paste(picture, ((3 * column + number % 3) * step_x, number // 3 * step_y))
        sheet.save(options.out / "gallery.png")
        print(f"{options.out / 'gallery.png'}: {scene}", flush=True)


if __name__ == "__main__":
    main()
