"""The image of one ring: the model that every fit in this package shares.

With `v = u - c` the offset from the projected centre `c`, the plane distance from the ring's centre in units of the
outer radius is

    F(v) = |E xi| / (1 - m . xi),    xi = v + q(v),

`E` lower triangular with a positive diagonal, `m` the vanishing line (`m . xi = 1` holds on it) and `q` a known
quadratic form that straightens the lens locally (zero without a lens). The ring's edges are `F = 1` and `F = k`; the
signed distance of a pixel from an edge is `(F - rho) / |grad F|` to first order (Sampson), and the equations of the fit
take the second order along the gradient. For a pinhole this is the planar homology between the two conics, eight
parameters: c, E, m and k.

Brightness: white and ink each vary linearly over the ring,

    I(u) = L (1 - a T) + T h . (u - u0),    L = w + g . (u - u0),    T = Phi(d_inner / s) - Phi(d_outer / s),

with `s` the edge's blur in pixels (lens and pixel together) and Phi the normal distribution; h is zero where light only
multiplies, and takes up veiling light or a black level. A dot has no inner edge: T = 1 - Phi(d_outer / s). Edges are
curved: what is written as Phi(d / s) is the blurred disc with the edge's own radius of curvature. Out of focus s is
that of the middle, and grows over the image as `blur_growth` tells: each edge has the blur of its own place.

The fits take the derivatives of the distances at the edges, where the brightness changes: dd = dF / |grad F|.
"""

from typing import Final

CENTER_U: Final = 0
CENTER_V: Final = 1
E00: Final = 2
E10: Final = 3
E11: Final = 4
M0: Final = 5
M1: Final = 6
RATIO: Final = 7
BLUR: Final = 8
WHITE: Final = 9
LIGHT_U: Final = 10
LIGHT_V: Final = 11
DARKNESS: Final = 12
INK_LIGHT_U: Final = 13
INK_LIGHT_V: Final = 14
PARAMETERS: Final = 15
GEOMETRY_PARAMETERS: Final = 8
