"""Irradiance caching: light computed at few places ("records"), interpolated everywhere else by splatting.

| module | what it gives |
| --- | --- |
| `records` | records as a structure of arrays, places to put them |
| `incoming` | reflected direct light of whatever the rays of a hemisphere hit |
| `hemisphere` | polar hemispheres cast in large batches, and records made of them |
| `plane` | hemispheres through one plane, as rasterised, with border compensation |
| `cube`, `hemicube` | hemispheres through five faces of texels, cast or drawn by a rasteriser |
| `gradients` | irradiance, its rotation and translation gradients, harmonic mean distance of polar hemispheres |
| `limits` | clamps of the radius, gradient limit, neighbour clamping |
| `weights` | weight and zone of influence |
| `splat`, `splat_kernels` | records added to the pixels inside their zones |
| `placement` | where records are put: in batches, or one by one |
| `sight` | zones that end where their records don't see |
| `radiance` | radiance records: hemispherical harmonics of incoming radiance, with gradients |
| `reflectance` | BRDFs of glossy materials as coefficients; what is too sharp for them |
| `glossy`, `glossy_kernels` | radiance records added to the pixels inside their zones |
| `traced` | lobes too sharp for records |
| `bounces` | all bounces, from a coarse cache of surface light |
| `layers` | irradiance and radiance caches in use, view after view |

Positions, radii and distances are in World units (half the scene's diagonal is 1).
Sources: P. Gautron, *Cache de luminance et cartes graphiques*, doctoral thesis, Université de Rennes 1, 2006, chapter 4;
G. Ward, F. Rubinstein, R. Clear, *A ray tracing solution for diffuse interreflection*, 1988; G. Ward, P. Heckbert, *Irradiance
gradients*, 1992; J. Křivánek, P. Gautron, S. Pattanaik, K. Bouatouch, *Radiance caching*, 2005.
"""
