"""From a job to its files, in memory: one exporter per format, one maker per build."""

import os
import signal
import subprocess
import sys
import tomllib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from importlib import import_module
from importlib.util import find_spec

import numpy as np

from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.formats.folder import OutputFile
from designer.formats.png import Thumbnails, target_thumbnails
from designer.kinds.board_cuts import ring_pieces
from designer.kinds.layout import lay_out
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import parse_spec, spec_to_toml
from designer.make.bed import Plate, against_skew, bed_from_target, mapped
from designer.make.estimate import PrintEstimate, estimate
from designer.make.lip import sticker_body
from designer.make.mesh import ColouredMesh, Hull, Part, coloured, inlaid, plain_plate, plate_hull, raised, solid_hull
from designer.make.pages import Cutting, SheetPage, cuttings
from designer.make.pattern import Pattern, make_pattern
from designer.make.sheets import lay_out_sheets
from designer.page.blocks import Section
from designer.spec.build import BUILDS, CircuitInk, Format
from designer.spec.spec import Job, PrintSpec
from designer.target import TargetGeometry, target_to_json


@dataclass(frozen=True)
class Design:
    """All that follows from a job; each stage is computed once, when it is first asked for."""

    job: Job

    @cached_property
    def target(self) -> TargetGeometry:
        """The nominal geometry, which no printing option changes; for information how it is built."""
        target, printing = lay_out(self.job.target), self.job.printing
        piece = ring_pieces(target, printing.printer, self.scale) if BUILDS[printing.build].is_in_parts else None
        return replace(target, build=printing.build, has_lip=printing.lip, ring_piece=piece)

    @property
    def scale(self) -> float:
        """The printed part's size over the design's."""
        return 1 + self.job.printing.shrink_compensation_percent / 100

    @cached_property
    def printed_pattern(self) -> Pattern:
        """The ink as it is set into plastic."""
        return make_pattern(self.target, self.job.printing, scale=self.scale)

    @cached_property
    def artwork(self) -> Pattern:
        """The ink as it is printed on paper or sheet, which do not shrink."""
        return self.printed_pattern if self.scale == 1 else make_pattern(self.target, self.job.printing)

    @cached_property
    def part(self) -> Part:
        """The printed solid, ready for a slicer, with shrinkage and skew compensation."""
        spec, printing, scale = self.job.target, self.job.printing, self.scale
        if printing.way.ink == "raised":
            straight = raised(self.printed_pattern, printing.below_raised_mm(spec.depth_mm), printing.inlay_mm)
        elif printing.way.is_two_filament:
            straight = inlaid(self.printed_pattern, self._hull(printing.inlay_mm), printing.inlay_mm)
        elif spec.body is None:
            straight = Part(plain_plate(self.target.outline_mm[0], spec.depth_mm), None)
        else:
            body = sticker_body(self.target, spec.body, printing)
            straight = Part(replace(body, vertices_mm=scale * body.vertices_mm), None)
        return straight.placed(self._against_skew)

    @property
    def coloured(self) -> ColouredMesh:
        """Body and ink as one surface, flush with each other, whatever the build is."""
        mesh = coloured(self.printed_pattern, self._hull(0.0))
        return replace(mesh, surface=replace(mesh.surface, vertices_mm=self._against_skew(mesh.surface.vertices_mm)))

    @cached_property
    def plates(self) -> tuple[Plate, ...]:
        """All that is printed of plastic, plate by plate."""
        return maker_of(self.job.printing).plates(self)

    @cached_property
    def thumbnails(self) -> tuple[Thumbnails, ...]:
        """What slicers and folders show of each plate's file."""
        maker = maker_of(self.job.printing)
        return tuple(maker.thumbnails(self, plate) for plate in self.plates)

    @cached_property
    def estimate(self) -> PrintEstimate:
        """What printing all plates takes: hours, changes, filament, money."""
        return estimate(self.plates, self.job.printing)

    def _hull(self, inlay_mm: float) -> Hull:
        spec = self.job.target
        if spec.body is None:
            return plate_hull(self.printed_pattern, spec.depth_mm * self.scale, inlay_mm)
        return solid_hull(self.printed_pattern, spec.body, inlay_mm, scale=self.scale)

    def _against_skew(self, points_mm: Array) -> Array:
        return against_skew(self.target, self.job.printing, points_mm)

    @cached_property
    def pages(self) -> tuple[SheetPage, ...]:
        """Sticker sheets or board artwork."""
        return lay_out_sheets(self.target, self.artwork, self.job.printing, self.job.page, self.job.name)


class Maker(ABC):
    """What a build needs to be made, and how a maker goes about it; each has a file in `designer.builds`."""

    @abstractmethod
    def plates(self, design: Design) -> tuple[Plate, ...]:
        """All that is printed of plastic.

        Raises:
            InputError: it cannot be built so.
        """

    def sample_plates(self, design: Design) -> tuple[Plate, ...]:
        """The same for an estimate of it, which looks at one of many pieces that are alike."""
        return design.plates

    def remarks(self, design: Design) -> tuple[str, ...]:
        """What was chosen for the person in building it, a line each."""
        return ()

    def thumbnails(self, design: Design, plate: Plate) -> Thumbnails:
        """What slicers and folders show of a plate's file: the target, where it is printed as a whole."""
        return target_thumbnails(design.artwork, design.job.target, design.job.printing)

    def machine_words(self, printing: PrintSpec) -> str:
        """What it is made on, as in `all rules hold on bambu-p1s with a 0.4 mm nozzle`."""
        return f"{printing.printer.name} with a {printing.printer.nozzle_mm:g} mm nozzle"

    @abstractmethod
    def making(self, design: Design, files: Sequence[OutputFile]) -> Section:
        """The page's section on how it is made; `files` are all others of the folder."""

    @abstractmethod
    def next_step(self, design: Design, stem: str) -> str:
        """The line that says what to do with the files, whose path without suffix is `stem`."""


def maker_of(printing: PrintSpec) -> Maker:
    """The maker of a build; its module is loaded when it is asked for."""
    maker = import_module(f"designer.builds.{printing.build.replace('-', '_')}").MAKER
    assert isinstance(maker, Maker)  # noqa: S101 - what a module of `designer.builds` is for
    return maker


THREADS = 2
"""Formats that are made at a time."""

Made = Iterator[tuple[str, bytes, str]]
"""Suffix, content and purpose of files; all of them bear the job's name."""
Exporter = Callable[[Design], Made]


def make_files(design: Design, on_stage: Callable[[str], None]) -> tuple[OutputFile, ...]:
    """All files of a job. `on_stage` is told what comes next.

    Raises:
        InputError: the target cannot be made as asked.
    """
    job = design.job
    toml = spec_to_toml(job).encode()
    made = [
        ("target.json", target_to_json(design.target).encode(), "what calib reads"),
        ("toml", toml, "`design make` repeats this run"),
    ]
    # Compressing and drawing let other threads run.
    with ThreadPoolExecutor(THREADS) as pool:
        running = {name: pool.submit(lambda make: [*make(design)], EXPORTERS[name]) for name in job.formats}
        try:
            for name, files in running.items():
                on_stage(name)
                made += files.result()
        except KeyboardInterrupt:  # which threads do not hear
            pool.shutdown(wait=False, cancel_futures=True)
            for process in tuple(_PROCESSES):
                process.terminate()
            raise
    if job.printing.stand:
        on_stage("stand")
        made += _stand(design)
    if job.printing.jig:
        on_stage("jig")
        made += _jig(design)
    return tuple(OutputFile(f"{job.name}.{suffix}", content, purpose) for suffix, content, purpose in made)


# Exporters import what they need when they run: build123d takes 4 s to load.

_PROCESSES: set[subprocess.Popen[bytes]] = set()
"""At work for exporters."""


def _3mf(design: Design) -> Made:
    from designer.formats.project import files_in_turn, plate_files

    for plate, pictures in zip(design.plates, design.thumbnails, strict=True):
        files = plate_files(plate, design.job.printing, pictures)
        what = plate.words or "one object"
        filaments = "filaments 1 and 2" if plate.is_two_filament else "filament 1"
        if plate.is_raised:
            filaments = "the change of filament set"
        stem = f"{plate.name}." if plate.name else ""
        yield f"{stem}prusa.3mf", files.prusa, f"for PrusaSlicer, with settings: {what}, {filaments}"
        project = ", a project with settings" * (design.job.printing.printer.presets is not None)
        yield f"{stem}bambu.3mf", files.bambu, f"for Bambu Studio, OrcaSlicer and Cura: {what}{project}"
        if plate.is_raised:
            body, pattern = files_in_turn(plate, design.job.printing, pictures)
            yield f"{stem}body.prusa.3mf", body, "for PrusaSlicer without a pause: the plate alone, first"
            yield f"{stem}pattern.prusa.3mf", pattern, "for PrusaSlicer without a pause: the marks, onto the plate"


def _project(design: Design) -> Made:
    from designer.formats.project import MOST_PLATES, project_bytes

    plates, printing = design.plates, design.job.printing
    presets = printing.printer.presets
    if presets is None or len(plates) > MOST_PLATES:
        return
    content = project_bytes(design.job.name, plates, printing, presets, design.thumbnails)
    yield "bambu-orca.3mf", content, f"for Bambu Studio and OrcaSlicer: the {len(plates)} plates in one project"


def _painted(design: Design) -> Made:
    from designer.formats.project import painted_bytes

    (plate,), (pictures,) = design.plates, design.thumbnails
    content = painted_bytes(design.coloured, plate, design.job.printing, pictures)
    yield "painted.3mf", content, "for PrusaSlicer, Bambu Studio and OrcaSlicer: one mesh, the ink painted on"


def _stl(design: Design) -> Made:
    from designer.formats.stl import stl_bytes

    if design.job.printing.way.is_in_parts:
        for piece in (piece for plate in design.plates for piece in plate.pieces):
            stem, part = piece.name.replace(" ", "-"), piece.as_it_lies
            yield f"{stem}.stl", stl_bytes(part.body), f"{piece.name}, as it lies on the bed"
            if part.ink is not None:
                yield f"{stem}.pattern.stl", stl_bytes(part.ink), f"the ink of {piece.name}"
        return
    # As it lies when it is printed, which no STL file says, above the bed's corner.
    motion = bed_from_target(design.target, design.job.printing)
    lift_mm = np.array([0.0, 0.0, motion[2, 3]])
    part = design.part.placed(lambda points: mapped(points, motion[:3, :3]) + lift_mm)
    if part.fused is not None:
        yield "stl", stl_bytes(part.fused), "the whole, marks up, for any slicer: the filament changes below the marks"
    is_recessed = design.job.printing.way.ink == "recessed"
    what = "the bare body, without marks" if part.ink is None else f"the body{', with grooves' * is_recessed}"
    yield "body.stl", stl_bytes(part.body), what
    if part.ink is not None and not is_recessed:
        yield "pattern.stl", stl_bytes(part.ink), "the ink"


def _png(design: Design) -> Made:
    from designer.formats.png import preview_png

    job, target = design.job, design.target
    features = "rings and dots" if target.marks is None else target.feature_word
    caption = f"{job.name}: {target.ring_count} {features}, target id {target.geometry_id}"
    yield "png", preview_png(design.artwork, job.target, job.printing, caption), "a preview"


def _pdf(design: Design) -> Made:
    from designer.formats.pdf import pdf_bytes

    yield "pdf", pdf_bytes(design.pages), f"{_sheets(design)}; print at 100 %"


def _svg(design: Design) -> Made:
    from designer.formats.svg import svg_bytes

    yield "svg", svg_bytes(design.pages), f"{_sheets(design)}, for cutters and print shops"


def _shop(design: Design) -> Made:
    from designer.formats.print_shop import print_shop_files

    yield from print_shop_files(design.job.name, design.target, design.artwork, design.job.printing.ink_colour)


def _sheets(design: Design) -> str:
    count = len(design.pages)
    what = "artwork" if design.target.is_planar else "sticker sheets"
    return f"{what}, {count} page{'s' if count > 1 else ''}"


def _step(design: Design) -> Made:
    """In a process of its own: a boolean of the CAD kernel takes half a minute, and hears no Ctrl-C."""
    if find_spec("build123d") is None:
        raise InputError(
            "--formats step: needs build123d, which is not installed; pip install 'ringsolid[cad]', or leave step out"
        )
    step = apart("designer.builds.design:step_from_spec", design.job)()
    if step is None:
        raise InputError("--formats step: the CAD kernel made none of this design; leave step out")
    yield "step", step, "for CAD: true circles, coloured parts"


def apart(function: str, job: Job) -> Callable[[], bytes | None]:
    """Begin a function, "module:name", with a job in a process of its own; what is returned waits for what it writes.

    None: it failed. If it was interrupted, so is who waits: nobody wants what it was to tell.
    """
    line = "from {0} import {1}; {1}()".format(*function.split(":"))
    process = subprocess.Popen(  # noqa: S603 - this program again
        [sys.executable, "-P", "-c", line], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
    )  # fmt: skip
    _PROCESSES.add(process)
    assert process.stdin is not None  # noqa: S101 - it is a pipe
    with suppress(BrokenPipeError), process.stdin as given:
        given.write(spec_to_toml(job).encode())
    process.stdin = None  # it waits for what is written alone

    def answer() -> bytes | None:
        try:
            out, _ = process.communicate()
        finally:
            _PROCESSES.discard(process)
        if process.returncode in (-signal.SIGINT, -signal.SIGTERM):
            raise KeyboardInterrupt
        return None if process.returncode else out

    return answer


def design_apart() -> Design:
    """The design that such a function is given."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    return Design(size_job(parse_spec(tomllib.loads(sys.stdin.buffer.read().decode()), "")).job)


def step_from_spec() -> None:
    """Read a resolved spec, write its STEP file: what the process that makes it runs."""
    from designer.make.cad import step_bytes

    design = design_apart()
    job, pattern = design.job, design.printed_pattern
    sys.stdout.buffer.write(step_bytes(job.target, pattern, job.printing, name=job.name, scale=design.scale))


def _glb(design: Design) -> Made:
    from designer.formats.glb import glb_bytes

    yield "glb", glb_bytes(design.part, design.job.printing), "a coloured 3D model for viewers"


def _colour(design: Design) -> Made:
    from designer.formats.colour import colour_files

    job, laid = design.job, bed_from_target(design.target, design.job.printing)
    pictures = target_thumbnails(design.artwork, job.target, job.printing)
    yield from colour_files(job.name, design.coloured, job.printing, laid, pictures.middle)


def _simulator(design: Design) -> Made:
    """As heavy as the print; what has no printed body is taken for plastic all through."""
    from designer.formats.simulator import simulator_files, weight_of
    from designer.make.estimate import DENSITY_G_PER_CM3
    from designer.make.textured import textured

    job, takes = design.job, design.estimate
    mesh = textured(design.artwork, job.target, (job.printing.body_colour, job.printing.ink_colour))
    mass_kg = 1e-3 * (takes.body_g + takes.ink_g or 1e-3 * DENSITY_G_PER_CM3 * mesh.solid.volume_mm3)
    yield from simulator_files(job.name, mesh, weight_of(mesh, mass_kg))


def _stand(design: Design) -> Made:
    from designer.formats.stl import stl_bytes
    from designer.make.stand import make_stand

    stand = make_stand(design.target, design.job.printing)
    yield "stand.stl", stl_bytes(stand), "a stand that touches no mark"


def _jig(design: Design) -> Made:
    from designer.formats.stl import stl_bytes
    from designer.make.stand import edge_jig, tile_press

    solid, press = design.job.target.solid, tile_press(design.target, design.job.printing.printer)
    assert solid is not None  # noqa: S101 - boards have none
    yield "jig.stl", stl_bytes(edge_jig(solid)), "a V that brings two tiles to their angle"
    larger = replace(press, vertices_mm=design.scale * press.vertices_mm)
    yield "press.stl", stl_bytes(larger), "a press that meets a tile's border alone"


def _dxf(design: Design) -> Made:
    from designer.formats.dxf import dxf_bytes

    for suffix, sheet, which in _cut_sheets(design):
        content = dxf_bytes(sheet, f"{design.job.name}, target {design.target.geometry_id}")
        yield f"{suffix}dxf", content, f"for lasers and cutters{which}: layers CUT and ENGRAVE, in mm"


def _laser(design: Design) -> Made:
    from designer.formats.laser import laser_svg_bytes

    for suffix, sheet, which in _cut_sheets(design):
        yield f"{suffix}laser.svg", laser_svg_bytes(sheet), f"for lasers{which}: red lines cut, black areas engraved"


def _cut_sheets(design: Design) -> Iterator[tuple[str, Cutting, str]]:
    """Part of the file's name, what is cut, and which sheet it is; one sheet alone has no number."""
    sheets = cuttings(design.pages)
    for number, sheet in enumerate(sheets, start=1):
        yield ("", sheet, "") if len(sheets) == 1 else (f"{number}.", sheet, f", sheet {number} of {len(sheets)}")


def _circuit(design: Design, ink: CircuitInk, suffix: str, what: str) -> Made:
    from designer.formats.gerber import gerber_zip

    content = gerber_zip(design.target, design.artwork, ink, design.job.name)
    yield suffix, content, f"for a board house: {what}, as it is"


EXPORTERS: dict[Format, Exporter] = {
    "3mf": _3mf,
    "project": _project,
    "painted": _painted,
    "stl": _stl,
    "png": _png,
    "pdf": _pdf,
    "svg": _svg,
    "shop": _shop,
    "step": _step,
    "glb": _glb,
    "colour": _colour,
    "simulator": _simulator,
    "dxf": _dxf,
    "laser": _laser,
    "gerber": partial(_circuit, ink="legend", suffix="gerber.zip", what="black silkscreen on white"),
    "gerber-mask": partial(
        _circuit, ink="mask", suffix="gerber-mask.zip", what="black solder mask, opened where it is white"
    ),
}
