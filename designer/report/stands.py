"""The page's section on the stand: how it carries the target, how it lies on the bed, and what it takes."""

from dataclasses import replace

import numpy as np

from designer.make.bed import bed_words
from designer.make.estimate import estimate
from designer.make.mesh import Mesh, Part
from designer.make.plate import Piece, Plate
from designer.make.stand import make_stand, stand_from_target
from designer.page.blocks import Facts, Section, View3d
from designer.page.scene import Layer, Scene, Surface
from designer.produce import Design
from designer.report.costs import duration, grams
from designer.report.pictures import printed_scene

STAND_COLOUR = "#9aa1a9"


def stand_section(design: Design) -> Section:
    """What a maker has to know of it; its file is in the folder.

    Raises:
        InputError: the target leaves no room for a stand.
    """
    job = design.job
    stand = make_stand(design.target, job.printing)
    size_mm = np.ptp(stand.vertices_mm, axis=0)
    plate = Plate("stand", (Piece("stand", Part(stand, None), np.eye(4)),))
    takes = estimate((plate,), job.printing)
    rows = [
        ("how it lies", "on its base, as the file has it; supports off"),
        ("size", f"{' x '.join(f'{length:.0f}' for length in size_mm)} mm"),
        ("weight", grams(takes.body_g)),
        ("time", duration(takes.time_s)),
    ]
    printer = job.printing.printer
    width, depth, height = size_mm.tolist()
    is_wide = all(printer.place_mm(size) is None for size in ((width, depth), (depth, width)))
    if is_wide or height > printer.bed_mm[2]:
        rows.append(("bed", f"it does not fit: {bed_words(printer)}; print it on another"))
    view = View3d(
        "The target on its stand",
        _scene(design, stand),
        "The target standing on its stand, no ring covered.",
        caption="As it stands on the table.",
    )
    lead = f"{job.name}.stand.stl, of one filament, any colour; estimated like the target, and not in its figures."
    return Section("The stand", (view, Facts(tuple(rows))), lead)


def _scene(design: Design, stand: Mesh) -> Scene:
    """The printed target and its stand, at the design's size, in the target frame; the stand's z is up."""
    motion = stand_from_target(design.target)
    in_target_mm = (stand.vertices_mm / design.scale - motion[:3, 3]) @ motion[:3, :3]
    surface = Surface(in_target_mm, stand.triangles.astype(np.int64), STAND_COLOUR)
    printed = printed_scene(design)
    up, seen_from = (motion[:3, :3].T @ axis for axis in np.array([[0.0, 0.0, 1.0], [1.0, -1.0, 0.35]]))
    return replace(
        printed,
        layers=(*printed.layers, Layer("stand", (surface,))),
        up=tuple(up.tolist()),
        from_direction=tuple(seen_from.tolist()),
        legend=(*printed.legend, (STAND_COLOUR, "stand")),
    )
