"""The body that stickers are glued on: on each face its number and the way to its code corner, and a lip around it.

Number and arrow are engraved in strokes of a millimetre at most where the sticker lies. It does not sink in: a strip of
paper of thickness t over a groove of width s sags by p s^4 / (32 E t^3) (Timoshenko, clamped), .0005 mm under a
finger's p = .05 N/mm^2 with s = 1 mm, t = .1 mm and E = 3000 N/mm^2.

What is left of a hand's error is the clearance of the lip (`templates/errors/lip-stickers.toml`). The face that lies on
the bed has a groove in place of its lip, since no printer closes a pocket over the bed.
"""

import numpy as np
from manifold3d import Manifold

from designer.base.arrays import Array
from designer.base.solid import Faceted, Solid
from designer.kinds.layout import lip_of
from designer.make.lettering import HEIGHT, text_contours
from designer.make.mesh import Mesh, mesh_of, placed, plain_solid, prism, solid_of, union
from designer.make.pattern import Contour, moved_in
from designer.spec.spec import PrintSpec
from designer.target import TargetGeometry

ENGRAVED_LAYERS = 2
MOST_STROKE_MM = 1.0
ARROW = np.array([[0.0, 0.0], [-3.0, -3.0], [-3.0, -4.4], [0.0, -1.4], [3.0, -4.4], [3.0, -3.0]])
"""That points up, its tip at the origin, in strokes."""
TIP = 0.5
"""Where the arrow ends, on the way from the face's middle to its code corner."""


def sticker_body(target: TargetGeometry, solid: Solid | Faceted, printing: PrintSpec) -> Mesh:
    """The body, in the design's lengths.

    Args:
        target: the nominal geometry.
        solid: that its faces bound.
        printing: gives the stickers' thickness, lip and labels.
    """
    layer, thickness = printing.printer.layer_height_mm, printing.sticker_thickness_mm
    cuts, rise = [], -thickness
    if printing.lip:
        lip = lip_of(target, printing)
        rise = lip.rise_mm
    for face, frame in enumerate(target.target_from_face):
        outline, contours = target.outline_mm[face], engraved(target, face, printing)
        pits = [prism(contours, -thickness - ENGRAVED_LAYERS * layer, rise + 1.0)] if contours else []
        if printing.lip:
            on_bed = face == target.face_count - 1
            inside = prism((moved_in(outline, lip.width_mm),), -thickness, rise + 1.0)
            if on_bed:
                pits.append(_groove(moved_in(outline, lip.width_mm), printing))
                inside = prism((moved_in(outline, -float(np.ptp(outline))),), -thickness, rise + 1.0)
            pits.append(inside)
        cuts += [placed(pit, frame) for pit in pits]
    return mesh_of(solid_of(plain_solid(solid, below_mm=-rise, scale=1.0)) - union(cuts))


def _groove(inside: Contour, printing: PrintSpec) -> Manifold:
    """A line wide around the place of a sticker, in the face's frame."""
    printer, seat = printing.printer, -printing.sticker_thickness_mm
    outer, inner = (
        prism((moved_in(inside, inwards),), seat - ENGRAVED_LAYERS * printer.layer_height_mm, seat + 1.0)
        for inwards in (-printer.line_width_mm, 0.0)
    )
    return outer - inner


def engraved(target: TargetGeometry, face: int, printing: PrintSpec) -> tuple[Contour, ...]:
    """A face's number, upright as on its sticker, and an arrow to its code corner; nothing where lines are too wide."""
    corner = target.outline_mm[face, 0]
    far = float(np.linalg.norm(corner))
    stroke = min(MOST_STROKE_MM, TIP * far / (HEIGHT / 2 - ARROW[:, 1].min() + 1.5))
    if not printing.labels or stroke < printing.printer.line_width_mm:
        return ()
    up = corner / far
    turn = np.array([[up[1], -up[0]], [up[0], up[1]]])
    arrow: Array = stroke * ARROW @ turn + TIP * corner
    return (*text_contours(str(face), stroke, -HEIGHT * stroke / 2), arrow)
