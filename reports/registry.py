"""Every metric once: id, name, unit, direction, formula, source, function. Tables, plots, docs and the API read this."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from reports import metrics
from reports.metrics import Pair

VERSION = "1"  # part of every comparison's key: raise it when a definition changes

Direction = Literal["lower", "higher", "zero"]
Unit = Literal["0-255", "1", "share"]


@dataclass(frozen=True)
class Metric:
    """One metric. `direction`: which values are better, lower, higher or those nearest to zero; `share` is shown in per cent.

    `function` takes a Pair; it is None for metrics of sequences. `nightly` metrics are too slow for every job.
    """

    id: str
    name: str
    unit: Unit
    direction: Direction
    formula: str
    source: str
    function: Callable[[Pair], float | None] | None
    nightly: bool = False

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
            "mean over frames and pixels of |(t − r)ₖ₊₁ − (t − r)ₖ| on luma",
            "frame-to-frame change that the reference doesn't have",
            None,
        ),
    )
}
