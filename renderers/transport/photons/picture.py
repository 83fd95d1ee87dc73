"""Pictures of a photon map and of the records made of it, seen by the camera: diagnostic layers of the methods that use photons."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.gbuffer import GBuffer
from renderers.scene.world import World
from renderers.transport.photons.tracing import Photons

F32 = NDArray[np.float32]
DEPTH_SLACK = 0.01
DIM = 0.15
PHOTON_CAPTION = (
    "photons that the camera sees, each a dot at its pixel: brightness is the logarithm of how many fell on the pixel, colour that "
    "of their flux"
)
RECORD_CAPTION = (
    "records that the camera sees, each a dot at its pixel, over grey surfaces; blue: the smallest radius R, red: the largest "
    "(logarithmic)"
)


def pixels_of(world: World, gbuffer: GBuffer, position: NDArray[np.floating], normal: NDArray[np.floating]) -> NDArray[np.intp]:
    """Flat pixel index of points (N, 3), or -1 where the camera doesn't see one: outside the picture, turned away or hidden.

    Hidden is what lies more than DEPTH_SLACK of its distance behind the surface seen at that pixel's centre.
    """
    width, height = gbuffer.size
    if not len(position):
        return np.zeros(0, np.intp)
    to = position.astype(np.float64) - gbuffer.eye
    right, up, back = world.camera.pose[:3, :3].T
    depth = -(to @ back)
    tall = np.tan(world.camera.yfov / 2) * np.where(depth > 0, depth, np.inf)
    x = np.floor((1 + to @ right / (tall * width / height)) / 2 * width).astype(np.intp)
    y = np.floor((1 - to @ up / tall) / 2 * height).astype(np.intp)
    inside = (depth > 0) & (x >= 0) & (x < width) & (y >= 0) & (y < height)
    inside &= np.einsum("ij,ij->i", normal.astype(np.float64), to) < 0
    found = np.where(inside, y * width + x, 0)
    first = np.linalg.norm(gbuffer.position.reshape(-1, 3)[found] - gbuffer.eye, axis=1)
    seen = inside & gbuffer.covered.ravel()[found] & (np.linalg.norm(to, axis=1) <= (1 + DEPTH_SLACK) * first)
    return np.where(seen, found, -1)


def photon_picture(world: World, gbuffer: GBuffer, photons: Photons) -> F32:
    """What PHOTON_CAPTION says, float32 (H, W, 3) in 0..1."""
    pixel = pixels_of(world, gbuffer, photons.position, photons.normal)
    seen, count = pixel >= 0, gbuffer.triangle.size
    hits = np.bincount(pixel[seen], minlength=count)
    # of no photons at all, bincount counts integers
    flux = np.stack([np.bincount(pixel[seen], photons.flux[seen, c], count) for c in range(3)], axis=1).astype(np.float64)
    largest = flux.max(axis=1, keepdims=True)
    colour = np.divide(flux, largest, out=np.zeros_like(flux), where=largest > 0)
    brightness = np.log1p(hits) / np.log1p(max(int(hits.max(initial=0)), 1))
    return _image(gbuffer, colour * brightness[:, None])


def record_picture(
    world: World, gbuffer: GBuffer, position: NDArray[np.floating], normal: NDArray[np.floating], radius: NDArray[np.floating]
) -> F32:
    """What RECORD_CAPTION says, float32 (H, W, 3) in 0..1, of records at positions, normals (K, 3) with radii (K,)."""
    view = gbuffer.eye - gbuffer.position.reshape(-1, 3).astype(np.float64)
    view /= np.maximum(np.linalg.norm(view, axis=1, keepdims=True), 1e-12)
    facing = np.einsum("ij,ij->i", gbuffer.normal.reshape(-1, 3), view) * gbuffer.covered.ravel()
    colours = np.repeat(DIM * np.clip(facing, 0, 1)[:, None], 3, axis=1)
    pixel = pixels_of(world, gbuffer, position, normal)
    seen = pixel >= 0
    if seen.any():
        size = np.log(radius.astype(np.float64))
        low, high = size.min(), size.max()
        share = (size[seen] - low) / (high - low) if high > low else np.full(int(seen.sum()), 0.5)
        colours[pixel[seen]] = np.stack([share, 1 - np.abs(2 * share - 1), 1 - share], axis=1)
    return _image(gbuffer, colours)


def _image(gbuffer: GBuffer, colours: NDArray[np.float64]) -> F32:
    return np.clip(colours, 0, 1).astype(np.float32).reshape(*gbuffer.triangle.shape, 3)
