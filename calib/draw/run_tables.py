"""Tables of a run, for its page and for the terminal: parameters, errors, models side by side, faces of the target.

A verdict and its checks as blocks of a page.
"""

import math
from collections.abc import Sequence

import numpy as np

from calib.cameras import MODELS
from calib.cameras.camera import Camera, focal_px
from calib.cameras.field_of_view import field_of_view
from calib.cameras.surface import surface_model
from calib.core.types import UNMEASURABLE_WORDS
from calib.judge.solutions import Solution
from calib.judge.verdict import Check, Grade, Verdict
from calib.observe.dataset import Records
from calib.solver.calibration import LINEAR, Calibration, session_files
from calib.solver.metrics.evaluation import Evaluation, by_face
from calib.solver.metrics.evaluation_files import FoundParameter, Metrics
from designer.base.words import capital, printable, with_digits
from designer.base.words import figure as digits
from designer.page.blocks import Cell, Column, Finding, Findings, Headline, Level, Table
from designer.page.folders import number, whole

OF_ITS_OWN_SENSOR = (
    "fx of the virtual camera is left out: it belongs to the sensor that its map leads to, not to the photos"
)
WIDE_DEG = 100.0
"""From this field of view on the diagonal is told, too: the corners see much farther than the sides."""
STANDS_OUT = 3.0
"""A face whose error is so many times the median of all is worth a look; one seen flat has twice the usual."""


def parameters_table(metrics: Metrics) -> Table:
    """A row a parameter with its standard deviation, and the true value where the photos were rendered."""
    has_truth = any(one.true is not None for one in metrics.parameters.values())
    columns = [
        Column("parameter", is_number=False),
        Column("value"),
        Column("sigma", note="by noise, and by what the target may be off"),
        Column("unit", is_number=False),
    ]
    if has_truth:
        columns += [Column("true"), Column("off by", note="value - true, in standard deviations")]
    rows = tuple(_parameter(name, one, has_truth=has_truth) for name, one in metrics.parameters.items())
    title = f"Parameters of model {printable(metrics.model)}"
    if metrics.model in MODELS and (surface := surface_model(metrics.model)) is not None:
        title += f", without the {len(surface.parameters) - surface.first_control} control points of its surface"
    return Table(title, tuple(columns), rows, visible_rows=20)


def sessions_table(calibration: Calibration) -> Table:
    """A row a session of photos, between which the linear part varies."""
    rows = []
    for one, file in zip(calibration.sessions, session_files(calibration.sessions), strict=True):
        values = zip(one.linear.tolist(), one.sigma.tolist(), strict=True)
        cells = (Cell(f"{with_digits(value, sigma)} ± {sigma:.2g}", value) for value, sigma in values)
        rows.append((Cell(printable(one.name)), Cell(str(len(one.photos))), *cells, Cell(file)))
    columns = (
        Column("session", is_number=False), Column("photos"), *(Column(f"{name} (px)") for name in LINEAR),
        Column("file", is_number=False),
    )  # fmt: skip
    return Table("Sessions, of which the camera is the mean", columns, tuple(rows), visible_rows=20)


def _parameter(name: str, one: FoundParameter, *, has_truth: bool) -> tuple[Cell, ...]:
    spread = Cell("fixed") if one.fixed else number(one.sigma, 2)
    unit = "" if one.unit == "1" else printable(one.unit)
    row = (Cell(printable(name)), Cell(with_digits(one.value, one.sigma), one.value), spread, Cell(unit))
    if not has_truth:
        return row
    if one.true is None:
        return (*row, Cell(""), Cell(""))
    off = (one.value - one.true) / one.sigma if one.sigma > 0 else math.nan
    said = f"{round(off, 1) + 0.0:+.1f} sigma" if math.isfinite(off) else ""
    return (*row, Cell(with_digits(one.true, one.sigma), one.true), Cell(said, off))


def errors_table(metrics: Metrics) -> Table:
    """A row a metric."""
    columns = (
        Column("error", is_number=False),
        Column("unit", is_number=False),
        Column("n", note="how many errors count"),
        Column("RMSE", note="root of the mean squared length of the errors"),
        Column("mean"),
        Column("median"),
        Column("95 %", note="so many are below"),
        Column("largest"),
    )
    title = "Errors, of the photos that the camera was solved from"
    if metrics.parts:
        title = f"Errors by cross-validation: each photo with a camera solved from the others, in {metrics.parts} parts"
    if metrics.on:
        title = f"Errors of {printable(metrics.on)}, which the camera was not solved from: of these, poses only"
    rows = []
    for name, one in metrics.metrics.items():
        found = one.errors
        values = (found.rmse, found.mean, found.median, found.percentile_95, found.largest)
        cells = (number(value, 4) for value in values)
        rows.append((Cell(printable(name)), Cell(printable(one.unit)), whole(found.count), *cells))
    return Table(title, columns, tuple(rows))


def models_table(solved: Sequence[Solution]) -> Table:
    """Cameras of the same photos side by side: RMSE of each metric, and the focal length with its sigma."""
    units = {name: printable(metric.unit) for one in solved for name, metric in one.metrics.metrics.items()}
    columns = (
        Column("model", is_number=False), Column("observations"),
        *(Column(f"{printable(name)} {unit}", note="root mean square") for name, unit in units.items()),
        Column("fx px", note=OF_ITS_OWN_SENSOR), Column("status", is_number=False),
    )  # fmt: skip
    note = OF_ITS_OWN_SENSOR if any(one.calibration.camera.learned is not None for one in solved) else ""
    return Table("Models of the camera", columns, tuple(_model_row(one, tuple(units)) for one in solved), note)


def _model_row(one: Solution, names: Sequence[str]) -> tuple[Cell, ...]:
    calibration, found = one.calibration, one.metrics.metrics
    focal = (
        Cell("")
        if calibration.camera.learned is not None
        else Cell(focal_length(calibration), focal_px(calibration.camera, calibration.stated_covariance)[0])
    )
    return (
        Cell(one.model), whole(int((~calibration.is_outlier).sum())),
        *(number(found[name].errors.rmse, 4) if name in found else Cell("") for name in names), focal,
        Cell(calibration.status, level=None if calibration.status == "converged" else "bad"),
    )  # fmt: skip


def focal_length(calibration: Calibration) -> str:
    """Along u, in the middle of the image, with its standard deviation."""
    value, sigma = focal_px(calibration.camera, calibration.stated_covariance)
    return f"{with_digits(value, sigma)} ± {digits(sigma, 2)}" if math.isfinite(sigma) else f"{value:.2f}"


def faces_table(evaluation: Evaluation, records: Records | None) -> Table:
    """A row a face of the target."""
    seen = evaluation.calibration.observations
    faces, face = len(seen.points.plane), seen.points.face[seen.point]
    grouped = {e.metric: (e.unit, found) for e in evaluation.errors if (found := by_face(evaluation, e)) is not None}
    rings, expected = _rings_of_faces(records, faces)
    columns = [Column("face"), Column("photos", note="that show it"), Column("observations", note="that count")]
    if records is not None:
        note = f"in the photos in which it was read, of those that could be measured, not {UNMEASURABLE_WORDS}"
        columns.append(Column("points found %", note=note))
    columns += [Column(f"{name} {unit}", note="root mean square") for name, (unit, _) in grouped.items()]
    columns.append(Column("worst px", note="the largest residual"))
    residuals = grouped.get("reprojection")
    rows = []
    for row in range(faces):
        own = None if residuals is None else residuals[1][row]
        cells = [whole(row), whole(len(np.unique(seen.view[face == row]))), whole(0 if own is None else own.count)]
        if records is not None:
            cells.append(number(100 * rings[row] / expected[row] if expected[row] else math.nan, 3))
        cells += [number(summaries[row].rmse) for _, summaries in grouped.values()]
        rows.append((*cells, number(math.nan if own is None else own.largest)))
    return Table("Faces of the target", tuple(columns), tuple(rows), visible_rows=20)


def _rings_of_faces(records: Records | None, faces: int) -> tuple[list[int], list[int]]:
    """How many rings of each face were found in all photos, and how many could have been measured."""
    found, expected = [0] * faces, [0] * faces
    for image in () if records is None else records.images:
        for face in image.faces:
            if face.face is not None and 0 <= face.face < faces:
                found[face.face] += face.rings_found
                expected[face.face] += face.measurable
    return found, expected


def faces_words(one: Solution) -> str:
    """How even the faces are, as a sentence; a face that stands out may be printed or glued askew."""
    errors = one.evaluated.of("reprojection")
    summaries = None if errors is None else by_face(one.evaluated, errors)
    known = [] if summaries is None else [(s.rmse, row) for row, s in enumerate(summaries) if s.count]
    total = len(one.calibration.observations.points.plane)
    if not known:
        return f"None of the {total} faces has observations that count."
    (least, _), (most, worst) = min(known), max(known)
    usual = float(np.median([rmse for rmse, _ in known]))
    judged = ", which stands out: look whether it is printed or mounted askew" if most > STANDS_OUT * usual else ""
    return (
        f"{len(known)} of {total} faces were seen; the residuals of one are {digits(least, 2)} to {digits(most, 2)} px "
        f"(RMS), the largest on face {worst}{judged}."
    )


def focal_title(camera: Camera) -> str:
    """What a focal length is called: that of a learned map is none of the lens."""
    return "focal length" if camera.learned is None else "focal length of the virtual sensor"


def field_of_view_words(camera: Camera, end: str = "") -> str:
    """Angles between the light at opposite sides, and where model or image circle end if that is inside the image.

    Args:
        camera: that sees.
        end: what ends there, in words; "": the image circle if the camera says where that is, else the model.
    """
    found = field_of_view(camera)
    end = end or ("the model ends" if camera.field_rad is None else "the image circle ends")
    if not math.isfinite(found.across_rad + found.down_rad):
        return "not known"
    across, down, diagonal, off_axis = (
        math.degrees(angle) for angle in (found.across_rad, found.down_rad, found.diagonal_rad, found.off_axis_rad)
    )
    words = f"{across:.1f}° x {down:.1f}°"
    if found.ends_inside:
        return f"{words}; {end} {off_axis:.1f}° off the axis, inside the image"
    return f"{words}, diagonal {diagonal:.1f}°" if diagonal > max(across, down) > WIDE_DEG else words


LEVELS: dict[Grade, Level] = {"good": "good", "usable": "usable", "bad": "bad", "unknown": "note"}
WORDS: dict[Grade, str] = {"good": "good", "usable": "usable", "bad": "do not use", "unknown": "not checked"}


def headline_by(verdict: Verdict | None, unjudged: str = "") -> Headline:
    """The answer of a verdict; without one what there is, and what to do."""
    if verdict is None:
        return Headline("note", "not judged", unjudged)
    return Headline(LEVELS[verdict.grade], WORDS[verdict.grade], as_sentence(printable(verdict.sentence)))


def as_sentence(text: str) -> str:
    """A text with a capital and a full stop."""
    return f"{capital(text)}{'' if text.endswith(('.', '!', '?')) else '.'}"


def verdict_blocks(
    verdict: Verdict | None, faults: Sequence[str], remarks: Sequence[str], first: tuple[Finding, ...] = ()
) -> tuple[Findings, ...]:
    """The checks, and what else there is to know: what is not on the page, and what the solution says."""
    said = (
        *first, *(Finding("usable", "Not on this page", printable(fault)) for fault in faults),
        *(Finding("note", "Said by the solution", printable(remark)) for remark in remarks),
    )  # fmt: skip
    checks = () if verdict is None else check_findings(verdict)
    return tuple(Findings(rows) for rows in (checks, said) if rows)


def check_findings(verdict: Verdict) -> tuple[Finding, ...]:
    """The checks, a line each; the one that is the headline says only its numbers."""
    return tuple(finding_of(check, is_said=check.name == verdict.leads_with) for check in verdict.checks)


def finding_of(check: Check, *, is_said: bool = False) -> Finding:
    """A check as a line of findings; only its numbers where the headline says its sentence already."""
    sign = "≥" if check.is_at_least else "≤"
    rule = f"good {sign} {check.good:.4g}, usable {sign} {check.usable:.4g} {check.unit}" if check.unit else ""
    sentence = f"{WORDS[check.grade]}: {check.sentence}" if check.grade == "unknown" else check.sentence
    text = "" if is_said else as_sentence(printable(sentence))
    return Finding(LEVELS[check.grade], printable(check.title), capital(text), printable(check.measured), rule)
