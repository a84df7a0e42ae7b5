"""Tables of a calibration's page: parameters, metrics, models side by side, faces of the target."""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from calib.cameras import MODELS
from calib.core.number_text import figure as digits
from calib.core.number_text import with_digits
from calib.core.types import UNMEASURABLE_WORDS
from calib.metrics import OF_TRUTH
from calib.metrics.errors import ErrorSummary, summarise
from calib.metrics.evaluation import by_face
from calib.observe.records import Records
from calib.records.evaluation_files import Metrics, MetricSummary
from calib.records.run_folder import Solved
from calib.show.parts.folder_blocks import number, whole
from calib.show.run.evaluation_table import OF_ITS_OWN_SENSOR, focal_length
from calib.solver.calibration import Calibration
from designer.base.words import printable
from designer.page.blocks import Cell, Column, Table

METRIC_COLUMNS = (
    Column("error", is_number=False),
    Column("unit", is_number=False),
    Column("n", note="how many errors count"),
    Column("RMSE", note="root of the mean squared length of the errors"),
    Column("mean"),
    Column("median"),
    Column("95 %", note="so many are below"),
    Column("largest"),
)
STANDS_OUT = 3.0
"""A face whose error is so many times the median of all is worth a look; one seen flat has twice the usual."""


def parameters_table(one: Solved) -> Table:
    """A row a parameter with its standard deviation, and the true value where the photos were rendered."""
    calibration = one.calibration
    camera = calibration.camera
    sigmas = np.sqrt(np.diagonal(calibration.stated_covariance)).tolist()
    stored = {} if one.stored is None else one.stored.parameters
    has_truth = any(entry.true is not None for entry in stored.values())
    columns = [
        Column("parameter", is_number=False),
        Column("value"),
        Column("sigma", note="by noise, and by what the target may be off"),
        Column("unit", is_number=False),
    ]
    if has_truth:
        columns += [Column("true"), Column("off by", note="value - true, in standard deviations")]
    rows = []
    for n, (parameter, sigma) in enumerate(zip(MODELS[camera.model].parameters, sigmas, strict=True)):
        value = float(camera.params[n])
        spread = Cell("fixed") if parameter.name in calibration.fixed else number(sigma, 2)
        unit = "" if parameter.unit == "1" else parameter.unit
        row = [Cell(parameter.name), Cell(with_digits(value, sigma), value), spread, Cell(unit)]
        if has_truth:
            entry = stored.get(parameter.name)
            row += _truth_cells(value, sigma, None if entry is None else entry.true)
        rows.append(tuple(row))
    return Table(f"Parameters of model {camera.model}", tuple(columns), tuple(rows), visible_rows=20)


def _truth_cells(value: float, sigma: float, true: float | None) -> list[Cell]:
    if true is None:
        return [Cell(""), Cell("")]
    off = (value - true) / sigma if sigma > 0 else math.nan
    return [
        Cell(with_digits(true, sigma), true),
        Cell(f"{round(off, 1) + 0.0:+.1f} sigma" if math.isfinite(off) else "", off),
    ]


def metrics_table(one: Solved) -> Table:
    """A row a metric, of the photos that the camera was solved from."""
    rows = [_metric_row(e.metric, e.unit, summarise(e)) for e in one.evaluation.errors]
    if one.stored is not None and not one.stored.parts:
        rows += [
            _metric_row(printable(name), printable(metric.unit), metric.errors)
            for name, metric in one.stored.metrics.items()
            if name in OF_TRUTH
        ]
    return Table("Errors, of the photos that the camera was solved from", METRIC_COLUMNS, tuple(rows))


def held_out_table(stored: Metrics) -> Table:
    """The same of photos that were held out, as `calib evaluate --held-out` left it."""
    rows = [_metric_row(printable(k), printable(metric.unit), metric.errors) for k, metric in stored.metrics.items()]
    title = f"Errors of photos that were held out of the solution in turn, in {stored.parts} parts"
    return Table(title, METRIC_COLUMNS, tuple(rows))


def _metric_row(name: str, unit: str, found: ErrorSummary) -> tuple[Cell, ...]:
    values = (found.rmse, found.mean, found.median, found.percentile_95, found.largest)
    return (Cell(name), Cell(unit), whole(found.count), *(number(value, 4) for value in values))


def models_table(solved: Sequence[Solved]) -> Table:
    """Cameras of the same photos side by side."""
    names = list(dict.fromkeys(errors.metric for one in solved for errors in one.evaluation.errors))
    units = {errors.metric: errors.unit for one in solved for errors in one.evaluation.errors}
    poses = [name for name in OF_TRUTH if any(_stored(one, name) is not None for one in solved)]
    units |= {name: metric.unit for one in solved for name in poses if (metric := _stored(one, name)) is not None}
    columns = (
        Column("model", is_number=False), Column("sightings"),
        *(Column(f"{name} {printable(units[name])}", note="root mean square") for name in (*names, *poses)),
        Column("fx px", note=OF_ITS_OWN_SENSOR), Column("status", is_number=False),
    )  # fmt: skip
    note = OF_ITS_OWN_SENSOR if any(one.calibration.camera.learned is not None for one in solved) else ""
    return Table("Models of the camera", columns, tuple(_model_row(one, names, poses) for one in solved), note)


def _model_row(one: Solved, names: Iterable[str], poses: Iterable[str]) -> tuple[Cell, ...]:
    calibration = one.calibration
    found = [one.evaluation.of(name) for name in names]
    stored = [_stored(one, name) for name in poses]
    return (
        Cell(one.model), whole(int((~calibration.is_outlier).sum())),
        *(Cell("") if errors is None else number(summarise(errors).rmse, 4) for errors in found),
        *(
            number(metric.errors.rmse, 4) if metric is not None and math.isfinite(metric.errors.rmse) else Cell("")
            for metric in stored
        ),
        _focal_cell(calibration),
        Cell(calibration.status, level=None if calibration.status == "converged" else "bad"),
    )  # fmt: skip


def _focal_cell(calibration: Calibration) -> Cell:
    """`fx`; of a learned map it is that of a sensor of its own, beside which others mean nothing."""
    if calibration.camera.learned is not None:
        return Cell("")
    return Cell(focal_length(calibration).replace("+-", "±"), float(calibration.camera.params[0]))


def _stored(one: Solved, name: str) -> MetricSummary | None:
    """A metric that only `metrics.json` holds."""
    return None if one.stored is None or one.stored.parts else one.stored.metrics.get(name)


def faces_table(one: Solved, records: Records | None) -> Table:
    """A row a face of the target."""
    faces = len(one.calibration.observations.points.plane)
    seen = one.calibration.observations
    face = seen.points.face[seen.point]
    photos = [len(np.unique(seen.view[face == row])) for row in range(faces)]
    grouped = [(e, found) for e in one.evaluation.errors if (found := by_face(one.evaluation, e)) is not None]
    rings, expected = _rings_of_faces(records, faces)
    columns = [Column("face"), Column("photos", note="that show it"), Column("sightings", note="that count")]
    if records is not None:
        columns.append(
            Column(
                "rings found %",
                note=f"in the photos in which it was read, of those that could be measured, not {UNMEASURABLE_WORDS}",
            )
        )
    columns += [Column(f"{e.metric} {e.unit}", note="root mean square") for e, _ in grouped]
    columns.append(Column("worst px", note="the largest that is left over"))
    reprojection = next((summaries for e, summaries in grouped if e.metric == "reprojection"), None)
    rows = []
    for row in range(faces):
        cells = [whole(row), whole(photos[row]), whole(0 if reprojection is None else reprojection[row].count)]
        if records is not None:
            cells.append(number(100 * rings[row] / expected[row] if expected[row] else math.nan, 3))
        cells += [number(summaries[row].rmse) for _, summaries in grouped]
        cells.append(number(math.nan if reprojection is None else reprojection[row].largest))
        rows.append(tuple(cells))
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


def faces_words(one: Solved) -> str:
    """How even the faces are, as a sentence; a face that stands out may be printed or glued askew."""
    errors = one.evaluation.of("reprojection")
    summaries = None if errors is None else by_face(one.evaluation, errors)
    known = [] if summaries is None else [(s.rmse, row) for row, s in enumerate(summaries) if s.count]
    total = len(one.calibration.observations.points.plane)
    if not known:
        return f"None of the {total} faces has sightings that count."
    (least, _), (most, worst) = min(known), max(known)
    usual = float(np.median([rmse for rmse, _ in known]))
    words = f"{len(known)} of {total} faces were seen; what is left over of one is {digits(least, 2)} to "
    words += f"{digits(most, 2)} px, most on face {worst}"
    judged = ", which stands out: look whether it is printed or mounted askew" if most > STANDS_OUT * usual else ""
    return f"{words}{judged}."
