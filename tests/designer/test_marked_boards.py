"""Boards with other detectors' marks as `design board --marks` makes them: sizes, files, and what is printed."""

import io
import tomllib
from functools import cache
from pathlib import Path

import cv2
import lib3mf
import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from designer.base.errors import InputError
from designer.builds.design import Design
from designer.formats.stl import stl_bytes
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import parse_spec, spec_to_toml
from designer.make.pattern import HAIR_MM
from designer.make.printability import check_printability
from designer.make.textured import ink_share
from designer.target import target_from_json, target_to_json
from tests.support.command_line import design as design_command
from tests.support.designs import asked_for, design_of, ink_of, packages_of

BOARDS: dict[str, dict[str, object]] = {
    "chessboard": {"squares": "7x6", "square": "12mm"},
    "charuco": {"squares": "5x4", "square": "16mm", "dictionary": "4x4_50"},
    "aprilgrid": {"tags": "3x2", "tag": "24mm"},
    "circles": {"circles": "3x5", "pitch": "20mm", "asymmetric": True},
}
each_kind = pytest.mark.parametrize("marks", BOARDS)


@cache
def made(marks: str, **more: object) -> Design:
    """A small board of a kind."""
    return design_of("board", marks=marks, **BOARDS[marks], **more)


def printed(design: Design, px_per_mm: int = 8) -> NDArray[np.uint8]:
    """The front as it is printed, on white."""
    low, high = design.target.outline_mm[0].min(axis=0) - 5, design.target.outline_mm[0].max(axis=0) + 5
    count = np.round((high - low) * px_per_mm).astype(int)
    x = low[0] + (np.arange(count[0]) + 0.5) / px_per_mm
    y = high[1] - (np.arange(count[1]) + 0.5) / px_per_mm
    return np.round(255 * (1 - ink_share(design.artwork.faces[0], design.artwork, x, y))).astype(np.uint8)


@each_kind
@pytest.mark.parametrize("build", ["one-piece", "relief", "recessed"])
@pytest.mark.parametrize("offset_mm", [0.0, 0.1, -0.1])
def test_body_and_ink_are_closed_and_the_ink_is_what_is_black(marks: str, build: str, offset_mm: float) -> None:
    """Squares that meet in corners, and cells that share sides, are solids; the ink fills what is black, but hairs."""
    design = made(marks, build=build, ink_offset=f"{offset_mm}mm", labels=False)
    parts = [design.part.body] if build == "recessed" else [design.part.body, ink_of(design)]
    solids = [trimesh.load_mesh(io.BytesIO(stl_bytes(mesh)), file_type="stl") for mesh in parts]
    for solid in solids:
        solid.merge_vertices()
        assert solid.is_watertight
        assert solid.is_winding_consistent
        assert solid.volume > 0
    if build == "recessed":
        return
    face = design.target.marks[0] if design.target.marks else None
    assert face is not None
    black_mm2 = sum(np.prod(np.ptp(polygon, axis=0)) for polygon in face.polygons_mm)
    edge_mm = sum(2 * np.ptp(polygon, axis=0).sum() for polygon in face.polygons_mm)
    if not face.polygons_mm:
        # Each circle's area is its own, corrections beside.
        radius_mm, count = np.array([face.radius_mm, face.radius_mm + offset_mm]), len(face.index)
        black_mm2, grown_mm2 = count * np.pi * radius_mm**2
        edge_mm = abs(grown_mm2 - black_mm2) / max(abs(offset_mm), 1e-9)
    ink_mm2 = solids[1].volume / design.job.printing.inlay_mm
    # Of black places that touch, sides that they share do not move.
    assert ink_mm2 - black_mm2 == pytest.approx(0, abs=edge_mm * (HAIR_MM / 2 + abs(offset_mm)) + 1e-3)
    assert np.sign(round(ink_mm2 - black_mm2, 2)) == np.sign(offset_mm) or (offset_mm == 0 and ink_mm2 < black_mm2)
    package = packages_of(design).prusa
    reader = lib3mf.get_wrapper().CreateModel().QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromBuffer(np.frombuffer(package, np.uint8))
    assert reader.GetWarningCount() == 0


@each_kind
def test_opencv_finds_what_is_printed(marks: str) -> None:
    """All corners, markers and tags of the artwork, where the target file has them: to a twentieth of a millimetre."""
    design = made(marks, build="sheet")
    picture = cv2.GaussianBlur(printed(design), (0, 0), 1.0)
    face = design.target.marks[0] if design.target.marks else None
    assert face is not None
    if marks == "circles":
        is_found, seen = cv2.findCirclesGrid(picture, (3, 5), flags=cv2.CALIB_CB_ASYMMETRIC_GRID)
        assert is_found
        corner = np.asarray(seen).reshape(-1, 2)
    elif marks == "chessboard":
        is_found, seen = cv2.findChessboardCornersSB(picture, (6, 5))
        assert is_found
        corner = np.asarray(seen).reshape(-1, 2)
    else:
        parameters = cv2.aruco.DetectorParameters()
        parameters.markerBorderBits = 2 if marks == "aprilgrid" else 1
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        known = cv2.aruco.getPredefinedDictionary(
            cv2.aruco.DICT_APRILTAG_36h11 if marks == "aprilgrid" else cv2.aruco.DICT_4X4_50
        )
        if marks == "charuco":
            board = cv2.aruco.CharucoBoard((5, 4), 16.0, 12.0, known)
            seen, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(picture)
            assert len(ids) == len(face.index)
            corner = np.asarray(seen).reshape(-1, 2)[np.argsort(np.asarray(ids).ravel())]
        else:
            tags, ids, _ = cv2.aruco.ArucoDetector(known, parameters).detectMarkers(picture)
            order = np.argsort(np.asarray(ids).ravel())
            assert len(order) == 6
            corner = np.concatenate([np.asarray(tags[row])[0][[1, 0, 3, 2]] for row in order])
    middle = np.array(picture.shape[::-1]) / 2 - 0.5
    off_mm = [np.abs((seen - middle) / 8 * [1, -1] - face.position_mm).max() for seen in (corner, corner[::-1])]
    assert (min(off_mm) if marks in {"chessboard", "circles"} else off_mm[0]) < 0.05


@each_kind
@pytest.mark.parametrize("more", [{}, {"build": "relief"}, {"margin": "9mm"}, {"first_id": 3}, {"two_sided": True}])
def test_a_resolved_spec_and_a_target_file_are_read_back(marks: str, more: dict[str, object]) -> None:
    """The file beside the outputs makes the very same job, and the target file the same target."""
    if marks in {"chessboard", "circles"} and more.keys() & {"first_id", "two_sided"}:
        return
    job = size_job(asked_for("board", {"marks": marks, **BOARDS[marks], **more})).job
    text = spec_to_toml(job)
    again = size_job(parse_spec(tomllib.loads(text), "")).job
    assert again == job
    assert spec_to_toml(again) == text
    target = Design(job).target
    assert target_from_json(target_to_json(target)) == target
    assert not check_printability(target, job.printing).violations


@pytest.mark.parametrize("marks", BOARDS)
@pytest.mark.parametrize("more", [{}, {"size": "150x200mm"}, {"printer": "bambu-a1-mini"}, {"build": "sheet"}])
def test_sizes_are_chosen_to_fit(marks: str, more: dict[str, object]) -> None:
    """Nothing but the kind: a board that the printer makes, with cells of two lines, that looks like no other turn."""
    design = design_of("board", marks=marks, **more)
    check = check_printability(design.target, design.job.printing)
    assert not check.findings
    face = design.target.marks[0] if design.target.marks else None
    assert face is not None
    assert not face.is_ambiguous
    size = np.ptp(design.target.outline_mm[0], axis=0)
    assert (np.array(face.size_mm) + 2 * face.quiet_mm * (marks != "aprilgrid") <= size + 1e-6).all()


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"marks": "charuco", "squares": "11x8", "square": "2mm"}, "thinner than a 0.4mm nozzle"),
        ({"marks": "charuco", "squares": "9x8", "square": "20mm", "size": "100x100mm"}, "more than the board's"),
        ({"marks": "charuco", "columns": 5}, "columns: charuco has none"),
        ({"marks": "chessboard", "dictionary": "4x4_50"}, "dictionary: chessboard has none"),
        ({"marks": "chessboard", "ring_ratio": 0.5}, "ring_ratio 0.5: of rings"),
        ({"marks": "chessboard", "two_sided": True}, "nothing tells two sides of chessboard apart"),
        ({"marks": "aprilgrid", "build": "tiles"}, "its seams would cut the marks of an aprilgrid"),
        ({"marks": "aprilgrid", "gap": "4mm"}, "give --tag"),
        ({"squares": "9x6"}, "belongs to boards with --marks"),
        ({"marks": "charuco", "dictionary": "5x5_10"}, "did you mean 'DICT_5X5_100'"),
        ({"marks": "charuco", "squares": "20x20", "square": "12mm", "dictionary": "4x4_50"}, "use DICT_4X4_250"),
        ({"marks": "rings"}, "must be 'chessboard' or 'charuco' or 'aprilgrid' or 'circles'"),
        ({"marks": "circles", "circles": "4x11", "pitch": "1mm"}, "use a pitch of at least"),
        ({"marks": "circles", "square": "9mm"}, "square: circles has none"),
        (
            {"marks": "circles", "circles": "4x5", "pitch": "20mm", "diameter": "21mm"},
            "must be smaller than their distance",
        ),
        ({"marks": "circles", "two_sided": True}, "nothing tells two sides of circles apart"),
    ],
)
def test_what_cannot_be_is_refused(values: dict[str, object], said: str) -> None:
    """Value, rule and remedy."""
    with pytest.raises(InputError, match=said.replace(".", r"\.")):
        size_job(asked_for("board", values))


def test_the_page_says_what_a_hair_is(tmp_path: Path) -> None:
    """Of a board with marks the page names them, and tells how squares that touch are kept apart."""
    words = ("board", "--marks", "charuco", "--squares", "5x4", "--square", "16mm", "-o", tmp_path / "out")
    answer = design_command(*words)
    assert answer.code == 0, answer.err
    assert "ChArUco board of 5 x 4 squares of 16 mm" in answer.out
    assert "2 µm apart" in answer.out
    assert "rings" not in answer.out
