"""The page of a folder of pictures: the photos with what is told of them, and where they were taken."""

import math
from collections.abc import Sequence
from pathlib import Path

from calib.draw.gallery import Shot, gallery, is_there, spread
from calib.show.photos.photos_file import ToldPhotos, ToldSection, told_table
from designer.page.blocks import Block, Facts, Findings, Page, Section
from designer.target import TargetGeometry


def page_told(told: ToldPhotos, folder: Path | None, target: TargetGeometry | None) -> Page:
    """What is told of photos, as a page.

    Args:
        told: of the photos.
        folder: of their pictures; None: there are none.
        target: that they show; None: it is not drawn.
    """
    pictures = () if folder is None else gallery(folder, _shots(told), told.order)
    blocks: tuple[Block, ...] = (
        *((Findings(told.notes),) if told.notes else ()), *pictures,
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
