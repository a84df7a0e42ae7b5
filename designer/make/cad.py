"""True CAD solids of a target and their STEP file; the only module that needs build123d.

build123d takes seconds to import, so this module is imported where a STEP file is asked for. Circles stay
circles here, while `mesh` makes polygons of them: the two routes check each other.
"""

import itertools
import re
from dataclasses import dataclass
from io import BytesIO

from build123d import Compound, Face, Location, Plane, Shell, Solid, Vector, Wire, export_step

from designer.base.arrays import Array
from designer.make.pattern import Contour, Pattern, Stamp
from designer.spec.spec import PrintSpec, Spec

_DATE = "2000-01-01T00:00:00"
"""Same spec, same bytes: the date of every STEP file."""

_OCCURRENCE = re.compile(r"NEXT_ASSEMBLY_USAGE_OCCURRENCE\('\d+',([^;]*)\);")
_ENTITY = re.compile(r"^#(\d+) =", re.MULTILINE)
_SOLID = re.compile(r"ADVANCED_BREP_SHAPE_REPRESENTATION\('',\(#\d+,#(\d+)\),#(\d+)\);")


@dataclass(frozen=True)
class InlaidSolids:
    """A body and the ink set into it, in the target frame. The ink's solids bear the labels border, ring, dot, text."""

    body: Solid
    ink: tuple[Solid, ...]  # rings of one size are placed copies of one shape


def step_bytes(spec: Spec, pattern: Pattern, printing: PrintSpec, *, name: str, scale: float = 1.0) -> bytes:
    """A STEP file of a target printed in two filaments: an assembly `name` of a `body` and its `ink`.

    Args:
        spec: the target's design.
        pattern: its ink, made with the same `scale`.
        printing: gives inlay and colours.
        name: the label of the whole.
        scale: the size of the printed part over the design's, from shrinkage compensation.
    """
    solids = inlaid_solids(spec, pattern, printing.inlay_mm, scale=scale)
    if printing.way.ink == "raised":
        solids = _raised(solids, pattern, printing.below_raised_mm(spec.depth_mm), printing.inlay_mm)
    ink = Compound(label="ink", children=list(solids.ink))
    step = _step_text(Compound(label=name, children=[_labelled(solids.body, "body"), ink]))
    return _coloured(step, printing.body_colour, printing.ink_colour).encode("latin-1")


def inlaid_solids(spec: Spec, pattern: Pattern, inlay_mm: float, *, scale: float = 1.0) -> InlaidSolids:
    """Set the pattern into the target's solid, `inlay_mm` deep."""
    solid = _solid_below(spec, 0.0, scale)
    frames = [_location(frame) for frame in pattern.target_from_face]
    ink: list[Solid] = []
    if pattern.faces[0].window is not None:
        core = _solid_below(spec, inlay_mm, scale)
        ink += _border(solid, core, pattern, frames, inlay_mm)
    stamps = [_stamp_solid(stamp, inlay_mm) for stamp in pattern.stamps]
    for face, frame in zip(pattern.faces, frames, strict=True):
        for row, (x, y) in zip(face.stamp, face.position_mm.tolist(), strict=True):
            ink.append(stamps[row].moved(frame * Location((x, y, 0.0))))
        ink += [_labelled(_prism(text, -inlay_mm, 0.0), "text").moved(frame) for text in face.dark_text]
    # One cut with all tools: a loop over them takes 25 times as long for each ring.
    return InlaidSolids(_only_solid(solid.cut(*ink)), tuple(ink))


def _raised(inlaid: InlaidSolids, pattern: Pattern, body_mm: float, height_mm: float) -> InlaidSolids:
    """The same ink on a plate; the target's plane is half-way up its walls (`designer.make.mesh.raised`)."""
    body, up = _prism(pattern.faces[0].outline, -body_mm, 0.0), Location((0.0, 0.0, height_mm / 2))
    down = Location((0.0, 0.0, -height_mm / 2))
    return InlaidSolids(body.moved(down), tuple(ink.moved(up) for ink in inlaid.ink))


def _solid_below(spec: Spec, depth_mm: float, scale: float) -> Solid:
    """The part of the target's solid that lies at least `depth_mm` below the faces with ink."""
    if spec.solid is None:
        target = spec.lay_out()
        behind_back_mm = depth_mm if target.face_count > 1 else 0.0
        return _prism(scale * target.outline_mm[0], behind_back_mm - spec.depth_mm * scale, -depth_mm)
    vertices = spec.solid.corners_mm(below_mm=depth_mm, scale=scale)
    corners = vertices[spec.solid.polyhedron.faces].tolist()  # (F, K, 3)
    return Solid(Shell([Face(Wire.make_polygon([tuple(corner) for corner in face])) for face in corners]))


def _border(solid: Solid, core: Solid, pattern: Pattern, frames: list[Location], inlay_mm: float) -> list[Solid]:
    """The border of all faces that meet as one solid: the shell around `core` without windows and light letters.

    Twenty mitred frames would touch in sixty walls inside the ink, which no printer and no neighbour has. Front and
    back of a plate have one each.
    """
    openings = [
        _prism(contour[::-1], -inlay_mm, inlay_mm).moved(frame)
        for face, frame in zip(pattern.faces, frames, strict=True)
        for contour in (*([] if face.window is None else [face.window]), *face.light_text)
    ]
    return [_labelled(border, "border") for border in solid.cut(core, *openings).solids()]


def _stamp_solid(stamp: Stamp, depth_mm: float) -> Solid:
    """A ring or dot about the z axis, its top at z = 0."""
    floor = Plane((0.0, 0.0, -depth_mm))
    disc = Solid.make_cylinder(stamp.outer_radius_mm, depth_mm, floor)
    if stamp.hole is None:
        return _labelled(disc, "dot")
    return _labelled(_only_solid(disc.cut(Solid.make_cylinder(stamp.inner_radius_mm, depth_mm, floor))), "ring")


def _prism(contour: Contour, z_low_mm: float, z_high_mm: float) -> Solid:
    """The upright prism over a counter-clockwise contour."""
    corners = [(x, y, z_low_mm) for x, y in contour.tolist()]
    return Solid.extrude(Face(Wire.make_polygon(corners)), Vector(0.0, 0.0, z_high_mm - z_low_mm))


def _location(target_from_face: Array) -> Location:
    """A rigid motion as build123d's type.  # (4, 4)"""
    x_axis, _, z_axis, origin = (tuple(column) for column in target_from_face[:3].T.tolist())
    return Location(Plane(origin, x_dir=x_axis, z_dir=z_axis))


def _only_solid(shape: Solid | Compound) -> Solid:
    """The one solid a boolean operation must leave."""
    (solid,) = shape.solids()
    return solid


def _labelled(solid: Solid, label: str) -> Solid:
    solid.label = label
    return solid


def _step_text(assembly: Compound) -> str:
    """The STEP file of an assembly, without colours.

    Open CASCADE numbers the occurrences of parts from a counter that runs on through the process; they are
    numbered anew, from 1, so that the text depends on the assembly only. No other entity refers to the numbers.
    """
    stream = BytesIO()
    export_step(assembly, stream, write_pcurves=False, timestamp=_DATE)
    numbers = itertools.count(1)

    def renumbered(match: re.Match[str]) -> str:
        # Where the line breaks inside depends on the length of the old number.
        rest = match[1].replace("\n  ", "").replace("\n", "")
        return f"NEXT_ASSEMBLY_USAGE_OCCURRENCE('{next(numbers)}',{rest});"

    return _OCCURRENCE.sub(renumbered, stream.getvalue().decode("latin-1"))


def _coloured(step: str, body_colour: str, ink_colour: str) -> str:
    """The STEP file with each solid shape styled once (ISO 10303-46); placed copies share the style.

    Open CASCADE's own writer lists styles in the order of memory addresses, so no two runs agree, and styles
    every copy. The body is the first shape of the assembly.
    """
    head, end, tail = step.rpartition("ENDSEC;")
    number = int(_ENTITY.findall(head)[-1])
    lines = []
    for row, (brep, context) in enumerate(_SOLID.findall(head)):
        colour = body_colour if row == 0 else ink_colour
        red, green, blue = (f"{int(colour[k : k + 2], 16) / 255:.6f}" for k in (1, 3, 5))
        for entity in (
            f"COLOUR_RGB('',{red},{green},{blue})",
            "FILL_AREA_STYLE_COLOUR('',#{last})",
            "FILL_AREA_STYLE('',(#{last}))",
            "SURFACE_STYLE_FILL_AREA(#{last})",
            "SURFACE_SIDE_STYLE('',(#{last}))",
            "SURFACE_STYLE_USAGE(.BOTH.,#{last})",
            "PRESENTATION_STYLE_ASSIGNMENT((#{last}))",
            f"STYLED_ITEM('colour',(#{{last}}),#{brep})",
            f"MECHANICAL_DESIGN_GEOMETRIC_PRESENTATION_REPRESENTATION('',(#{{last}}),#{context})",
        ):
            lines.append(f"#{number + 1} = {entity.format(last=number)};\n")
            number += 1
    return head + "".join(lines) + end + tail
