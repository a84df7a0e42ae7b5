"""The page of a measured print: deviations, gain and what to dial in are those that were measured."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.app.measure_page import face_sentence
from calib.app.measured_print import MeasuredPrint
from calib.draw.measured_scene import COLOURS, colour, nice
from calib.measure_target.deviations import Estimate, Verdict
from calib.measure_target.record import deviations_of
from designer.page.blocks import FileList, View3d
from designer.page.shell import page_html
from tests.support.command_line import PICTURE
from tests.support.measured_prints import measured_print
from tests.support.pages import blocks_of, table_of


@pytest.fixture(autouse=True)
def measured(monkeypatch: pytest.MonkeyPatch) -> MeasuredPrint:
    """A measured print, whose picture is not drawn, which takes long."""
    monkeypatch.setattr("calib.draw.measured_picture.picture", lambda *_: PICTURE)
    return measured_print()


def changed(measured: MeasuredPrint, **fields: object) -> MeasuredPrint:
    """The print with other fields in its record."""
    return replace(measured, record=replace(measured.record, **fields))  # type: ignore[arg-type]


def test_faces_and_rings_are_those_of_the_report(measured: MeasuredPrint) -> None:
    """Shifts in mm, tilts in degrees, offsets of rings: as stored; more than noise has a star, if the face moved."""
    document, page = measured.document(), measured.page()
    table = table_of(page, "How the faces lie")
    assert len(table.rows) == 20
    for row in table.rows:
        face = int(row[0].text)
        motion = np.array(document["face_motion"])[face]
        assert [cell.value for cell in row[3:]] == pytest.approx([*motion[3:], *np.degrees(motion[:3])])
        variance = np.diagonal(np.array(document["face_motion_covariance"], dtype=float))
        sigma = np.sqrt([variance[6 * face + k] for k in (3, 4, 5, 0, 1, 2)])
        starred = [cell.text.endswith("*") for cell in row[3:]]
        has_moved = row[1].text == "moved"
        assert starred == (has_moved & (np.abs([*motion[3:], *motion[:3]]) > 3 * sigma)).tolist()
    rings = table_of(page, "How the rings lie")
    size = [row[-2].value or 0.0 for row in rings.rows]
    assert size == sorted(size, reverse=True)
    first = rings.rows[0]
    assert [cell.value for cell in first[3:6]] == measured.record.ring_offset_mm[int(first[0].text)].tolist()


def test_the_answer_follows_from_photos_held_out(measured: MeasuredPrint) -> None:
    """What leaves less in photos held out is better, what does not is not; nothing held out: a note."""
    headline, held = measured.page().headline, measured.record.held_out
    assert headline is not None
    assert held is not None
    assert headline.level == "good"
    factor = next(one.factor for one in held.gains if one.metric == "intersection")
    assert f"{factor:.0f} times smaller" in headline.sentence or f"{factor:.1f} times" in headline.sentence
    chance, unsure = (
        replace(held, gains=tuple(replace(one, least_factor=least) for one in held.gains)) for least in (0.9, None)
    )
    for other, level, is_negative in (
        (changed(measured, held_out=chance), "usable", True),
        (changed(measured, held_out=unsure), "note", True),
        (changed(measured, held_out=None), "note", False),
        (changed(measured, status="degenerate", remarks=("too few views",)), "bad", True),
    ):
        headline = other.page().headline
        assert headline is not None
        assert headline.level == level
        assert other.is_negative == is_negative


def test_faces_that_are_not_judged_are_counted(measured: MeasuredPrint) -> None:
    """That no face moved is said of those that photos judge, and how many others there are."""
    cases: tuple[tuple[list[Verdict], str], ...] = (
        (["few photos", "not known"] + 18 * ["as designed"], "no face moved by more than noise (2 not judged)"),
        (20 * ["as designed"], "no face moved by more than noise"),
        (20 * ["few photos"], "no face is judged"),
    )
    for verdicts, sentence in cases:
        assert face_sentence(changed(measured, face_verdict=tuple(verdicts)).record) == sentence


def test_the_scene_shows_where_rings_lie(measured: MeasuredPrint) -> None:
    """With the print's stretch taken off, rings moved by what is shown lie where they were measured."""
    record, target = measured.record, measured.target
    found = deviations_of(record, target)
    face = target.ring_face
    # Along the normal nothing but motion, bow and offset moves a ring; the frames of faces are the design's, moved.
    shift = record.motion[face, 2]
    lever = target.center_in_face_mm[:, :2]
    tilt = record.motion[face, 3:5]
    expected = shift + tilt[:, 0] * lever[:, 1] - tilt[:, 1] * lever[:, 0] + record.ring_offset_mm[:, 2]
    known = found.known
    assert len(known) > 200
    assert np.abs(found.in_face_mm[known, 2] - expected[known]).max() < 2e-3
    view = next(one for one in measured.page().lead if isinstance(one, View3d))
    assert f"{len(known)} rings" in view.alt
    assert [layer.name for layer in view.scene.layers if "times as far" in layer.name]


def test_what_to_dial_in_is_a_command(measured: MeasuredPrint) -> None:
    """The compensation of the next print is a line to copy, and so is the calibration with the measured target."""
    lines = [one.line for one in measured.page().next_steps]
    dialled = [line for line in lines if line.startswith("design ...")]
    assert len(dialled) == 1
    percent = measured.record.next_shrink_compensation_percent
    assert percent is not None
    assert ("--shrink-compensation" in dialled[0]) == (f"{percent:.3f}%" in dialled[0])
    assert "--s" in dialled[0]
    assert lines[0] == measured.use


def test_readings_of_one_length_are_one_row(measured: MeasuredPrint) -> None:
    """Each with its sigma and residual."""
    rows = [text for block in measured.words().lead for name, text in block.rows if name == "length, edge"]  # type: ignore[union-attr]
    assert len(rows) == 1
    assert rows[0].count(" sigma)") == 2


def test_a_print_beyond_all_measure_has_a_page(measured: MeasuredPrint) -> None:
    """Of a size that no printer makes, nothing is to be dialled in, and nothing divides by zero."""
    page = changed(measured, whole=replace(measured.record.whole, size=Estimate(-1.0, 1e-3))).page()
    assert not any(one.line.startswith("design") for one in page.next_steps)
    page_html(page)


@pytest.mark.parametrize("name", ["<img src=x>", "a\\b", "né 測定", "a'b\"c", "-o", "C:x"])
def test_names_of_files_stay_names(name: str, measured: MeasuredPrint, tmp_path: Path) -> None:
    """Whatever prints of a folder are called, its page is written and lists their files where they can be linked."""
    place = tmp_path / f"{name}.target.json"
    replace(measured, file=place).save(place)
    other = replace(measured, file=tmp_path / "other.target.json")
    other.save(tmp_path / "other.target.json")
    page, files, remark = other.draw_page(tmp_path)
    assert page is not None, remark
    assert "<img src=x>" not in files[-1].read_text()
    listed = [row.path for block in blocks_of(page) if isinstance(block, FileList) for row in block.rows]
    assert listed[:4] == [f"other{end}" for end in (".target.json", ".as_built.json", ".as_built.csv", ".as_built.png")]
    assert (f"{name}.target.json" in listed) == (name not in ("a\\b", "C:x"))


def test_scales_are_round() -> None:
    """1, 2 or 5 times a power of ten; colours run from in to out with the design's in the middle."""
    assert [nice(value) for value in (0.03, 0.2, 3.0, 51.0)] == pytest.approx([0.05, 0.2, 5.0, 100.0])
    assert [nice(value, is_down=True) for value in (0.03, 0.2, 3.0, 49.0)] == pytest.approx([0.02, 0.2, 2.0, 20.0])
    assert (colour(-3), colour(0.5), colour(7)) == (COLOURS[0], COLOURS[2], COLOURS[-1])
