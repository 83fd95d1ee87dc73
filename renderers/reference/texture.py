"""Base-colour image as a Mitsuba texture: bilinear between texel centres (k + 0.5) / n, row 0 at v = 0 (glTF), wrap mode per axis.

Mitsuba's own `bitmap` has one wrap mode for both axes; glTF has two.
"""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from renderers.reference.variant import mitsuba

mi = mitsuba()


class BaseColor(mi.Texture):  # type: ignore[misc, name-defined]
    """Plugin `luxmeter_texture`; properties data (TensorXf, linear (H, W, 3)), wrap_u and wrap_v: repeat, clamp or mirror."""

    def __init__(self, props: Any) -> None:
        mi.Texture.__init__(self, props)
        tensor = props["data"]
        self.height, self.width = tensor.shape[:2]
        self.data = tensor.array
        self.wrap = (props["wrap_u"], props["wrap_v"])
        self.average = float(np.mean(np.array(tensor)))

    def eval(self, si: Any, active: Any = True) -> Any:
        """Linear colour at si.uv."""
        x, y = si.uv.x * self.width - 0.5, si.uv.y * self.height - 0.5
        x0, y0 = dr.floor(x), dr.floor(y)
        fx, fy = x - x0, y - y0
        left, right = (_wrapped(mi.Int32(x0) + k, self.width, self.wrap[0]) for k in (0, 1))
        upper, lower = (_wrapped(mi.Int32(y0) + k, self.height, self.wrap[1]) for k in (0, 1))
        top = dr.lerp(self._texel(left, upper, active), self._texel(right, upper, active), fx)
        bottom = dr.lerp(self._texel(left, lower, active), self._texel(right, lower, active), fx)
        return dr.lerp(top, bottom, fy)

    def eval_3(self, si: Any, active: Any = True) -> Any:
        """Same as `eval`."""
        return self.eval(si, active)

    def _texel(self, column: Any, row: Any, active: Any) -> Any:
        return dr.gather(mi.Color3f, self.data, mi.UInt32(row * self.width + column), active)

    def mean(self) -> Any:
        """Average over texels and channels."""
        return mi.Float(self.average)

    def is_spatially_varying(self) -> bool:
        """True."""
        return True

    def to_string(self) -> str:
        """Size."""
        return f"BaseColor[{self.width}x{self.height}]"


def _wrapped(index: Any, n: int, mode: str) -> Any:
    """Texel index in [0, n) as OpenGL's REPEAT, CLAMP_TO_EDGE and MIRRORED_REPEAT have it."""
    if mode == "clamp":
        return dr.clip(index, 0, n - 1)
    period = 2 * n if mode == "mirror" else n
    index = _modulo(index, period)
    return dr.select(index < n, index, period - 1 - index)


def _modulo(index: Any, period: int) -> Any:
    remainder = index % period
    return dr.select(remainder < 0, remainder + period, remainder)


def texture(data: NDArray[np.float32], wrap: tuple[str, str]) -> Any:
    """The texture object for linear `data` (H, W, 3)."""
    return mi.load_dict({"type": "luxmeter_texture", "data": mi.TensorXf(data), "wrap_u": wrap[0], "wrap_v": wrap[1]})


mi.register_texture("luxmeter_texture", BaseColor)
