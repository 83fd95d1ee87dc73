"""Numbers as a reader wants them: three significant digits, per cent for shares, a dash for what is not there."""

from __future__ import annotations

import math

from reports.registry import Metric
from reports.statistics import Interval

DASH = "–"
MINUS = "−"


def number(value: float | None, digits: int = 3) -> str:
    """`digits` significant digits without trailing noise: 0.00123, 1.23, 12.3, 1230; a dash for None."""
    if value is None:
        return DASH
    if value == 0:
        return "0"
    magnitude = math.floor(math.log10(abs(value)))
    plain = -4 <= magnitude < 6
    text = f"{value:.{max(digits - 1 - magnitude, 0)}f}" if plain else f"{value:.{digits - 1}e}"
    return text.replace("-", MINUS, 1) if value < 0 else text


def percent(value: float | None) -> str:
    """A share in per cent with a sensible number of digits."""
    if value is None:
        return DASH
    return f"{number(100 * value, 3 if abs(value) >= 0.1 else 2)} %"


def of_metric(metric: Metric, value: float | None) -> str:
    """A value in the metric's unit; SSIM-like figures near 1 keep four decimals, where their differences lie."""
    if metric.unit == "share":
        return percent(value)
    if metric.direction == "higher" and value is not None:
        return f"{value:.4f}".replace("-", MINUS)
    return number(value)


def uncertainty(metric: Metric, found: Interval) -> str:
    """`± half` width of the interval, or what stands in its place."""
    if found.kind == "none":
        return "one seed"
    if found.kind == "exact":
        return "seeds equal"
    return f"± {percent(found.half) if metric.unit == 'share' else number(found.half, 2)}"


def seconds(value: float | None) -> str:
    """Seconds, or milliseconds under a tenth of one."""
    if value is None:
        return DASH
    return f"{number(1000 * value)} ms" if value < 0.1 else f"{number(value)} s"


def megabytes(value: int) -> str:
    """Bytes in MiB; a dash for 0 (not measured)."""
    return f"{value / 2**20:,.0f} MiB" if value else DASH


def count(value: int) -> str:
    """An exact count with thin spaces between thousands."""
    return f"{value:,}".replace(",", "\u202f")
