"""The plane in which rings seem to lie that are raised or recessed: an oblique camera sees their walls, too.

Of a body that is symmetric about a point, the silhouette is symmetric about the point's image. So a raised ring,
black all over, is seen at half its height, which `--build relief` has for the target's plane; a groove with black
walls begins and ends at its rims, in the face; one with white walls is seen half-way down.

What is left is light. White beside a wall of height h sees less of the sky: over a floor that stays uncovered from the
distance t = 0 on at the near side and from t = h tan(tilt) on at the far side, (1 - t / sqrt(t^2 + h^2)) / 2 of light
is missing. If all of it counted for ink, rings would seem deeper by

    d = h (1 + tan(tilt) - 1 / cos(tilt)) / (4 tan(tilt)),

of .4 mm at 45 degrees .059 mm. Rendered (Mitsuba 3, an even sky, 10 pixels a millimetre) it is .43 of that at 20, 45
and 65 degrees alike: .034, .025 and .016 mm, and of grooves with black walls .001 mm, less than .01 pixels. With a
lamp at 45 degrees, rendered too, raised rings seem .058 mm deeper and .139 mm farther from the lamp, all alike.
"""

import numpy as np

from designer.base.arrays import Array
from designer.tolerance.shape import MadeShape, shift_of_pieces
from designer.tolerance.source import ErrorSource


def _apply(shape: MadeShape, values: Array) -> MadeShape:
    """All faces move along their normals by one number: walls and light are alike on all."""
    step_mm = np.array([[0.0, 0.0, values[0, 0]]])
    return shape.with_faces_moved(shift_of_pieces(step_mm).repeat(shape.nominal.face_count, axis=0))


SOURCE = ErrorSource("wall", "plane of raised or recessed rings", "mm", "print", 1, _apply)
