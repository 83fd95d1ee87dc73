"""Dynamic point resampling (Laurent 2018, chapter 5): points of constant density from any triangles, one decision per triangle.

`points.resample` is the CPU twin of `renderers.gl.resample.resample`.
"""
