"""The page of a folder of pictures: the photos with what is told of them, and where they were taken."""

import math
from collections.abc import Sequence
from pathlib import Path

from calib.show.parts.gallery import Shot, gallery, is_there, spread, title_of_pictures
from calib.show.parts.kept_target import kept_target
from calib.show.parts.origin import Origin
from calib.show.photos.photos_file import KIND_WORDS, ToldPhotos, ToldSection, read_photos, told_table
from designer.page.blocks import Block, Command, Facts, Findings, Page, Section
from designer.page.folders import files_section, warnings


def photos_page(folder: Path, origin: Origin) -> Page:
    """Read a folder and build its page.

    Raises:
        InputError: `photos.json` cannot be read; the message names it.
    """
    told = read_photos(folder)
    places, wrong = _places(folder, told)
    blocks: tuple[Block, ...] = (
        *((Findings(told.notes),) if told.notes else ()), *warnings("File", (wrong,) if wrong else ()),
        *gallery(folder, _shots(told), told.order),
        *((told_table(told, lambda path: is_there(folder, path)),) if told.columns else ()),
    )  # fmt: skip
    sections = (
        *map(_section, told.before), Section("Photos", blocks, lead=told.lead), *places, *map(_section, told.after),
        files_section(folder, told.files, Command("calib report .", "in this folder: makes this page again")),
    )  # fmt: skip
    return Page(
        title=title_of_pictures(folder), kind=KIND_WORDS[told.kind], headline=told.headline, sections=sections,
        lead=(Facts(told.facts),), made_by=origin.command, program=origin.program,
    )  # fmt: skip


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


def _places(folder: Path, told: ToldPhotos) -> tuple[tuple[Section, ...], str]:
    """Where the photos were taken, around the target if it lies there; and why it is not used if it is no use."""
    if told.camera is None or not told.posed:
        return (), ""
    from calib.show.photos.place_scene import place_view, place_words  # slow to load, and of no use to detections

    target, wrong = kept_target(folder, told.geometry_id)
    camera = told.camera
    names = tuple(f"{photo.name}: {photo.caption}" for photo in told.posed)
    view = place_view(target, camera, told.cam_from_target, names)
    return (Section("Camera positions", (view,), lead=place_words(target, told.cam_from_target)),), wrong
