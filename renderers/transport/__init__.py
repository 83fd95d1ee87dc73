"""Numpy and numba mathematics that several methods share: ray casting, BRDFs, sampling, direct light, virtual point lights.

Everything here works on a `World`: normalised (size 1), so offsets and tolerances are plain numbers. The modules import numba and
embreex; callers import them inside functions.
"""

from renderers.transport import kernel_cache

kernel_cache.use()
