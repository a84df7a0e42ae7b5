"""What is told of a plan of photos, and of a choice of a target."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.draw.camera_scene import BODY, INK, NEXT, first_look
from calib.draw.rig_scene import body_words, view_of
from calib.draw.style import figure_of
from calib.draw.target_sketch import plan_curve, sketch
from calib.solver.metrics.errors import centers_mm
from designer.base.words import counted, printable
from designer.base.words import figure as digits
from designer.page.blocks import (
    Cell,
    Command,
    Facts,
    Fold,
    Gallery,
    Headline,
    Level,
    Page,
    Picture,
    Section,
    Table,
    View3d,
)
from designer.page.folders import Shown, notes, table_of
from designer.page.scene import Scene
from designer.page.terminal import quoted
from designer.target_scene import camera_layer, camera_size_mm, target_layers

if TYPE_CHECKING:
    from calib.app.choose import Candidate, TargetChoice
    from calib.app.plan import PhotoPlan

OPEN = "not determined"
BY_HAND = "hand, within 5° and 20 mm or 10 % of the distance of what is said (1 sigma)"


def plan_page(found: "PhotoPlan") -> Page:
    """Photos to take, each as it will look, and what they are worth."""
    pictures = tuple(
        Picture(sketch(found.camera, found.geometry, photo.cam_from_target), name, text)
        for photo, name, text in zip(found.photos, found.photo_names, found.sentences, strict=True)
    )
    gallery = Gallery(pictures, "As the camera will see it. A click enlarges a picture.", said_as="photos")
    held = "the target held not quite as it says" if found.is_by_hand else "the poses exactly as they are"
    tried = (
        f"Photos were simulated as they are taken after the plan, with noise and {held}, and the camera was solved "
        "from them, again and again."
    )
    after_px = [photo.sigma_px_after for photo in found.photos]
    drawn = plan_curve(after_px, [one.stated_px for one in found.tried], found.goal_px)
    reached = (
        f"{digits(after_px[-1], 2)} px after {len(after_px)} photos, as planned; wanted: {digits(found.goal_px, 2)} px"
    )
    curve = figure_of(drawn, alt=reached)
    made = (found.made,) if found.made else ()
    sections = (
        Section("The photos", (gallery,), lead="In this order; left, right, top and bottom are those of the image."),
        Section("In 3D", (_scene(found),)),
        Section("What they are worth", (curve, _tries(found), *notes((*made, *found.remarks))), lead=tried),
        Section("In numbers", (_photos(found),)),
    )
    return Page("", "", _headline(found), sections, lead=(_facts(found),), next_steps=_steps(found))


def _headline(found: "PhotoPlan") -> Headline:
    """How many photos, and what they reach."""
    count = len(found.photos)
    photos = counted(count, "photo")
    wanted = f"wanted is {digits(found.goal_px, 2)} px"
    reached = f"95 % of the image is known to {digits(found.worst_px, 2)} px (1 sigma) or better"
    if found.is_reached:
        return Headline("good", photos, f"{reached} in the worst of {len(found.tried)} simulated tries; {wanted}.")
    said = f"{reached} with {photos}, tried {len(found.tried)} times"
    if not math.isfinite(found.worst_px):
        said = f"{photos} do not determine the camera each time they are tried"
    return Headline("bad", "not reached", f"{said}: {wanted}{_missing(found)}.")


def _missing(found: "PhotoPlan") -> str:
    """What is in the way of the goal, and what helps."""
    if found.table_deg is not None and found.worst.by_noise_px > found.goal_px:
        return ". From where it stands the camera sees too little: move it between two turns of the table"
    if found.is_limited_by_target:
        return (
            f". The target's making is {digits(found.worst.by_target_px, 2)} px of it: one that is made better, or "
            "measured with calib measure, helps more than photos"
        )
    if found.covered < found.goal_covered:
        return f", and {100 * found.goal_covered:.0f} % of the image, of which {100 * found.covered:.0f} % is covered"
    return ". More photos (--most), or other distances (--distance), may do"


def _steps(found: "PhotoPlan") -> tuple[Command, ...]:
    """Commands to go on with, with the photos in the folder photos."""
    target = Path(found.settings.get("target", "NAME.target.json"))
    taken = "when they are taken, in the folder photos"
    if not found.is_limited_by_target:
        return (Command(f"calib run {quoted(target)} photos -o camera", taken),)
    seen, measured = "seen/detections.csv", quoted(Path("measured") / target.name)
    return (
        Command(f"calib detect {quoted(target)} photos -o {seen}", taken),
        Command(
            f"calib measure {quoted(target)} {seen} --photos photos -o {measured}", "the target limits: measure it"
        ),
        Command(f"calib run {measured} photos -o camera"),
    )


def _facts(found: "PhotoPlan") -> Facts:
    """Of what, and under which conditions."""
    camera = found.camera
    width, height = camera.image_size
    near, far = (digits(float(one), 3) for one in (found.distance_mm.min(), found.distance_mm.max()))
    return Facts((
        ("target", printable(found.target)),
        ("camera", f"{camera.model}, {width} x {height} px, focal length {digits(float(camera.params[0]), 4)} px"),
        *((f"{name} from", printable(text)) for name, text in found.settings.items()),
        ("taken by", BY_HAND if found.is_by_hand else printable(found.taken_by)),
        ("distance", f"{near if near == far else f'{near} to {far}'} mm"),
        ("covered", f"{100 * found.covered:.0f} % of the image"),
        ("noise", f"{digits(found.noise_px, 2)} px, of a coordinate of a large mark"),
    ))  # fmt: skip


def _tries(found: "PhotoPlan") -> Table:
    """What each try of the plan came to."""
    kind = Shown[int]
    return table_of(
        range(len(found.tried)), kind("try", lambda row: row + 1),
        kind("95 % within px", lambda row: found.tried[row].stated_px, "of the image, 1 sigma, with the target's "
             "making", unknown=OPEN),
        kind("by noise px", lambda row: found.tried[row].by_noise_px, unknown=OPEN),
        kind("by the target px", lambda row: found.tried[row].by_target_px, "by its making", unknown=OPEN),
    )  # fmt: skip


def _photos(found: "PhotoPlan") -> Table:
    """The photos with their numbers."""
    kind, tilt_deg, table_deg = Shown[int], found.tilt_deg.tolist(), found.table_deg
    within, covered = "by the noise alone, if all is held as planned", "of the image, with those before"
    tilt = kind("tilt °", lambda row: float(tilt_deg[row]), "against the image")
    return table_of(
        range(len(found.photos)), kind("photo", lambda row: found.photo_names[row]),
        kind("distance mm", lambda row: float(found.distance_mm[row]), digits=3),
        *((tilt,) if any(map(math.isfinite, tilt_deg)) else ()),
        *(() if table_deg is None else (kind("turntable °", lambda row: float(table_deg[row]), digits=3),)),
        kind("then 95 % within px", lambda row: found.photos[row].sigma_px_after, within, unknown=OPEN),
        kind("covered %", lambda row: 100 * found.photos[row].covered_after, covered), visible_rows=40,
    )  # fmt: skip


def _scene(found: "PhotoPlan") -> View3d:
    """Camera and target in 3D."""
    poses, sight = np.stack([photo.cam_from_target for photo in found.photos]), view_of(found.camera)
    names = tuple(f"{name}: {text}" for name, text in zip(found.photo_names, found.sentences, strict=True))
    cameras = camera_layer(poses, sight, names, (NEXT,), camera_size_mm(poses))
    up, from_direction = first_look(poses, centers_mm(poses), is_flat=found.geometry.is_planar)
    layers = (*target_layers(found.geometry, body_colour=BODY, ink_colour=INK), cameras)
    return View3d(
        "The camera around the target",
        Scene(layers, up, from_direction, ((NEXT, "photo to take"),)),
        f"{len(poses)} photos around the target.",
        f"Each {body_words(sight)} is a photo to take. Point at one for what to do.",
    )


AS_DRAWN = "of a target exactly as drawn: by the noise of the photos alone"


def choice_page(found: "TargetChoice") -> Page:
    """The recommended one, what the others come to, and a few of its photos."""
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
