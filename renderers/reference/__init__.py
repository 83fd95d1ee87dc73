"""Path-traced references with controlled noise. Importing this package loads no Mitsuba; the first `render` does.

reference = renderers.reference.render(scene, "one-bounce", size=(320, 180), noise=0.004)
reference.image, reference.variance, reference.noise, reference.interval()
"""

from renderers.reference.image import PixelMode, Reference, exposure
from renderers.reference.replicates import render

__all__ = ["PixelMode", "Reference", "exposure", "render"]
