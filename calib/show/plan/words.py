"""What is told of a plan of photos, on its page and on the screen."""

import math
from pathlib import Path

import numpy as np

from calib.records.plan_file import HAND, PlanRecord, photo_names
from designer.base.number_text import figure as digits
from designer.base.words import capital, printable
from designer.page.blocks import Cell, Column, Finding, Findings, Headline, Table
from designer.page.folders import number
from designer.page.terminal import quoted


def headline_of(record: PlanRecord) -> Headline:
    """How many photos, and what they reach."""
    count = len(record.photos)
    photos = f"{count} photo{'s' * (count > 1)}"
    wanted = f"wanted is {digits(record.goal_px, 2)} px"
    if not math.isfinite(record.worst_px):
        sentence = f"{photos} do not determine the camera each time they are tried: {wanted}{_missing(record)}."
        return Headline("bad", "not reached", sentence)
    reached = f"95 % of the image is known to {digits(record.worst_px, 2)} px (1 sigma) or better"
    if record.is_reached:
        return Headline("good", photos, f"{reached} in the worst of {len(record.tried)} simulated tries; {wanted}.")
    return Headline(
        "bad", "not reached", f"{reached} with {photos}, tried {len(record.tried)} times: {wanted}{_missing(record)}."
    )


def _missing(record: PlanRecord) -> str:
    """What is in the way of the goal, and what helps."""
    worst = max(record.tried, key=lambda one: one.stated_px)
    if record.table_deg is not None and worst.by_noise_px > record.goal_px:
        return ". From where it stands the camera sees too little: move it between two turns of the table"
    if record.is_limited_by_target:
        return (
            f". The target's making is {digits(worst.by_target_px, 2)} px of it: one that is made better, or measured "
            "with calib measure, helps more than photos"
        )
    if record.covered < record.goal_covered:
        return f", and {100 * record.goal_covered:.0f} % of the image, of which {100 * record.covered:.0f} % is covered"
    return ". More photos (--most), or other distances (--distance), may do"


def steps_of(record: PlanRecord, target: Path) -> tuple[str, ...]:
    """Commands to go on with, with the photos in the folder photos.

    Args:
        record: of the plan.
        target: the target's file.
    """
    named = quoted(target)
    if not record.is_limited_by_target:
        return (f"calib run {named} photos -o camera   # when they are taken, in the folder photos",)
    measured = quoted(Path("measured") / target.name)
    return (
        f"calib detect {named} photos -o seen/detections.csv   # when they are taken, in the folder photos",
        f"calib measure {named} seen/detections.csv --photos photos -o {measured}   # the target limits: measure it",
        f"calib run {measured} photos -o camera",
    )


def facts_of(record: PlanRecord) -> tuple[tuple[str, str], ...]:
    """Of what, and under which conditions."""
    camera = record.camera
    width, height = camera.image_size
    ways = {HAND: "hand, within 5° and 20 mm or 10 % of the distance of what is said (1 sigma)"}
    near, far = float(record.distance_mm.min(initial=math.inf)), float(record.distance_mm.max(initial=0.0))
    away = digits(near, 3) if digits(near, 3) == digits(far, 3) else f"{digits(near, 3)} to {digits(far, 3)}"
    return (
        ("target", printable(record.target)),
        ("camera", f"{camera.model}, {width} x {height} px, focal length {digits(float(camera.params[0]), 4)} px"),
        *((f"{name} from", printable(text)) for name, text in record.settings.items()),
        ("taken by", ways.get(record.taken_by, printable(record.taken_by))),
        ("distance", f"{away} mm"),
        ("covered", f"{100 * record.covered:.0f} % of the image"),
        ("noise", f"{digits(record.noise_px, 2)} px, of a coordinate of a large ring's centre"),
    )  # fmt: skip


def findings_of(record: PlanRecord) -> Findings:
    """What a person must know."""
    lines = (*((record.made,) if record.made else ()), *record.remarks)
    return Findings(tuple(Finding("note", "", capital(printable(line))) for line in lines))


def tried_words(record: PlanRecord) -> str:
    """How the plan was tried."""
    held = "the target held not quite as it says" if record.taken_by == HAND else "the poses exactly as they are"
    return (
        f"Photos were simulated as they are taken after the plan, with noise and {held}, and the camera was solved "
        "from them, again and again."
    )


def sentences_of(record: PlanRecord) -> tuple[str, ...]:
    """The photos in their order, as a person takes them: what each is worth by the noise alone stands in a table."""
    return tuple(capital(printable(photo.sentence.partition(": ")[0] or photo.sentence)) for photo in record.photos)


def tries_table(record: PlanRecord) -> Table:
    """What each try of the plan came to."""
    heads = (
        Column("try"), Column("95 % within px", note="of the image, 1 sigma, with the target's making"),
        Column("by noise px"), Column("by the target px", note="by its making"),
    )  # fmt: skip
    return Table("", heads, tuple(
        (Cell(str(row), float(row)), _sigma(one.stated_px), _sigma(one.by_noise_px), _sigma(one.by_target_px))
        for row, one in enumerate(record.tried, start=1)
    ))  # fmt: skip


def _sigma(value: float) -> Cell:
    return number(value, 2) if math.isfinite(value) else Cell("not determined")


def photos_table(record: PlanRecord) -> Table:
    """The photos with their numbers."""
    photos = record.photos
    columns: list[tuple[Column, list[Cell]]] = [
        (Column("photo", is_number=False), [Cell(name) for name in photo_names(len(photos))]),
        (Column("distance mm"), [number(value) for value in record.distance_mm.tolist()]),
    ]
    if np.isfinite(record.tilt_deg).any():
        columns.append(
            (Column("tilt °", note="against the image"), [number(one, 2) for one in record.tilt_deg.tolist()])
        )
    if record.table_deg is not None:
        columns.append((Column("turntable °"), [number(one) for one in record.table_deg.tolist()]))
    columns += [
        (
            Column("then 95 % within px", note="by the noise alone, if all is held as planned"),
            [_sigma(photo.sigma_px_after) for photo in photos],
        ),
        (
            Column("covered %", note="of the image, with those before"),
            [number(100 * photo.covered_after, 2) for photo in photos],
        ),
    ]
    rows = zip(*(cells for _, cells in columns), strict=True)
    return Table("", tuple(head for head, _ in columns), tuple(rows), visible_rows=40)
