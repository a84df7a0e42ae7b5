"""What is said where nothing was found, where rings are too small, and where a camera is not to be used."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.app.calibration import Run
from calib.app.calibration_page import calibration_page
from calib.app.detect import DetectedPhotos
from calib.app.report import report
from calib.core.types import Detections
from calib.detector.why_nothing import explained, why_nothing
from calib.draw.run_photos import photo_rows
from calib.draw.study_tables import fall_in_words
from calib.judge.checks import read_criteria
from calib.judge.folders import read_run
from calib.judge.judge import Judged
from calib.judge.verdict import Verdict
from calib.observe.dataset import Records, image_record
from calib.observe.photos import Search
from designer.base.errors import InputError
from designer.kinds.presets import criteria_templates
from designer.page.page_file import why_no_page
from tests.support.calibrations import board
from tests.support.picture_folders import BOARD, face, overlaid, pictures, result
from tests.support.run_folders import solved, write_run


def _discs(radius_px: float, hole: float = 0.0, count: int = 8) -> NDArray[np.uint8]:
    """A grid of dark discs on white, with white centres of so many radii, smooth as a lens makes them."""
    pixels = np.full((480, 480), 220, np.uint8)
    for row in range(count):
        for column in range(count):
            middle = (round(16 * (40 + 50 * column)), round(16 * (40 + 50 * row)))
            for size, level in ((radius_px, 30), (hole * radius_px, 220)):
                if size:
                    cv2.circle(pixels, middle, round(16 * size), level, cv2.FILLED, cv2.LINE_AA, 4)
    return pixels


@pytest.mark.parametrize("radius_px", [3.0, 3.9])
def test_rings_that_are_too_small_are_called_so(radius_px: float) -> None:
    """Many dark spots of one size below 5 px are rings too far away: how many, how large, and what to do."""
    pixels = _discs(radius_px)
    said = why_nothing(pixels, BOARD)
    assert said.startswith("64 dark spots of about ")
    drawn_px = np.sqrt((220 - pixels.astype(float)).sum() / (190 * np.pi * 64))
    assert float(said.split("about ")[1].split(" px")[0]) == pytest.approx(drawn_px, abs=0.3)
    assert "rings need about 5 px: come nearer" in said


def test_rings_that_are_large_enough_are_not_called_small() -> None:
    """Rings of 15 px that make no target are another target's; large discs are none; an empty photo tells nothing."""
    assert "in no order that fits this target" in why_nothing(_discs(15, hole=0.5), BOARD)
    assert "without the white centre" in why_nothing(_discs(15), BOARD)
    assert why_nothing(np.full((480, 480), 200, np.uint8), BOARD) == ""


def test_only_photos_without_the_target_are_explained() -> None:
    """Detections with a feature stay as they are."""
    seen = result("a.png", [face(3, 40)]).seen
    assert isinstance(seen, Detections)
    assert explained(seen, _discs(4), BOARD) is seen
    nothing = result("a.png").seen
    assert isinstance(nothing, Detections)
    assert explained(nothing, _discs(4), BOARD).remarks[-1].endswith("more pixels")


def test_a_page_without_any_target_gives_the_reason(tmp_path: Path) -> None:
    """What is said of all photos is in the headline; no ring counts as missing, and none of none is no share."""
    found = result("a.png").seen
    assert isinstance(found, Detections)
    seen = replace(found, remarks=("rings need about 5 px",))
    folder = tmp_path / "run"
    pictures(folder / "overlays", ["a.overlay.png"])
    one = replace(result("a.png", overlay="a.overlay.png"), seen=seen)
    search = Search(BOARD, (one,), (), 0, 1.0)
    page = DetectedPhotos(search, "t.json", folder / "d.csv", folder / "overlays").page_in(folder)
    assert page.headline is not None
    assert (page.headline.level, page.headline.sentence) == (
        "bad",
        "The target was found in none of 1 photo. Rings need about 5 px.",
    )
    text = repr(page)
    assert "No ring of a face that shows is missing" not in text
    assert "0 of 0" not in text
    assert "path='overlays/a.overlay.png'" in text


def test_a_camera_takes_the_place_of_nothing_found(tmp_path: Path) -> None:
    """The page of a run that found nothing gives way to a calibration's, and not to others."""
    overlaid(tmp_path)
    assert why_no_page(tmp_path, Run.kind, *Run.replaces) == ""
    assert why_no_page(tmp_path, "rig") != ""


def test_report_leads_to_the_page_of_the_overlays(tmp_path: Path) -> None:
    """A folder with overlays and no camera names the folder that has a page."""
    overlaid(tmp_path / "overlays")
    with pytest.raises(InputError, match=r"calib report .*overlays"):
        report(tmp_path)


def test_rings_of_a_photo_are_counted_as_commands_count_them(tmp_path: Path) -> None:
    """What a photo's rings are held against is what could be measured, as in overlays and on the screen."""
    every = solved()
    write_run(tmp_path / "run", every)
    run = read_run(tmp_path / "run")
    seen = result(every[0].observations.view_names[0], [face(30, 33, flat=7)]).seen
    assert isinstance(seen, Detections)
    record = image_record(seen)
    geometry = board()
    records = Records("x", geometry.layout_id, geometry.geometry_id, (record,))
    row = photo_rows(run.best.evaluation, records)[0]
    assert row.expected == record.expected == 33


@pytest.mark.parametrize("grade", ["bad", "usable"])
def test_a_camera_that_is_not_to_be_used_is_not_handed_on(grade: str, tmp_path: Path) -> None:
    """With a bad verdict the page has no command that exports the camera, and does not call it the file to use."""
    write_run(tmp_path / "run", solved())
    verdict = Verdict("bad" if grade == "bad" else "usable", "opencv", f"{grade}: so it is", (), ())
    judged = Judged(verdict, read_criteria(), None, "not tried")
    run = replace(read_run(tmp_path / "run"), judged=judged)
    text = repr(calibration_page(run, tmp_path / "run"))
    is_offered = grade != "bad"
    assert ("calib convert" in text) == ("is the file to use" in text) == is_offered
    assert ("is not to be used: see the verdict" in text) != is_offered


def test_a_fall_that_is_faster_is_no_fault() -> None:
    """Sigma against the number of views in words: as the root, not told from it, faster, slower."""
    assert "about as 1/sqrt(N)" in fall_in_words(-0.52, 0.02)
    assert "not told from 1/sqrt(N)" in fall_in_words(-0.9, 0.3)
    assert "not told from 1/sqrt(N)" in fall_in_words(-0.45, 0.6)
    assert "faster than" in fall_in_words(-1.2, 0.1)
    assert "slower than" in fall_in_words(-0.1, 0.05)


def test_a_shell_is_offered_the_templates_of_limits() -> None:
    """Those that begin as typed."""
    assert criteria_templates("") == ["metrology", "robotics", "standard"]
    assert criteria_templates("me") == ["metrology"]
