"""Temporal caching: records that live for several frames, as long as their light is foreseen to change little.

| module | what it gives |
| --- | --- |
| `lifespan` | change rates of irradiance and of radiance coefficients, lifespans |
| `chords` | longer lives of records that are interpolated in time |
| `motion` | what differs between the Worlds of two frames |
| `anchors` | which surface a place lies on, and where it goes |
| `sampling` | hemispheres whose hits are kept, at places numbered once for all |
| `updating` | what rays found, brought to the next frame: only what may have changed is cast and shaded anew |
| `prediction` | the same hemispheres one frame ahead: cast anew where something moved, or by reprojection |
| `reprojection` | hits of polar hemispheres moved with their objects, drawn with a depth test, holes filled |
| `plane_sampling` | hemispheres seen through one square plane, as published, and their reprojection |
| `plane` | points drawn into such planes, nearest first, holes filled; twin of the GL pass |
| `trends` | temporal gradients of all that records hold |
| `records` | records in time: values at a frame |
| `views` | pixels of a frame's views: diffuse, glossy, traced |
| `layers` | what each cache gives the frames |
| `pending` | frames that wait for the successors of their records |
| `cache` | the live records of an animation: expiry, renewal in place, deletion |
| `coverage` | pixels that records reach, and records that are needed for them |
| `worth` | which radiance records serve too few pixels |
| `overlay` | where records lie and how long they live, as a picture |
| `accumulation` | temporal accumulation of noisy images: the pixel's past followed back |

Time is counted in frames. Source: P. Gautron, *Cache de luminance et cartes graphiques*, doctoral thesis, Université de Rennes 1,
2006, chapter 5; P. Gautron, K. Bouatouch, S. Pattanaik, *Temporal radiance caching*, 2007.
"""
