"""A lens as a smooth surface: a pinhole whose image is displaced by a cubic B-spline, to be simulated, not solved.

With control points of any pattern (see `calib.cameras.surface`) it bends as no Brown polynomial does: what a lens of
many elements leaves over when its polynomial is taken away.
"""

from calib.cameras import pinhole
from calib.cameras.surface import SurfaceModel

COLUMNS, ROWS = 8, 6

MODEL = SurfaceModel.over(pinhole.MODEL, "spline", rows=ROWS, columns=COLUMNS)
