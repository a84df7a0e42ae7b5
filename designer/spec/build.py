"""The ways to build a target: an entry here for each, and a file of `designer/builds/`, which makes it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Form = Literal["solid", "polyhedron", "trihedron", "plate"]
"""What a target is: faces around a regular solid, or any convex body, or three that look at each other, or a board."""
Format = Literal[
    "3mf",
    "project",
    "painted",
    "stl",
    "png",
    "pdf",
    "svg",
    "shop",
    "step",
    "glb",
    "colour",
    "simulator",
    "dxf",
    "laser",
    "gerber",
    "gerber-mask",
]
"""What each is, and what it is for: `designer.spec.format`."""
InkLevel = Literal["flush", "raised", "recessed"]
"""Where the top of the ink is: in the body's face, above it, or nowhere yet, since grooves wait for paint or resin."""
CircuitInk = Literal["legend", "mask"]
"""What makes the black of a printed circuit: silkscreen, or solder mask that stays."""


@dataclass(frozen=True)
class Build:
    """A way to build targets, as far as sizes, files and studies ask; `designer.builds.design.maker_of` makes them."""

    name: str
    title: str  # as in a table of them
    errors: Mapping[Form, str]  # the error template that says how it usually comes out, of each form that it is for
    formats: tuple[Format, ...]  # its usual files
    idle: tuple[str, ...]  # options that say nothing about it; a resolved spec leaves them out
    is_two_filament: bool = False  # the printer makes the pattern of plastic; else it is paper or sheet
    ink: InkLevel = "flush"
    has_body: bool = True  # something is printed of plastic
    has_stickers: bool = False  # the body is smaller by their thickness
    is_in_parts: bool = False  # flat pieces are put together: none is steep or hangs over on the bed
    back_errors: str = ""  # the error template of a plate with a front and a back; "": not made so
    lip_errors: str = ""  # the same of stickers in lips
    why_not: str = ""  # what stands against the forms that it is not for

    @property
    def has_printed_ink(self) -> bool:
        """Whether the printer lays it down; else a hand does."""
        return self.is_two_filament and self.ink != "recessed"

    @property
    def loads_two(self) -> bool:
        """Whether the printer has body and ink loaded at a time."""
        return self.is_two_filament and self.ink == "flush"

    def errors_of(self, form: Form, face_count: int, *, has_lip: bool = False) -> str | None:
        """The error template of a target; None: it is not for this form."""
        is_two_sided = form == "plate" and face_count > 1
        if has_lip and self.lip_errors:
            return self.lip_errors
        return (self.back_errors or None) if is_two_sided else self.errors.get(form)


BUILDS: Mapping[str, Build] = {
    build.name: build
    for build in (
        Build(
            "one-piece",
            "printed in one piece, in two filaments",
            {"solid": "fdm-dual", "polyhedron": "fdm-dual", "trihedron": "fdm-dual", "plate": "fdm-board"},
            ("3mf", "stl", "png"),
            ("sticker_thickness", "lip", "ink_side", "mount", "jig"),
            is_two_filament=True,
            back_errors="fdm-board-two-sided",
        ),
        Build(
            "relief",
            "rings raised above a plate, with one change of filament",
            {"plate": "fdm-relief"},
            ("3mf", "stl", "png"),
            ("sticker_thickness", "lip", "ink_side", "mount", "jig"),
            is_two_filament=True,
            ink="raised",
            why_not="the faces of a solid are at many heights, and the filament changes at one",
        ),
        Build(
            "tiles",
            "flat pieces in two filaments, put together",
            {"solid": "fdm-tiles", "plate": "fdm-board-tiles"},
            ("3mf", "project", "png"),
            ("sticker_thickness", "lip"),
            is_two_filament=True,
            is_in_parts=True,
        ),
        Build(
            "stickers",
            "a body in one filament, and stickers",
            {"solid": "hand-stickers", "polyhedron": "hand-stickers", "trihedron": "hand-stickers"},
            ("stl", "png", "pdf", "svg"),
            ("inlay_depth", "ink_side", "mount", "jig"),
            has_stickers=True,
            lip_errors="lip-stickers",
        ),
        Build(
            "sheet",
            "artwork on one sheet from a print shop",
            {"plate": "sheet-print"},
            ("stl", "png", "pdf", "svg"),
            ("inlay_depth", "sticker_thickness", "lip", "ink_side", "mount", "jig"),
            has_body=False,
            back_errors="sheet-two-sided",
        ),
        Build(
            "recessed",
            "a body with grooves, which paint or resin fills",
            {"solid": "fdm-dual", "plate": "fdm-board"},
            ("3mf", "stl", "png"),
            ("sticker_thickness", "lip", "ink_side", "mount", "jig"),
            is_two_filament=True,
            ink="recessed",
        ),
    )
}
"""By name. The first of a form is the usual one."""
STEM_MM: Mapping[str, float] = {"1/4-20": 14.8, "m5": 11.2, "rod 8mm": 11.2, "iso9409-50": 16.0}
"""Diameter of each mount's post where it passes the tiles: two lines of a nozzle of .4 mm around a nut's corners."""
MOUNTS = tuple(STEM_MM)
"""What a core can be held by: `designer.make.mounts` makes them."""
NO_MOUNT, ANY_MOUNT = "none", "auto"
"""Nothing, and the usual one where it fits."""
InkSide = Literal["down", "up"]
"""Which way the printed face of a flat piece looks on the bed."""
FORMER_NAMES = {"solid": "one-piece", "printed": "one-piece"}
"""As files of earlier versions have them."""


def mount_room_mm(mount: str, clearance_mm: float, line_mm: float) -> float:
    """How far about a corner's axis no ring may be: post, clearance, and a line of white around."""
    return STEM_MM[mount] / 2 + clearance_mm + line_mm


def builds_of(form: Form) -> tuple[str, ...]:
    """The builds of a form, the usual one first."""
    return tuple(name for name, build in BUILDS.items() if form in build.errors)


def build_name(name: str) -> str:
    """A build's name of today.

    Raises:
        ValueError: there is no such build.
    """
    today = FORMER_NAMES.get(name, name)
    if today not in BUILDS:
        raise ValueError(f"must be one of {', '.join(BUILDS)}")
    return today
