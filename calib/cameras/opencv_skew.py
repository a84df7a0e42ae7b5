"""The camera of `calib.cameras.opencv` whose image axes need not be square to each other."""

from calib.cameras.opencv import MODEL as UPRIGHT
from calib.cameras.skewed import SkewedModel

MODEL = SkewedModel("opencv_skew", UPRIGHT)
