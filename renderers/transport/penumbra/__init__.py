"""Penumbra deep shadow maps (St-Amour 2004): per pixel of a pyramid around a light, the hidden share of the light along the ray.

emitters    area lights of a World and stratified points on them
pyramid     the view pyramid with its pixel grid, and which pyramids a light needs
cameras     one shadow map camera per light point: off-axis windows that contain every ray of the pyramid
depth       shadow maps: depth of the first surface at texel centres, with the bias of a slanted surface
walk        a pyramid's ray through a shadow map: depths at which it enters and leaves shadow
lockstep    the same for all rays of a row at a time, where the map's grid fits the pyramid's
assemble    events of all shadow maps to attenuation functions, in slabs under a memory bound
reduce      events of a pixel to its function
compress    few line segments for many steps, with a proven bound
functions   the packed functions: lookup, files
lookup      numba kernels that evaluate them
"""
