"""Where points are that a rig's cameras see: `calib triangulate`, `calib.triangulate("rig.json", "sightings.csv")`."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calib.app.options import PhotoJobs
from designer.base.answer import program
from designer.base.errors import InputError
from designer.base.files import place_of
from designer.base.marks import NOT_IN_FILE, Gap, Key
from designer.base.options import argument, option
from designer.base.words import counted, printable
from designer.base.words import figure as digits
from designer.page.capability import capability
from designer.page.progress import Progress, unheard
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.cameras.rig import Rig
    from calib.core.types import RigObservations
    from calib.space.known_lengths import LengthBin, LengthCheck
    from calib.space.propagate import PointErrors, PointSightings
    from calib.space.tables import GrossSighting, SeenByCamera
    from calib.space.triangulate import TriangulatedPoints
    from designer.page.blocks import Figure, Finding, Headline, Page, Table
    from designer.target import TargetGeometry

    _Error = tuple[str, PointErrors]

POINTS_FILE, RESIDUALS_FILE = "points.csv", "residuals.csv"
MOST_DRAWN, MOST_FIGURES, MOST_ARROWS = 400, 8, 600
GOOD_SHARE, USABLE_SHARE = 0.95, 0.5
"""Of the points that two cameras or more saw, which have a position."""
GOOD_SCALE, USABLE_SCALE = 1.5, 3.0
"""Residuals over what noise and calibration leave to be expected: beyond, lens, rig or matches are wrong."""
GOOD_RATIO, USABLE_RATIO = 1.3, 2.0
"""Errors of known distances over their standard deviations, root mean square."""
MEANS = (
    "The error of a point is the root mean square of its length in space. Errors of the rig are shared by all points, "
    "so much of them cancels in distances between points that lie close together."
)
OF_TWO = "Of two cameras an error along the line of sight's image, the epipolar line, shows in no residual."
OF_MANY = "What contradicts the other cameras of its point is left out."
OWN_TARGET = (
    "the rig was solved from this very target: an error of its size is in both, so known distances and scale agree "
    "whatever it is; show a second target"
)
NO_COVARIANCE = "the rig's file tells no covariance: the sigmas are of noise alone, the rig's own errors come on top"


@dataclass(frozen=True, eq=False)
class Triangulation(
    Result, kind="triangulation", title="Triangulation", alone=POINTS_FILE,
    files={
        POINTS_FILE: "each point with its covariance: by noise, by the rig's errors, and both",
        RESIDUALS_FILE: "each sighting's residual in the image, and its ray's distance from the point",
    },
):  # fmt: skip
    """Points in the rig's frame: `found.points.position_mm`, `found.save("points.csv")`."""

    points: Annotated["TriangulatedPoints", NOT_IN_FILE]
    program: str
    settings: dict[str, str]
    frames: int
    count: Annotated[int, Key("points")]
    placed: int
    without: dict[str, int]  # reason, how many points
    cameras: "tuple[SeenByCamera, ...]"
    total: "PointErrors"
    by_noise: "PointErrors"
    by_calibration: "PointErrors"
    misclosure_px: Gap  # root mean square
    scale: Gap  # residuals over what is expected of them
    gross: "tuple[GrossSighting, ...]"  # the largest
    lengths: "LengthCheck | None"  # against the known distances of a check object
    remarks: tuple[str, ...]

    @property
    def is_negative(self) -> bool:
        """Whether no point has a position."""
        return self.placed == 0

    @property
    def seen_once(self) -> int:
        """How many points one camera saw and no other: nothing was to be triangulated there."""
        return sum(one.seen_alone for one in self.cameras)

    def page(self) -> "Page":
        """Where points lie, how surely, what contradicts, and a check object's distances."""
        return _page(self, is_drawn=True)

    def words(self, page: "Page | None" = None) -> "Page":
        """The same without figures."""
        return _page(self, is_drawn=False)

    def tables(self) -> dict[str, bytes]:
        """`points.csv` and `residuals.csv`."""
        from calib.space.tables import points_csv, residuals_csv

        return {POINTS_FILE: points_csv(self.points), RESIDUALS_FILE: residuals_csv(self.points)}


@capability
def triangulate(
    rig: Annotated["Rig | Place", argument("the rig's file: a rig.json, or another tool's")],
    sightings: Annotated[
        "PointSightings | RigObservations | Place | None",
        argument(
            "what its cameras see: camera,frame,point,u,v and perhaps sigma_px; or of a check object with X,Y,Z, as of "
            "calib rig"
        ),
    ] = None,
    *,
    target: Annotated[
        "TargetGeometry | Place | None", option("a check object (NAME.target.json), whose distances are compared")
    ] = None,
    photos: Annotated[
        "Place | Iterable[Place]",
        option(
            "of the check object: a folder that holds one a camera, named as in the rig; or again and again, a folder "
            "each",
            metavar="FOLDER",
            is_many=True,
        ),
    ] = (),
    noise_px: Annotated[
        float | Sequence[float] | None,
        option("of a sighting that states none: 0.1px (default: as the rig's file has it)", 1e-6, 1e3),
    ] = None,
    rejects: Annotated[
        bool, option("leave out sightings that contradict the others, or none", flag="--reject", off="--keep-all")
    ] = True,
    jobs: PhotoJobs = None,
    progress: Progress = unheard,
) -> Triangulation:
    """Find where points are that several cameras see, and how surely: `triangulate("rig.json", "sightings.csv")`.

    By noise and by the rig's own errors. The exit code is 1 if no point has a position.

    >>> found = calib.triangulate("rig.json", "sightings.csv")
    >>> found.points.position_mm, found.points.covariance_mm2
    >>> calib.triangulate("rig.json", target="board.target.json", photos=["left", "right"]).lengths.rms_mm

    Args:
        target: a check object, which photos of the rig's cameras show; not the one that the rig was solved from.
        noise_px: of a coordinate of a sighting that does not state its own, for all cameras or each; None: the rig's.

    Raises:
        InputError: a file that cannot be read, a camera that is not in the rig, or noise that is nowhere stated.
    """
    from calib.app.inputs import load_rig
    from calib.observe.rig_observations import read_point_table
    from calib.space.known_lengths import check_lengths, triangulate_target
    from calib.space.propagate import PointSightings, as_points
    from calib.space.triangulate import noise_of_each, triangulate_points

    known = load_rig(rig)
    noise = noise_of_each(known, noise_px)
    of_object = _seen_of_object(known, sightings, target, photos, jobs, progress)
    files = {"rig file": rig, "sightings": sightings, "check object": target}
    settings = {what: fspath(one) for what, one in files.items() if isinstance(one, str | PathLike)}
    if of_object is not None:
        seen = as_points(known, of_object)
        if known.geometry_id and of_object.points.geometry_id == known.geometry_id:
            seen = replace(seen, remarks=(*seen.remarks, OWN_TARGET))
        points = triangulate_target(known, seen, noise, rejects=rejects)
        return _told(points, settings, check_lengths(points, of_object.points.position_mm, "the check object"))
    if isinstance(sightings, str | PathLike):
        seen = read_point_table(place_of(sightings, "a table of sightings"), known)
    elif isinstance(sightings, PointSightings):
        seen = sightings
    else:
        raise InputError(f"{type(sightings).__name__}: give sightings, their table, or those of a target")
    return _told(triangulate_points(known, seen, noise, rejects=rejects), settings, None)


def _seen_of_object(
    rig: "Rig", sightings: "PointSightings | RigObservations | Place | None", target: "TargetGeometry | Place | None",
    photos: "Place | Iterable[Place]", jobs: int | None, progress: Progress,
) -> "RigObservations | None":  # fmt: skip
    """What was seen of a check object, None of points that nobody knows; InputError: what cannot be used."""
    from calib.app.inputs import require_photos_for_jobs, target_of
    from calib.capture.clips import clips_of_rig
    from calib.core.types import RigObservations
    from calib.observe.rig_observations import has_known_points, read_rig_sightings
    from calib.observe.rig_search import observations_of_rig, photos_of_rig, rig_input, search_cameras

    given = rig_input(photos, None, None, None, None)
    if (sightings is None) != bool(given.photos):
        raise InputError("give a table of sightings; or --photos of a check object with its --target")
    if sightings is None:
        if target is None:
            raise InputError("--photos: name the target file of what they show with --target")
        shown = target_of(target, "rings")
        taken = clips_of_rig(given, shown, progress) or photos_of_rig(given)
        lenses = {name: rig.cameras[rig.row(name)] for name in taken.camera_names}
        search = search_cameras(shown, taken, lenses, None, jobs, progress)
        from calib.rigs.turned_names import named_by_rig

        return named_by_rig(observations_of_rig(search), rig)
    require_photos_for_jobs(jobs)
    if isinstance(sightings, RigObservations):
        return sightings
    if isinstance(sightings, str | PathLike) and has_known_points(Path(sightings)):
        return read_rig_sightings(Path(sightings), None if target is None else target_of(target))
    if target is not None:
        raise InputError("--target: is of photos, or of a table of its points by X,Y,Z or id; leave it out")
    return None


def _told(points: "TriangulatedPoints", settings: dict[str, str], lengths: "LengthCheck | None") -> Triangulation:
    import numpy as np

    from calib.space.propagate import rms_errors
    from calib.space.tables import gross_sightings, seen_by_cameras
    from calib.space.triangulate import REASONS

    misclosure, delay = points.misclosure_px[points.is_placed], points.rig.delay_s
    remarks = list(points.sightings.remarks)
    if delay is not None and delay.any():
        remarks.append(
            f"the cameras' clocks differ by {1e3 * float(np.ptp(delay)):.3g} ms: a point is off by as far as it moves "
            "meanwhile"
        )
    return Triangulation(
        points=points, program=program(), settings=settings, frames=len(points.sightings.frame_names),
        count=points.sightings.count, placed=len(misclosure),
        without={REASONS[why]: int((points.reason == why).sum()) for why in np.unique(points.reason).tolist() if why},
        cameras=seen_by_cameras(points), total=rms_errors(points.covariance_mm2),
        by_noise=rms_errors(points.noise_mm2), by_calibration=rms_errors(points.calibration_mm2),
        misclosure_px=float(np.sqrt(np.mean(misclosure**2))) if len(misclosure) else math.nan, scale=points.scale,
        gross=gross_sightings(points), lengths=lengths,
        remarks=(*remarks, *((NO_COVARIANCE,) if points.calibration_mm2 is None else ())),
    )  # fmt: skip


def _page(found: Triangulation, *, is_drawn: bool) -> "Page":
    from calib.draw.rig_scene import rig_and_errors
    from designer.page.blocks import Facts, Findings, Page, Section
    from designer.page.folders import Shown, notes, some_of, table_of

    checks = _checks(found)
    headline = _headline(found, checks)
    points, names = found.points, found.points.rig.names
    facts = Facts((
        ("rig", f"{len(names)} cameras: {', '.join(map(printable, names))}"),
        *((name, printable(text)) for name, text in found.settings.items()),
        ("points", f"{found.count} in {counted(found.frames, 'frame')}"),
    ))  # fmt: skip
    error, camera, gross = Shown["_Error"], Shown["SeenByCamera"], Shown["GrossSighting"]
    errors = table_of(
        [("total", found.total), ("by the noise of the pixels", found.by_noise),
         ("by the rig's own errors", found.by_calibration)],
        error("error of a point", lambda row: row[0]),
        error("median mm", lambda row: row[1].median_mm, digits=3, unknown="not known"),
        error("95 % mm", lambda row: row[1].most_mm, "95 % are better", digits=3, unknown="not known"),
        error("worst mm", lambda row: row[1].worst_mm, digits=3, unknown="not known"),
    )  # fmt: skip
    cameras = table_of(
        found.cameras, camera("camera", lambda one: one.name), camera("sightings", lambda one: one.sightings),
        camera("alone", lambda one: one.seen_alone, "points that no other camera saw"),
        camera("left out", lambda one: one.left_out, "contradict the others"),
        camera("noise px", lambda one: one.noise_px, "of a coordinate, as stated, or the rig's where it is not", 3),
        camera("RMS px", lambda one: one.rms_px, "of the residuals", 3),
        camera("ray mm", lambda one: one.ray_rms_mm, "RMS of the points' distances from its rays", 3),
    )  # fmt: skip
    left_out = table_of(
        found.gross, gross("camera", lambda one: one.camera), gross("frame", lambda one: one.frame),
        gross("point", lambda one: one.point),
        gross("off by px", lambda one: one.residual_px, "from where the other cameras have the point", 3),
        title="Left out",
    )  # fmt: skip
    sections = [
        Section("Can the points be used?", (Findings(tuple(checks)), *notes(some_of(found.remarks)))),
        Section("Errors", (errors,), lead=MEANS),
        Section("Cameras", (cameras, left_out) if found.gross else (cameras,), OF_TWO if len(names) == 2 else OF_MANY),
    ]
    if found.lengths is not None:
        sections.append(Section("Known distances", (_lengths_table(found.lengths.bins),)))
    if figures := _residual_figures(found) if is_drawn else ():
        sections.append(Section("Residuals", figures, lead="Predicted less measured, in each camera's image."))
    rows = points.is_placed.nonzero()[0]
    drawn = rows[:: max(-(-len(rows) // MOST_DRAWN), 1)]
    some = "" if len(drawn) == len(rows) else f" ({len(drawn)} of {len(rows)} are drawn)"
    scene = () if found.is_negative or not is_drawn else (rig_and_errors(
        points.rig, points.position_mm[drawn], points.covariance_mm2[drawn], "Cameras and points", headline.sentence,
        f"Each point is drawn as the axes of its error{some}", "point",
    ),)  # fmt: skip
    return Page("", "", headline, tuple(sections), lead=(*scene, facts))


def _headline(found: Triangulation, checks: "list[Finding]") -> "Headline":
    """The answer: the worst of what was checked."""
    from designer.page.blocks import WORDS, Headline, worst_level

    once = found.seen_once
    alone = f"{'was' if once == 1 else 'were'} seen by one camera only"
    if found.is_negative:
        why = f"; {once} {alone}" if once else ""
        return Headline("bad", "no point", f"None of {found.count} points has a position{why}.")
    level = worst_level(checks)
    of = f"{found.count - once} points that two cameras or more saw" if once else f"{found.count} points"
    half, most = (f"{digits(value, 2)} mm" for value in (found.total.median_mm, found.total.most_mm))
    sentence = (
        f"{found.placed} of {of} have a position, half of them to {half} or better, 95 % to {most} or better (RMS of "
        f"the error in space).{f' {once} more {alone}.' if once else ''}"
    )
    return Headline(level, WORDS[level], sentence)


def _checks(found: Triangulation) -> "list[Finding]":
    """How many points have a position, how large residuals are, and what a check object says."""
    from calib.space.triangulate import ONE_CAMERA, REASONS
    from designer.page.blocks import Finding, level_of

    once, judged, check = found.seen_once, found.count - found.seen_once, found.lengths
    without = [f"{count} {why}" for why, count in found.without.items() if why != REASONS[ONE_CAMERA]]
    rows = [Finding(
        level_of(-found.placed / max(judged, 1), -GOOD_SHARE, -USABLE_SHARE), "Points with a position",
        "; ".join(without) or f"All {'that two cameras or more saw' if once else 'of them'}.",
        f"{found.placed} of {judged}", f"good from {100 * GOOD_SHARE:.0f} %",
    )]  # fmt: skip
    if once:
        by = [f"{one.seen_alone} by {printable(one.name)}" for one in found.cameras if one.seen_alone]
        rows.append(Finding(
            "note", "Seen by one camera only", f"{', '.join(by)}: nothing to triangulate, and not judged.",
            f"{once} of {found.count}",
        ))  # fmt: skip
    if math.isfinite(found.scale):
        rows.append(Finding(
            level_of(found.scale, GOOD_SCALE, USABLE_SCALE), "Residuals",
            "Against what the stated noise and the rig's covariance leave to be expected, of the usual point. Where "
            "they are larger, so are the errors of the points, by about as much.",
            f"{digits(found.scale, 2)} times", f"good up to {GOOD_SCALE:g}, usable up to {USABLE_SCALE:g}",
        ))  # fmt: skip
    if check is not None:
        percent, every = 100 * check.scale, "all pairs" if check.every == 1 else f"one of {check.every} pairs"
        rows += [Finding(
            level_of(check.ratio, GOOD_RATIO, USABLE_RATIO), "Known distances",
            f"Errors of distances on {printable(check.object_name)} are {digits(check.rms_mm, 2)} mm, "
            f"{digits(check.expected_mm, 2)} mm is to be expected by the covariances; {100 * check.within_95:.0f} % "
            "lie within their 95 % limits.",
            f"{digits(check.ratio, 2)} times", f"good up to {GOOD_RATIO:g}, usable up to {USABLE_RATIO:g}",
        ), Finding(
            "note", "Scale",
            f"Distances are measured {digits(abs(percent), 2)} % too {'long' if percent > 0 else 'short'} (sigma "
            f"{digits(100 * check.scale_sigma, 2)} %), by {every} of {check.points} points in {check.frames} frames. "
            "By how much the object itself is off, as it was printed, counts as the rig's error here.",
        )]  # fmt: skip
    return rows


def _lengths_table(bins: "tuple[LengthBin, ...]") -> "Table":
    """Errors of known distances, by distance."""
    from designer.page.blocks import Cell
    from designer.page.folders import Shown, table_of

    kind = Shown["LengthBin"]
    return table_of(
        bins,
        kind("distance mm", lambda one: Cell(f"{digits(one.from_mm, 3)} to {digits(one.to_mm, 3)}", one.from_mm)),
        kind("pairs", lambda one: one.pairs), kind("mean mm", lambda one: one.mean_mm, "measured less known"),
        kind("RMS mm", lambda one: one.rms_mm), kind("expected mm", lambda one: one.expected_mm, "by the covariances"),
        kind("within 95 %", lambda one: Cell(f"{100 * one.within_95:.0f} %", one.within_95)),
    )  # fmt: skip


def _residual_figures(found: Triangulation) -> "tuple[Figure, ...]":
    """The residuals of the first cameras that have some, as arrows over their images."""
    from calib.draw.fields import residuals_drawing
    from calib.draw.style import figure_of
    from calib.solver.metrics.residual_cells import Residuals

    figures, points = list["Figure"](), found.points
    for row, one in enumerate(found.cameras):
        is_of = points.sightings.camera == row
        used, gross = is_of & points.is_used, is_of & points.is_gross
        if used.any() and len(figures) < MOST_FIGURES:
            pixel = points.sightings.center_px
            shown = Residuals(points.rig.cameras[row].image_size, pixel[used], points.residual_px[used], pixel[gross])
            drawing = residuals_drawing(shown, one.rms_px, MOST_ARROWS)
            figures.append(figure_of(replace(drawing, title=f"Residuals of {printable(one.name)}")))
    return tuple(figures)
