"""The metrics' mathematics: each takes a Pair (test and reference image) and returns one number.

Display values are v = clip(exposure · rgb, 0, 1) through the sRGB curve times 255, not rounded (rounding belongs into PNGs: it
would turn a 0.3 % error into 2 %). Luma is .2126 R' + .7152 G' + .0722 B' of display values, luminance the same weights on linear
radiance.
None stands for "not defined here" (an image too small for SSIM's window, a relative figure against a black reference).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from renderers.images import LUMA, display_values, luminance

Array = NDArray[np.float64]
TOLERANCE = 0.02
SSIM_WINDOW = 11


@dataclass(frozen=True, eq=False)
class Pair:
    """A test and a reference image, linear float (H, W, 3), with the scene's exposure.

    luminance_variance (H, W) is the variance of the reference's mean luminance over `n` replicates; without it the reference
    counts as exact. revealed, bool (H, W), marks pixels whose surface a moving object hid, or the image didn't hold, a few frames
    ago. Raises ValueError where shapes differ, values are not finite, the exposure is not positive or a variance comes without
    n ≥ 2.
    """

    test: NDArray[np.floating]
    reference: NDArray[np.floating]
    exposure: float = 1.0
    luminance_variance: NDArray[np.floating] | None = None
    n: int | None = None
    revealed: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        if self.test.ndim != 3 or self.test.shape[2] != 3 or self.test.shape != self.reference.shape:
            raise ValueError(f"images must both be (H, W, 3), got {self.test.shape} and {self.reference.shape}")
        if not (np.isfinite(self.test).all() and np.isfinite(self.reference).all()):
            raise ValueError("images must be finite")
        if not (np.isfinite(self.exposure) and self.exposure > 0):
            raise ValueError(f"exposure must be positive, got {self.exposure}")
        if self.revealed is not None and (self.revealed.shape != self.reference.shape[:2] or self.revealed.dtype != bool):
            raise ValueError("revealed must be bool (H, W)")
        if self.luminance_variance is not None:
            if self.luminance_variance.shape != self.reference.shape[:2] or not (self.luminance_variance >= 0).all():
                raise ValueError("luminance_variance must be (H, W) and not negative")
            if self.n is None or self.n < 2:
                raise ValueError(f"a variance needs its number of replicates, n >= 2, got {self.n}")

    @cached_property
    def test_display(self) -> Array:
        """Display values of the test image, (H, W, 3), 0..255."""
        return display_values(self.test, self.exposure)

    @cached_property
    def reference_display(self) -> Array:
        """Display values of the reference, (H, W, 3), 0..255."""
        return display_values(self.reference, self.exposure)

    @cached_property
    def test_luma(self) -> Array:
        """Luma of the test image, (H, W), 0..255."""
        return np.asarray(self.test_display @ LUMA)

    @cached_property
    def reference_luma(self) -> Array:
        """Luma of the reference, (H, W), 0..255."""
        return np.asarray(self.reference_display @ LUMA)

    @cached_property
    def test_luminance(self) -> Array:
        """Linear luminance of the test image, (H, W)."""
        return luminance(self.test)

    @cached_property
    def reference_luminance(self) -> Array:
        """Linear luminance of the reference, (H, W)."""
        return luminance(self.reference)

    @cached_property
    def reference_interval(self) -> tuple[Array, Array]:
        """Lower and upper luma (H, W) of the reference: its 95 % interval of luminance, carried through the tone curve.

        The interval of linear luminance Y is Y ± t(0.975, n−1)·sqrt(variance), Student's t. Each end becomes a colour by scaling
        the pixel's rgb, so that its chromaticity stays fixed (grey where the pixel is black), and that colour's luma is the end
        reported.
        """
        if self.luminance_variance is None or self.n is None:
            return self.reference_luma, self.reference_luma
        from scipy import stats

        y = self.reference_luminance
        half = float(stats.t.ppf(0.975, self.n - 1)) * np.sqrt(self.luminance_variance.astype(np.float64))
        ends = [self._luma_at(np.maximum(y - half, 0.0)), self._luma_at(y + half)]
        return np.minimum(ends[0], self.reference_luma), np.maximum(ends[1], self.reference_luma)

    def _luma_at(self, y: Array) -> Array:
        lit = self.reference_luminance > 0
        scale = np.divide(y, self.reference_luminance, out=np.zeros_like(y), where=lit)
        rgb = np.where(lit[..., None], self.reference.astype(np.float64) * scale[..., None], y[..., None])
        return np.asarray(display_values(rgb, self.exposure) @ LUMA)


def rmse(pair: Pair) -> float:
    """Root mean squared difference of display values over all pixels and channels, 0..255."""
    return float(np.sqrt(np.mean((pair.test_display - pair.reference_display) ** 2)))


def ssim(pair: Pair) -> float | None:
    """Structural similarity (Wang 2004) of luma, mean over all pixels, border included; None under 11 pixels a side."""
    from skimage.metrics import structural_similarity

    if min(pair.test.shape[:2]) < SSIM_WINDOW:
        return None
    # The mean that scikit-image returns leaves out a border of 5 pixels; the map does not.
    _, full = structural_similarity(  # type: ignore[no-untyped-call]
        pair.reference_luma,
        pair.test_luma,
        data_range=255,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )
    return float(full.mean())


def _above(t: Array, r: Array) -> NDArray[np.bool_]:
    return np.asarray(t - r > TOLERANCE * np.maximum(r, 1.0))


def _below(t: Array, r: Array) -> NDArray[np.bool_]:
    return np.asarray(r - t > TOLERANCE * np.maximum(r, 1.0))


def over_mask(pair: Pair) -> NDArray[np.bool_]:
    """Pixels (H, W) with |t − r| > 0.02 · max(r, 1) on luma."""
    return _above(pair.test_luma, pair.reference_luma) | _below(pair.test_luma, pair.reference_luma)


def surely_mask(pair: Pair) -> NDArray[np.bool_]:
    """Pixels (H, W) that are over 2 % for every value in the reference's interval.

    r + 0.02·max(r, 1) and r − 0.02·max(r, 1) both grow with r, so the nearer end of the interval decides for the whole of it.
    """
    low, high = pair.reference_interval
    return _above(pair.test_luma, high) | _below(pair.test_luma, low)


def possibly_mask(pair: Pair) -> NDArray[np.bool_]:
    """Pixels (H, W) that are over 2 % for some value in the reference's interval: its farther end decides."""
    low, high = pair.reference_interval
    return _above(pair.test_luma, low) | _below(pair.test_luma, high)


def over_2pct(pair: Pair) -> float:
    """Share of pixels over 2 % on luma, 0..1."""
    return float(over_mask(pair).mean())


def over_2pct_surely(pair: Pair) -> float:
    """Share of pixels over 2 % whatever the reference's noise hides, 0..1."""
    return float(surely_mask(pair).mean())


def over_2pct_possibly(pair: Pair) -> float:
    """Share of pixels that may be over 2 % given the reference's noise, 0..1."""
    return float(possibly_mask(pair).mean())


def over_2pct_linear(pair: Pair) -> float:
    """Share of pixels with |t − r| > 0.02 · max(r, 0.01 · mean r) on linear luminance, 0..1."""
    t, r = pair.test_luminance, pair.reference_luminance
    return float((np.abs(t - r) > TOLERANCE * np.maximum(r, 0.01 * r.mean())).mean())


def rel_mse(pair: Pair) -> float:
    """Mean over pixels and channels of (t − r)² / (r² + 0.01) on linear radiance."""
    t, r = pair.test.astype(np.float64), pair.reference.astype(np.float64)
    return float(np.mean((t - r) ** 2 / (r**2 + 0.01)))


def mean_bias(pair: Pair) -> float | None:
    """Signed relative energy, (mean t − mean r) / mean r on linear luminance; None against a black reference, 0 if both are."""
    t, r = float(pair.test_luminance.mean()), float(pair.reference_luminance.mean())
    if r <= 0.0:
        return 0.0 if t == r else None
    return (t - r) / r


def flip_hdr(pair: Pair) -> float | None:
    """Mean HDR-FLIP (Andersson 2021), 0..1; None against a black reference, from which no exposure range follows."""
    if not (pair.reference_luminance > 0).any():
        return 0.0 if np.array_equal(pair.test, pair.reference) else None
    if np.array_equal(pair.test, pair.reference):
        return 0.0
    import flip_evaluator

    reference, test = (np.ascontiguousarray(image, dtype=np.float32) for image in (pair.reference, pair.test))
    _, mean, _ = flip_evaluator.evaluate(reference, test, "HDR")
    return float(mean)


def too_bright(pair: Pair) -> float:
    """Mean over pixels of max(t − r, 0) on luma, 0..255."""
    return float(_excess(pair, 1).mean())


def too_dark(pair: Pair) -> float:
    """Mean over pixels of max(r − t, 0) on luma, 0..255."""
    return float(_excess(pair, -1).mean())


def ghost_bright(pair: Pair) -> float | None:
    """`too_bright` over the revealed pixels alone; None where the pair doesn't know them or has none."""
    return None if pair.revealed is None or not pair.revealed.any() else float(_excess(pair, 1)[pair.revealed].mean())


def ghost_dark(pair: Pair) -> float | None:
    """`too_dark` over the revealed pixels alone; None where the pair doesn't know them or has none."""
    return None if pair.revealed is None or not pair.revealed.any() else float(_excess(pair, -1)[pair.revealed].mean())


def _excess(pair: Pair, sign: int) -> Array:
    return np.maximum(sign * (pair.test_luma - pair.reference_luma), 0.0)


def flicker(before: Pair, after: Pair) -> float:
    """Mean absolute change of (test − reference) on luma from one frame to the next, 0..255."""
    return float(np.abs((after.test_luma - after.reference_luma) - (before.test_luma - before.reference_luma)).mean())


def flicker_linear(before: Pair, after: Pair) -> float | None:
    """Mean absolute change of (test − reference) on linear luminance over the references' mean; None against black, 0 if all is."""
    change = np.abs((after.test_luminance - after.reference_luminance) - (before.test_luminance - before.reference_luminance))
    level = float(before.reference_luminance.mean() + after.reference_luminance.mean()) / 2
    if level <= 0.0:
        return None if change.any() else 0.0
    return float(change.mean()) / level


def signed_relative_error(pair: Pair) -> NDArray[np.float32]:
    """Map (H, W) of (t − r) / (r + 0.01 · mean r) on linear luminance, float32; 0 where both images are black."""
    t, r = pair.test_luminance, pair.reference_luminance
    floor = r + 0.01 * r.mean()
    # Against an all-black reference every lit pixel is off by the whole of itself: ±1.
    relative: Array = np.divide(t - r, floor, out=np.sign(t - r), where=floor > 0)
    return relative.astype(np.float32)


OK, OVER, UNDECIDED = 0, 1, 2


def over_states(pair: Pair) -> NDArray[np.uint8]:
    """Map (H, W) of OK (0), OVER (1: surely over 2 %) and UNDECIDED (2: the reference's noise can't tell), uint8."""
    states = np.where(possibly_mask(pair), UNDECIDED, OK)
    return np.where(surely_mask(pair), OVER, states).astype(np.uint8)
