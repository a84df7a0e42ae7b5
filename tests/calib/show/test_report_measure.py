"""The page of a measured print: deviations, gain and what to dial in are those that were measured."""

import json
from pathlib import Path

import numpy as np
import pytest

from calib.records.as_built_file import AS_BUILT, AsBuiltRecord
from calib.show.measured.scene import COLOURS, colour, deviations_of, nice
from calib.show.measured.words import face_sentence
from designer.page.blocks import Command, Page, View3d
from designer.page.shell import page_html
from designer.target import load_target
from tests.support.report_folders import (
    PRINT,
    blocks_of,
    figures_of,
    findings_of,
    measure_files,
    page_of,
    table_of,
    written,
)

REPORT, MEASURED = f"{PRINT}.as_built.json", f"{PRINT}.target.json"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A measured print."""
    return written(measure_files(), tmp_path)


@pytest.fixture
def page(folder: Path) -> Page:
    """Its page."""
    return page_of("measure", folder)


def stored(folder: Path) -> AsBuiltRecord:
    """What was measured."""
    record = AS_BUILT.read_if_there(folder / REPORT)
    assert record is not None
    return record


def changed(folder: Path, **fields: object) -> Path:
    """The folder with other fields in the report."""
    document = json.loads((folder / REPORT).read_bytes())
    (folder / REPORT).write_text(json.dumps(document | fields))
    return folder


def test_faces_and_rings_are_those_of_the_report(folder: Path, page: Page) -> None:
    """Shifts in mm, tilts in degrees, offsets of rings: as stored; more than noise has a star, if the face moved."""
    document = json.loads((folder / REPORT).read_bytes())
    table = table_of(page, "How the faces lie")
    assert len(table.rows) == 20
    for row in table.rows:
        face = int(row[0].text)
        motion = document["face_motion"][face]
        assert [cell.value for cell in row[3:]] == pytest.approx([*motion[3:], *np.degrees(motion[:3])])
        sigma = np.sqrt([document["face_motion_covariance"][6 * face + k][6 * face + k] for k in (3, 4, 5, 0, 1, 2)])
        starred = [cell.text.endswith("*") for cell in row[3:]]
        has_moved = row[1].text == "moved"
        assert starred == (has_moved & (np.abs([*motion[3:], *motion[:3]]) > 3 * sigma)).tolist()
    rings = table_of(page, "How the rings lie")
    size = [row[-2].value or 0.0 for row in rings.rows]
    assert size == sorted(size, reverse=True)
    first = rings.rows[0]
    assert [cell.value for cell in first[3:6]] == document["ring_offset_mm"][int(first[0].text)]


def test_the_answer_follows_from_photos_held_out(folder: Path, page: Page) -> None:
    """What leaves less in photos held out is better, what does not is not; nothing held out: a note."""
    assert page.headline is not None
    assert page.headline.level == "good"
    held = json.loads((folder / REPORT).read_bytes())["held_out"]
    factor = next(one["nominal"] / one["measured"] for one in held["gains"] if one["metric"] == "intersection")
    assert f"{factor:.0f} times smaller" in page.headline.sentence or f"{factor:.1f} times" in page.headline.sentence
    chance = [{**one, "least_factor": 0.9} for one in held["gains"]]
    unsure = [{**one, "least_factor": None} for one in held["gains"]]
    for fields, level in (
        ({"held_out": {**held, "gains": chance}}, "usable"),
        ({"held_out": {**held, "gains": unsure}}, "note"),
        ({"held_out": None}, "note"),
        ({"status": "degenerate", "remarks": ["too few views"]}, "bad"),
    ):
        headline = page_of("measure", changed(folder, **fields)).headline
        assert headline is not None
        assert headline.level == level


def test_faces_that_are_not_judged_are_counted(folder: Path) -> None:
    """That no face moved is said of those that photos judge, and how many others there are."""
    for verdicts, sentence in (
        (["few photos", "not known"] + 18 * ["as designed"], "no face moved by more than noise (2 not judged)"),
        (20 * ["as designed"], "no face moved by more than noise"),
        (20 * ["few photos"], "no face is judged"),
    ):
        assert face_sentence(stored(changed(folder, face_verdict=verdicts))) == sentence


def test_the_scene_shows_where_rings_lie(folder: Path) -> None:
    """With the print's stretch taken off, rings moved by what is shown lie where they were measured."""
    record, target = stored(folder), load_target(folder / MEASURED)
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
    view = next(one for one in page_of("measure", folder).lead if isinstance(one, View3d))
    assert f"{len(known)} rings" in view.alt
    assert [layer.name for layer in view.scene.layers if "times as far" in layer.name]


def test_what_to_dial_in_is_a_command(folder: Path, page: Page) -> None:
    """The compensation of the next print is a line to copy, and so is the run with the measured target."""
    lines = [one.line for one in blocks_of(page) if isinstance(one, Command)]
    dialled = [line for line in lines if line.startswith("design ...")]
    assert len(dialled) == 1
    percent = stored(folder).next_shrink_compensation_percent
    assert percent is not None
    assert ("--shrink-compensation" in dialled[0]) == (f"{percent:.3f}%" in dialled[0])
    assert "--s" in dialled[0]
    assert f"calib run {MEASURED} PHOTOS -o DIR" in lines


def test_a_print_beyond_all_measure_has_a_page(folder: Path) -> None:
    """Of a size that no printer makes, nothing is to be dialled in, and nothing divides by zero."""
    page = page_of("measure", changed(folder, size={"value": -1.0, "sigma": 1e-3}))
    lines = [one.line for one in blocks_of(page) if isinstance(one, Command)]
    assert not any(line.startswith("design") for line in lines)
    page_html(page)


def test_another_target_is_not_shown_as_measured(folder: Path, tmp_path: Path) -> None:
    """A target file that is not the measurement's gives no scene, and it is said."""
    (folder / MEASURED).write_text(
        (folder / MEASURED).read_text().replace("[", "[ ", 1).replace('"measured"', '"nominal"')
    )
    page = page_of("measure", folder)
    assert not page.lead
    assert any(MEASURED in one.text for one in findings_of(page))
    (folder / f"{PRINT}.as_built.png").unlink()
    page = page_of("measure", folder)
    assert not figures_of(page)
    assert any(one.title == "The picture is missing" for one in findings_of(page))


def test_each_print_of_a_folder_is_on_its_page(folder: Path) -> None:
    """A folder with two measured prints: the page tells both, and its headline is the worse one's."""
    for end in (".as_built.json", ".target.json"):
        (folder / f"a print{end}").write_bytes((folder / f"{PRINT}{end}").read_bytes())
    document = json.loads((folder / "a print.as_built.json").read_bytes())
    (folder / "a print.as_built.json").write_text(json.dumps({**document, "status": "degenerate"}))
    page = page_of("measure", folder)
    assert [section.title for section in page.sections[1:-1]] == ["a print", PRINT]
    assert page.headline is not None
    assert (page.headline.level, page.headline.word) == ("bad", "2 prints")
    assert f"a print: do not use; {PRINT}: measured target is better" in page.headline.sentence
    page_html(page)


@pytest.mark.parametrize("name", ["<img src=x>", "a\\b", "né 測定", "a'b\"c", "-o", "C:x"])
def test_names_of_files_stay_names(name: str, tmp_path: Path) -> None:
    """Whatever a print is called, its page is written, without a link where there can be none."""
    files = {path.replace(PRINT, name): content for path, content in measure_files().items()}
    html = page_html(page_of("measure", written(files, tmp_path))).decode()
    assert "<img src=x>" not in html


@pytest.mark.parametrize(
    "fields",
    [
        {"face_motion": [[0.0] * 6]},
        {"face_motion": "many"},
        {"ring_offset_mm": []},
        {"ring_offset_mm": [[1e300, 0, 0]] * 300},
        {"face_motion_covariance": [[1.0]]},
        {"face_views": {}},
        {"size": {"value": "0.1", "sigma": 0.1}},
        {"held_out": {"parts": -1, "gains": [], "against_truth": [], "remarks": []}},
    ],
)
def test_arrays_that_do_not_fit_are_refused(fields: dict[str, object], folder: Path) -> None:
    """An array of another shape or with absurd numbers ends in a line that names the file and its field."""
    with pytest.raises(ValueError, match=r"as_built\.json: .*again") as refused:
        page_of("measure", changed(folder, **fields))
    assert next(iter(fields)) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_scales_are_round() -> None:
    """1, 2 or 5 times a power of ten; colours run from in to out with the design's in the middle."""
    assert [nice(value) for value in (0.03, 0.2, 3.0, 51.0)] == pytest.approx([0.05, 0.2, 5.0, 100.0])
    assert [nice(value, is_down=True) for value in (0.03, 0.2, 3.0, 49.0)] == pytest.approx([0.02, 0.2, 2.0, 20.0])
    assert (colour(-3), colour(0.5), colour(7)) == (COLOURS[0], COLOURS[2], COLOURS[-1])
