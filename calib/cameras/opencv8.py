"""OpenCV's rational camera: a pinhole with Brown's distortion whose radial part is a quotient, eight coefficients.

`D` of `calib.cameras.displaced` over the plane z = 1, with the radial factor
`(1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3)` and no prism (OpenCV's documentation of calib3d).
"""

from calib.cameras.displaced import displaced_model

RATIONAL = (
    ("k1", "a1"), ("k2", "a2"), ("p1", "p1"), ("p2", "p2"), ("k3", "a3"), ("k4", "b1"), ("k5", "b2"), ("k6", "b3"),
)  # fmt: skip
"""The parameters and what they stand for."""

MODEL = displaced_model(
    "opencv8", "its quotient bends back there; fisheye, ds and eucm reach farther off the axis", RATIONAL,
    has_opencv_lens=True,
)  # fmt: skip
