"""The camera of `calib.cameras.luhmann` whose image axes need not be square to each other."""

from calib.cameras.luhmann import MODEL as UPRIGHT
from calib.cameras.skewed import SkewedModel

MODEL = SkewedModel("luhmann_skew", UPRIGHT)
