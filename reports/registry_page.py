"""The metrics' documentation page, made from the registry: `python -m reports.registry_page > docs/metrics/README.md`."""

from __future__ import annotations

from reports.registry import METRICS, VERSION

BETTER = {"lower": "lower values", "higher": "higher values", "zero": "values nearest to zero"}
UNITS = {"0-255": "display values, 0–255", "1": "none", "share": "share, 0–1, shown in per cent"}

INTRODUCTION = f"""# Metrics

Made from `reports/registry.py` by `python -m reports.registry_page`; definitions version {VERSION}.

**Display values** are v = clip(exposure · rgb, 0, 1) through the sRGB curve, times 255, not rounded. **Luma** is .2126 R′ + .7152
G′ + .0722 B′ of display values, **luminance** the same weights on linear radiance. The **exposure** is fixed per scene: 1 over the
99th percentile of luminance of the first `full` reference, over pixels that see neither an emitter nor the background. t is the
test image, r the reference.

Two identical images give exactly RMSE 0, SSIM 1, over 2 % 0. A figure that is not defined (SSIM under 11 pixels a side, a relative
figure against a black reference) is absent, never a made-up number.

How intervals, verdicts and the error budget are made from these numbers is in [reports](../reports.md).
"""

BOUNDS = """
### What the reference leaves open

`over_2pct` counts pixels against the reference's mean, which is itself an estimate. Each pixel's luminance Y has the 95 % interval
Y ± t(0.975, n−1) · sqrt(variance of the mean), Student's t over n replicates. Each end is carried through the tone curve at fixed
chromaticity: the pixel's rgb is scaled to that luminance (grey where the pixel is black) and its luma taken. A pixel is *surely
over* when it is over 2 % for every r in the interval, *possibly over* when it is for some. r ± 0.02 · max(r, 1) both grow with r,
so the ends decide. The error map shows possibly-but-not-surely in its own colour. When more than 20 % of the pixels are undecided
(5 % for claims), the reference is called too noisy.
"""


def page() -> str:
    """The whole page as Markdown."""
    parts = [INTRODUCTION]
    for metric in METRICS.values():
        lines = [
            f'\n<a id="{metric.id}"></a>\n## {metric.name} (`{metric.id}`)\n',
            f"- formula: {metric.formula}",
            f"- unit: {UNITS[metric.unit]}",
            f"- better: {BETTER[metric.direction]}",
            f"- source: {metric.source}",
        ]
        if metric.nightly:
            lines.append("- measured in nightly runs only, as it takes seconds an image")
        parts.append("\n".join(lines) + "\n")
        if metric.id == "over_2pct_possibly":
            parts.append(BOUNDS)
    return "".join(parts)


if __name__ == "__main__":
    print(page(), end="")
