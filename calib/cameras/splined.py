"""A central camera of any shape, solved from photos: a fisheye lens whose image is displaced by a cubic B-spline.

The base, Kannala and Brandt's four coefficients, holds what it can of the lens, beyond 90 degrees too; the surface of
`ROWS` x `COLUMNS` control points (see `calib.cameras.surface`) holds the rest. How smooth that is, photos say: see
`calib.solver.surface`.
"""

from calib.cameras import fisheye
from calib.cameras.surface import SurfaceModel

COLUMNS, ROWS = 24, 16

MODEL = SurfaceModel.over(fisheye.MODEL, "splined", rows=ROWS, columns=COLUMNS)
