"""The page of `calib plan`: photos to take, each as it will look, and what they are worth."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from calib.draw.rig_scene import body_words, view_of
from calib.draw.style import BLUE, GREY, VERMILION, AxesDrawing, open_axes, svg_panel
from calib.metrics.errors import centers_mm
from calib.records.plan_file import PLAN, PLAN_FILE, POSES_FILE, PlanRecord, photo_names
from calib.show.parts.kept_target import TARGET_FILE, kept_target
from calib.show.parts.origin import Origin
from calib.show.plan.sketch import sketch
from calib.show.plan.words import (
    facts_of,
    findings_of,
    headline_of,
    photos_table,
    sentences_of,
    tried_words,
    tries_table,
)
from calib.show.run.camera_scene import (
    BODY,
    INK,
    NEXT,
    first_look,
)
from designer.page.blocks import (
    Block,
    Command,
    Facts,
    Figure,
    Finding,
    Findings,
    Gallery,
    Page,
    Picture,
    Section,
    Steps,
    View3d,
)
from designer.page.folders import files_section, title_of
from designer.page.pictures import drawing_of_svg
from designer.page.scene import Scene
from designer.target import TargetGeometry
from designer.target_scene import camera_layer, camera_size_mm, target_layers

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FILES = (
    (POSES_FILE, "the poses, or the turntable's angles, for a robot or a program"),
    (PLAN_FILE, "what this page is built from"),
    (TARGET_FILE, "the target"),
)
PANEL_IN = 3.4


def plan_page(folder: Path, origin: Origin) -> Page:
    """The page of a plan's folder.

    Raises:
        InputError: `plan.json` cannot be read; the message names it.
    """
    record = PLAN.read(folder / PLAN_FILE)
    target, why = kept_target(folder, record.geometry_id)
    lacks = Findings((Finding("usable", "Not on this page", why),)) if why else None
    photos: Block = Steps(sentences_of(record)) if target is None else _pictures(record, target)
    sections = [
        Section("The photos", (photos,), lead="In this order; left, right, top and bottom are those of the image."),
        Section(
            "What they are worth", (_curve(record), tries_table(record), findings_of(record)), lead=tried_words(record)
        ),
        Section("In numbers", (photos_table(record),)),
    ]
    if target is not None:
        sections.insert(1, Section("In 3D", (_scene(record, target),)))
    again = files_section(folder, FILES, Command("calib report .", "makes this page again"))
    headline = headline_of(record)
    return Page(
        title_of(folder), "Plan of photos", headline, (*sections, again),
        lead=(Facts(facts_of(record)), *((lacks,) if lacks else ())), made_by=origin.command, program=origin.program,
        is_negative=not record.is_reached,
    )  # fmt: skip


def _pictures(record: PlanRecord, target: TargetGeometry) -> Gallery:
    """Each photo as it will look."""
    pictures = (
        Picture(sketch(record.camera, target, photo.cam_from_target), name, text)
        for name, photo, text in zip(photo_names(len(record.photos)), record.photos, sentences_of(record), strict=True)
    )
    return Gallery(tuple(pictures), "As the camera will see it. A click enlarges a picture.")


def _curve(record: PlanRecord) -> Figure:
    """What is known after each photo, and what the tries came to."""
    words = "Each photo makes the camera better known; dots are the tries after the last one"
    drawing = AxesDrawing("What is known after each photo", words, lambda axes: _draw(axes, record))
    svg = drawing_of_svg(svg_panel(drawing.draw, height_in=PANEL_IN))
    return Figure(drawing.title, svg, words, f"{words}.")


def _draw(axes: "Axes", record: PlanRecord) -> None:
    from matplotlib.ticker import LogLocator, MaxNLocator

    after = np.array([photo.sigma_px_after for photo in record.photos])
    tried = np.array([one.stated_px for one in record.tried])
    count, known = np.arange(1, len(after) + 1), np.isfinite(after) & (after > 0)
    axes.plot(count[known], after[known], "-o", color=BLUE, label="as planned, by the noise", linewidth=2)
    done = tried[np.isfinite(tried) & (tried > 0)]
    axes.plot(
        np.full(len(done), len(after)), done, "D", color=VERMILION, label="tried, with the target's making", zorder=3
    )
    axes.axhline(record.goal_px, color=GREY, linestyle="--", label="wanted")
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(loc="upper right")
    open_axes(axes, "photos", "95 % within, px (1 sigma)")


def _scene(record: PlanRecord, target: TargetGeometry) -> View3d:
    """Camera and target in 3D."""
    poses, sight = np.stack([photo.cam_from_target for photo in record.photos]), view_of(record.camera)
    names = tuple(f"{name}: {text}" for name, text in zip(photo_names(len(poses)), sentences_of(record), strict=True))
    cameras = camera_layer(poses, sight, names, (NEXT,), camera_size_mm(poses))
    up, from_direction = first_look(poses, centers_mm(poses), is_flat=target.is_planar)
    layers = (*target_layers(target, body_colour=BODY, ink_colour=INK), cameras)
    return View3d(
        "The camera around the target", Scene(layers, up, from_direction, ((NEXT, "photo to take"),)),
        f"{len(poses)} photos around the target.",
        f"Each {body_words(sight)} is a photo to take. Point at one for what to do.",
    )  # fmt: skip
