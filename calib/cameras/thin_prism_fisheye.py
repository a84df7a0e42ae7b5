"""A fisheye lens whose parts are neither centred nor parallel: COLMAP's THIN_PRISM_FISHEYE, eight coefficients.

`D` of `calib.cameras.displaced` over the plane of angles, with the radial factor
`1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8` and the prism's `sx1 theta^2` and `sy1 theta^2`
(COLMAP's documentation of camera models). It is kept up to the angle where the radial part ceases to grow.
"""

from calib.cameras.displaced import displaced_model

MODEL = displaced_model(
    "thin_prism_fisheye",
    "its polynomial bends back there; ds or eucm do not",
    (("k1", "a1"), ("k2", "a2"), ("p1", "p1"), ("p2", "p2"), ("k3", "a3"), ("k4", "a4"), ("sx1", "s1"), ("sy1", "s3")),
    is_angular=True,
)
