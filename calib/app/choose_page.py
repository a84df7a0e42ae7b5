"""What is told of a choice of a target."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from designer.base.words import figure as digits
from designer.base.words import printable
from designer.page.blocks import Cell, Command, Facts, Fold, Gallery, Headline, Level, Page, Picture, Section, Table
from designer.page.folders import Shown, notes, table_of

if TYPE_CHECKING:
    from calib.app.choose import Candidate, TargetChoice

AS_DRAWN = "of a target exactly as drawn: by the noise of the photos alone"


def choice_page(found: "TargetChoice") -> Page:
    """The recommended one, what the others come to, and a few of its photos."""
    from calib.draw.target_sketch import sketch

    first, (near, far), rig = found.shortlist[0], found.distance_mm, found.forecast.found
    poses = rig.rig_from_target[rig.observations.frame[0]]  # as the first camera sees it
    within = f"95 % of the image is then known to {digits(first.made.image_px, 2)} px (1 sigma)"
    if found.cameras > 1:
        within += f", a point in the middle of the volume to {digits(first.made.point_mm, 2)} mm"
    wanted = "" if math.isnan(found.goal_px) else f"; wanted: {digits(found.goal_px, 2)} px"
    level: Level = "bad" if found.is_negative else "good" if wanted else "note"
    away_mm = (poses[:, :3, 3] ** 2).sum(axis=1) ** 0.5
    rows = away_mm.argsort()[[0, len(poses) // 3, 2 * len(poses) // 3, -1]].tolist()
    pictures = tuple(
        Picture(sketch(found.stage.camera, found.geometry, poses[row]), f"frame {row}", f"{away_mm[row]:.0f} mm away")
        for row in rows
    )
    facts = Facts((
        ("cameras", f"{found.cameras}, {found.model}, {near:.0f} to {far:.0f} mm from the volume's front and back"),
        *((name, printable(text)) for name, text in found.settings.items()),
        ("photos", f"{found.photos} of each camera"),
    ))  # fmt: skip
    fold = (Fold("Other sizes that were looked at", (_table(found, found.others),)),) if found.others else ()
    order = "The recommended one first, then the surest."
    first_one = "first " if found.cameras > 1 else ""
    sections = (
        Section("Which target", (_table(found, found.shortlist), *fold), lead=order),
        Section(f"What the {first_one}camera will see", (Gallery(pictures),)),
        Section("Assumptions", notes(found.remarks)),
    )  # fmt: skip
    headline = Headline(level, first.named, f"{within}{wanted}. Why this one: {found.reason}.")
    return Page("", "", headline, sections, lead=(facts,), next_steps=(Command(first.command, "makes it"),))


def _table(found: "TargetChoice", rows: "Sequence[Candidate]") -> Table:
    """Candidates, and what they come to."""
    kind = Shown["Candidate"]
    photos = "that reach the goal" if math.isfinite(found.goal_px) else "from which on more do little"
    hours = "of printing and work, by the error template's law; of the first as estimated for the printer"
    space = (
        kind("space mm", lambda one: one.made.point_mm, "a point in the middle of the volume, as it is made"),
        kind("as drawn mm", lambda one: one.optics.point_mm, AS_DRAWN),
        kind("baseline mm", lambda one: one.made.baseline_mm, "the distance of two cameras, as it is made"),
    )
    return table_of(
        rows, kind("target", lambda one: one.named), kind("rings", lambda one: round(one.rings), "in a photo"),
        kind("radius px", lambda one: one.far_radius_px, "of a ring at the far end of the volume"),
        *(space if found.cameras > 1 else ()),
        kind("image px", lambda one: one.made.image_px, "what 95 % of it stays within, 1 sigma, as it is made"),
        kind("as drawn px", lambda one: one.optics.image_px, AS_DRAWN),
        kind("focal px", lambda one: one.made.focal_px, "of the focal length, as it is made"),
        kind("photos", lambda one: one.photos, f"of each camera, {photos}", unknown="more"),
        kind("hours", lambda one: Cell(digits(one.hours, 2), one.hours, level="usable" if one.faults else None), hours),
        kind("price EUR", lambda one: one.price_eur, unknown="-"), kind("command", lambda one: one.command),
    )  # fmt: skip
