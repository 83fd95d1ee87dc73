"""What the project's Mitsuba BSDFs have in common: a diffuse and a glossy lobe that are sampled and evaluated as one."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import drjit as dr

from renderers.reference.variant import mitsuba

mi = mitsuba()


class TwoLobes(mi.BSDF):  # type: ignore[misc, name-defined]
    """Reflection on the front side. Subclasses draw directions and say value and density together; sampling is weighted by both."""

    def __init__(self, props: Any) -> None:
        mi.BSDF.__init__(self, props)
        flags = mi.BSDFFlags.GlossyReflection | mi.BSDFFlags.DiffuseReflection | mi.BSDFFlags.FrontSide
        self.m_components = [flags]
        self.m_flags = flags

    @abstractmethod
    def direction(self, si: Any, sample1: Any, sample2: Any, active: Any) -> Any:
        """A direction of the density that `eval_pdf` gives."""

    @abstractmethod
    def eval_pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> tuple[Any, Any]:
        """f·cos and the density that `direction` has."""

    def sample(self, ctx: Any, si: Any, sample1: Any, sample2: Any, active: Any = True) -> tuple[Any, Any]:
        """A direction and f·cos/pdf."""
        bs = mi.BSDFSample3f()
        bs.wo = self.direction(si, sample1, sample2, active)
        value, bs.pdf = self.eval_pdf(ctx, si, bs.wo, active)
        bs.eta = 1.0
        bs.sampled_type = mi.UInt32(+self.m_flags)
        bs.sampled_component = mi.UInt32(0)
        return bs, dr.select(bs.pdf > 0, value / bs.pdf, 0)

    def eval(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        """f·cos."""
        return self.eval_pdf(ctx, si, wo, active)[0]

    def pdf(self, ctx: Any, si: Any, wo: Any, active: Any = True) -> Any:
        """Density of `sample` per solid angle."""
        return self.eval_pdf(ctx, si, wo, active)[1]
