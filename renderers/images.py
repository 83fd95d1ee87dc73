"""Images on disk: float EXR with named layers, and tone-mapped PNG. Also the one tone curve (exposure, then sRGB)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

LUMA = np.array([0.2126, 0.7152, 0.0722])


def luminance(rgb: NDArray[np.floating]) -> NDArray[np.float64]:
    """Relative luminance of linear Rec.709 RGB (..., 3), float64 (...)."""
    return np.asarray(rgb.astype(np.float64) @ LUMA)


def display_values(rgb: NDArray[np.floating], exposure: float) -> NDArray[np.float64]:
    """clip(exposure · rgb, 0, 1) through the sRGB curve, times 255, not rounded: float64, same shape."""
    v = np.clip(rgb.astype(np.float64) * exposure, 0.0, 1.0)
    return np.asarray(np.where(v <= 0.0031308, 12.92 * v, 1.055 * np.power(v, 1 / 2.4) - 0.055) * 255.0)


def write_png(path: Path | str, rgb: NDArray[np.floating], exposure: float) -> None:
    """Write a linear image (H, W, 3) as an 8-bit sRGB PNG."""
    from PIL import Image

    Image.fromarray(np.rint(display_values(rgb, exposure)).astype(np.uint8)).save(path)


def write_exr(path: Path | str, layers: Mapping[str, NDArray[np.float32]], default: str | None = None, **attributes: str) -> None:
    """Write float32 layers (H, W, 3) as channels `name.R/G/B` and (H, W) as `name.Y`; `default` is repeated as plain R, G, B.

    Attributes are kept in the header as `luxmeter:<name>`. ZIP compression, one scan-line part; byte-equal for equal input.
    """
    import OpenEXR

    channels: dict[str, NDArray[np.float32]] = {}
    for name, layer in layers.items():
        if layer.ndim == 2:
            channels[f"{name}.Y"] = np.ascontiguousarray(layer)
        else:
            channels |= {f"{name}.{c}": np.ascontiguousarray(layer[..., k]) for k, c in enumerate("RGB")}
    if default is not None:
        channels |= {c: np.ascontiguousarray(layers[default][..., k]) for k, c in enumerate("RGB")}
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    header |= {f"luxmeter:{k}": v for k, v in attributes.items()}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def read_exr(path: Path | str) -> tuple[dict[str, NDArray[np.float32]], dict[str, str]]:
    """Layers and luxmeter attributes of a file written by `write_exr` (plain R, G, B come back as layer '')."""
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = {name: channel.pixels for name, channel in file.channels().items()}
        header = dict(file.header())  # closing the file empties the original
    attributes = {k.split(":", 1)[1]: v for k, v in header.items() if k.startswith("luxmeter:")}
    layers: dict[str, NDArray[np.float32]] = {}
    for name in channels:
        base, _, last = name.rpartition(".")
        if last == "Y":
            layers[base] = channels[name]
        elif last == "R":
            prefix = f"{base}." if base else ""
            layers[base] = np.stack([channels[prefix + c] for c in "RGB"], axis=-1)
    return layers, attributes
