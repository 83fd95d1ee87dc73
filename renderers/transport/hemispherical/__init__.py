"""Hemispherical harmonics: an orthonormal basis of functions on the upper hemisphere, and what rendering does with it.

| module | what it gives |
| --- | --- |
| `basis` | values of hemispherical and spherical harmonics, indices, explicit irradiance |
| `quadrature` | nodes and weights on the hemisphere, the sphere and its lunes |
| `projection` | coefficients from functions, from random samples, from hemisphere images; reconstruction; products |
| `conversion` | the matrix between the two bases |
| `sphere_rotation` | rotation of spherical harmonics |
| `lune`, `rotation` | the three rotations of hemispherical harmonics |
| `models` | Phong and anisotropic Ward, and which lobes an order can hold |
| `brdf_table` | BRDF coefficients by outgoing direction |
| `environment` | environment lighting |
| `comparison` | other bases of the hemisphere, for accuracy plots |

Conventions: local frame (t, b, n), z along the normal n, all directions point away from the surface. Order n means degrees
l = 0 … n-1, hence n² coefficients, coefficient (l, m) at index l(l+1) + m. Condon–Shortley sign (-1)^m included.
Source: P. Gautron, *Cache de luminance et cartes graphiques*, doctoral thesis, Université de Rennes 1, 2006, chapter 3.
"""
