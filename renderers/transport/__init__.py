"""Numpy and numba mathematics that several methods share: ray casting, BRDFs, sampling, direct light, virtual point lights.

Everything here works on a `World`: normalised (size 1), so offsets and tolerances are plain numbers. The modules import numba and
embreex; callers import them inside functions.
"""

import os

from renderers.transport import kernel_cache

kernel_cache.use()
# numba's OpenMP threads would spin for a millisecond after each kernel, in case there is another: where kernels are short that
# doubles the processor time of a frame, and takes it from whatever else runs. Read when the first parallel kernel is loaded.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
