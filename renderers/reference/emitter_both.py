"""Area emitter that shines from both sides of its mesh.

Mitsuba's own `area` emits along the normal only, and `twosided` can't wrap emitters; a second, flipped mesh would
fight with the first for every hit and waste half of the light samples.
"""

from __future__ import annotations

from typing import Any

import drjit as dr

from renderers.reference.variant import mitsuba

mi = mitsuba()


class BothSides(mi.Emitter):  # type: ignore[misc, name-defined]
    """Plugin `luxmeter_area_both`; properties radiance_{r,g,b} in W·sr⁻¹·m⁻². Points are drawn uniformly over the mesh."""

    def __init__(self, props: Any) -> None:
        mi.Emitter.__init__(self, props)
        self.radiance = mi.Color3f(*[props[f"radiance_{c}"] for c in "rgb"])
        self.m_flags = +mi.EmitterFlags.Surface

    def eval(self, si: Any, active: Any = True) -> Any:
        """Radiance, from either side."""
        return dr.select(active, self.radiance, 0)

    def sample_direction(self, it: Any, sample: Any, active: Any = True) -> tuple[Any, Any]:
        """A direction to a point of the mesh, and radiance / pdf."""
        ds = self.get_shape().sample_direction(it, sample, active)
        ds.emitter = mi.EmitterPtr(self)
        active = active & (ds.pdf > 0)
        return ds, dr.select(active, self.radiance / ds.pdf, 0)

    def pdf_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
        """Density of `sample_direction` per solid angle."""
        return dr.select(active, self.get_shape().pdf_direction(it, ds, active), 0)

    def eval_direction(self, it: Any, ds: Any, active: Any = True) -> Any:
        """Radiance, from either side."""
        return dr.select(active, self.radiance, 0)

    def bbox(self) -> Any:
        """Bounds of the mesh."""
        return self.get_shape().bbox()

    def to_string(self) -> str:
        """Name."""
        return "BothSides[]"


mi.register_emitter("luxmeter_area_both", BothSides)
