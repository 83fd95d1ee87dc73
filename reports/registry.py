"""Every metric once: id, name, unit, direction, formula, source, function. Tables, plots, docs and the API read this."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from reports import metrics
from reports.metrics import Pair

VERSION = "2"  # part of every comparison's key: raise it when a definition changes

Direction = Literal["lower", "higher", "zero"]
Unit = Literal["0-255", "1", "share"]


@dataclass(frozen=True)
class Metric:
    """One metric. `direction`: which values are better, lower, higher or those nearest to zero; `share` is shown in per cent.

    `function` takes a Pair; `change`, of metrics of sequences, the Pairs of two consecutive frames: the value belongs to the later
    one. `nightly` metrics are too slow for every job.
    """

    id: str
    name: str
    unit: Unit
    direction: Direction
    formula: str
    source: str
    function: Callable[[Pair], float | None] | None
    nightly: bool = False
    change: Callable[[Pair, Pair], float | None] | None = None

    def badness(self, value: float) -> float:
        """A number that is lower for better values, for sorting and for finding the best."""
        return {"lower": value, "higher": -value, "zero": abs(value)}[self.direction]


_2PCT = "Weber-Fechner: contrasts under 1 % are invisible, 2 % in practice (Walter et al., Lightcuts, 2005)"

METRICS: dict[str, Metric] = {
    m.id: m
    for m in (
        Metric(
            "rmse", "RMSE", "0-255", "lower", "sqrt(mean over pixels and channels of (v_t − v_r)²)", "display values", metrics.rmse
        ),
        Metric(
            "ssim",
            "SSIM",
            "1",
            "higher",
            "mean over all pixels of SSIM on luma: Gaussian window σ = 1.5 (11 × 11), data range 255, K₁ = 0.01, K₂ = 0.03",
            "Wang, Bovik, Sheikh, Simoncelli: Image Quality Assessment, IEEE TIP 13(4), 2004",
            metrics.ssim,
        ),
        Metric(
            "over_2pct",
            "Over 2 %",
            "share",
            "lower",
            "share of pixels with |t − r| > 0.02 · max(r, 1) on luma",
            _2PCT,
            metrics.over_2pct,
        ),
        Metric(
            "over_2pct_surely",
            "Surely over 2 %",
            "share",
            "lower",
            "share of pixels over 2 % for every r in the reference's 95 % interval",
            "Student's t with n − 1 degrees of freedom per pixel",
            metrics.over_2pct_surely,
        ),
        Metric(
            "over_2pct_possibly",
            "Possibly over 2 %",
            "share",
            "lower",
            "share of pixels over 2 % for some r in the reference's 95 % interval",
            "Student's t with n − 1 degrees of freedom per pixel",
            metrics.over_2pct_possibly,
        ),
        Metric(
            "over_2pct_linear",
            "Over 2 %, linear",
            "share",
            "lower",
            "share of pixels with |t − r| > 0.02 · max(r, 0.01 · mean r) on linear luminance",
            _2PCT,
            metrics.over_2pct_linear,
        ),
        Metric(
            "rel_mse",
            "Relative MSE",
            "1",
            "lower",
            "mean over pixels and channels of (t − r)² / (r² + 0.01) on linear radiance",
            "the relative squared error of tev and of the denoising literature (Rousselle et al. 2011)",
            metrics.rel_mse,
        ),
        Metric(
            "mean_bias",
            "Mean bias",
            "share",
            "zero",
            "(mean t − mean r) / mean r on linear luminance",
            "signed relative energy",
            metrics.mean_bias,
        ),
        Metric(
            "flip_hdr",
            "HDR-FLIP",
            "1",
            "lower",
            "mean of the HDR-FLIP map over automatic exposures",
            "Andersson, Nilsson, Shirley, Akenine-Möller: Visualizing Errors in Rendered High Dynamic Range Images, 2021",
            metrics.flip_hdr,
            nightly=True,
        ),
        Metric(
            "flicker",
            "Flicker",
            "0-255",
            "lower",
            "mean over pixels of |(t − r)ₖ − (t − r)ₖ₋₁| on luma, frames k and k − 1",
            "frame-to-frame change that the reference doesn't have",
            None,
            change=metrics.flicker,
        ),
        Metric(
            "flicker_linear",
            "Flicker, linear",
            "share",
            "lower",
            "mean over pixels of |(t − r)ₖ − (t − r)ₖ₋₁| on linear luminance, over the mean of r in both frames",
            "frame-to-frame change that the reference doesn't have",
            None,
            change=metrics.flicker_linear,
        ),
        Metric(
            "too_bright",
            "Brighter than truth",
            "0-255",
            "lower",
            "mean over pixels of max(t − r, 0) on luma",
            "signed residual: light that should not be there",
            metrics.too_bright,
        ),
        Metric(
            "too_dark",
            "Darker than truth",
            "0-255",
            "lower",
            "mean over pixels of max(r − t, 0) on luma",
            "signed residual: light that is missing",
            metrics.too_dark,
        ),
        Metric(
            "ghost_bright",
            "Bright ghosts",
            "0-255",
            "lower",
            "mean over revealed pixels of max(t − r, 0) on luma",
            "signed residual behind moving objects: light of an earlier frame that stays",
            metrics.ghost_bright,
        ),
        Metric(
            "ghost_dark",
            "Dark ghosts",
            "0-255",
            "lower",
            "mean over revealed pixels of max(r − t, 0) on luma",
            "signed residual behind moving objects: shadow of an earlier frame that stays",
            metrics.ghost_dark,
        ),
    )
}
