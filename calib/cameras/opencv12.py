"""OpenCV's rational camera with a thin prism: twelve coefficients, those of `opencv8` and s1 to s4.

`D` of `calib.cameras.displaced` over the plane z = 1 (OpenCV's documentation of calib3d).
"""

from calib.cameras.displaced import displaced_model
from calib.cameras.opencv8 import RATIONAL

MODEL = displaced_model(
    "opencv12",
    "its quotient bends back there; fisheye, ds and eucm reach farther off the axis",
    (*RATIONAL, *((name, name) for name in ("s1", "s2", "s3", "s4"))),
    has_opencv_lens=True,
)
