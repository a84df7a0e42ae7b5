"""The page of a folder of pictures: the photos with what is told of them, and where they were taken."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from calib.draw.gallery import Shot, gallery, is_there, spread, title_of_pictures
from calib.show.parts.kept_target import kept_target
from calib.show.parts.origin import Origin
from calib.show.photos.photos_file import KIND_WORDS, ToldPhotos, ToldSection, read_photos, told_table
from designer.page.blocks import Block, Command, Facts, Findings, Page, Section
from designer.page.folders import files_section, warnings
from designer.target import TargetGeometry


def photos_page(folder: Path, origin: Origin) -> Page:
    """Read a folder and build its page.

    Raises:
        InputError: `photos.json` cannot be read; the message names it.
    """
    told = read_photos(folder)
    target, wrong = kept_target(folder, told.geometry_id) if told.camera is not None and told.posed else (None, "")
    page = page_told(told, folder, target, wrong)
    files = files_section(folder, told.files, Command("calib report .", "in this folder: makes this page again"))
    return replace(
        page, title=title_of_pictures(folder), kind=KIND_WORDS[told.kind], sections=(*page.sections, files),
        made_by=origin.command, program=origin.program,
    )  # fmt: skip


def page_told(told: ToldPhotos, folder: Path | None, target: TargetGeometry | None, wrong: str = "") -> Page:
    """What is told of photos, as a page.

    Args:
        told: of the photos.
        folder: of their pictures; None: there are none.
        target: that they show; None: it is not drawn.
        wrong: why it is not, where it should be.
    """
    pictures = () if folder is None else gallery(folder, _shots(told), told.order)
    blocks: tuple[Block, ...] = (
        *((Findings(told.notes),) if told.notes else ()), *warnings("File", (wrong,) if wrong else ()), *pictures,
        *((told_table(told, lambda path: folder is not None and is_there(folder, path)),) if told.columns else ()),
    )  # fmt: skip
    sections = (
        *map(_section, told.before), Section("Photos", blocks, lead=told.lead),
        *(() if folder is None else _places(told, target)), *map(_section, told.after),
    )  # fmt: skip
    return Page("", "", told.headline, sections, lead=(Facts(told.facts),))


def _section(part: ToldSection) -> Section:
    return Section(part.title, part.blocks, lead=part.lead)


def _shots(told: ToldPhotos) -> Sequence[Shot]:
    """The pictures: the worst first, or as many as are shown evenly from first to last."""
    pictured = [photo for photo in told.photos if photo.picture]
    is_sorted = any(photo.badness is not None for photo in pictured)
    if is_sorted:
        pictured.sort(key=lambda photo: -math.inf if photo.badness is None else photo.badness, reverse=True)
    shots = [Shot(photo.picture, photo.name, photo.caption, photo.level) for photo in pictured]
    return shots if is_sorted else spread(shots)


def _places(told: ToldPhotos, target: TargetGeometry | None) -> tuple[Section, ...]:
    """Where the photos were taken, around the target if that is known."""
    if told.camera is None or not told.posed:
        return ()
    from calib.show.photos.place_scene import place_view, place_words  # slow to load, and of no use to detections

    names = tuple(f"{photo.name}: {photo.caption}" for photo in told.posed)
    view = place_view(target, told.camera, told.cam_from_target, names)
    return (Section("Camera positions", (view,), lead=place_words(target, told.cam_from_target)),)
