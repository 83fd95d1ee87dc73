"""OpenGL passes: the one place that touches pyrender's and moderngl's innards.

pyrender owns the context and uploads the triangles; moderngl runs every pass on that context. All images here have row 0 on
top, on the GPU too: the projection turns the picture upside down in GL's terms, so no pass and no read-back flips anything.
"""
