"""The kinds of folders that have a page, and what builds the page of each. Builders are loaded when they are needed."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeAlias

from calib.show.parts.origin import Origin
from designer.page.blocks import Page

Builder: TypeAlias = Callable[[Path, Origin], Page]


def _calibration(folder: Path, origin: Origin) -> Page:
    from calib.show.run.calibration_page import calibration_page

    return calibration_page(folder, origin)


def _bootstrap(folder: Path, origin: Origin) -> Page:
    from calib.show.studies.study_page import bootstrap_page

    return bootstrap_page(folder, origin)


def _paper(folder: Path, origin: Origin) -> Page:
    from calib.show.studies.study_page import paper_page

    return paper_page(folder, origin)


def _tolerance(folder: Path, origin: Origin) -> Page:
    from calib.show.studies.tolerance_page import tolerance_page

    return tolerance_page(folder, origin)


def _compare(folder: Path, origin: Origin) -> Page:
    from calib.show.studies.compare_page import compare_page

    return compare_page(folder, origin)


def _measure(folder: Path, origin: Origin) -> Page:
    from calib.show.measured.measure_page import measure_page

    return measure_page(folder, origin)


def _photos(folder: Path, origin: Origin) -> Page:
    from calib.show.photos.photos_page import photos_page

    return photos_page(folder, origin)


KINDS: Mapping[str, Builder] = {
    "calibration": _calibration,
    "bootstrap": _bootstrap,
    "paper": _paper,
    "tolerance": _tolerance,
    "compare": _compare,
    "measure": _measure,
    "photos": _photos,
    "undistorted": _photos,
    "detections": _photos,
    "poses": _photos,
}
