"""The command `calib detect`: many photos in, one table out, and nothing lost on the way."""

import inspect
import os
import re
import threading
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.app.detect import detect_photos
from calib.cameras.camera import Camera, camera_to_json
from calib.core.types import Detections
from calib.observe.dataset import RECORDS, read_detections
from calib.observe.photos import PhotoFile, find_photos, named_photos, reading_once, searched_photos
from designer.base.errors import InputError
from designer.base.words import printable
from designer.kinds.layout import lay_out
from designer.kinds.sizing import size_job
from designer.page.capability import command_of
from designer.target import TargetGeometry, target_to_json
from tests.support.designs import asked_for
from tests.support.sightings import pinhole, sighting, view_from

BOARD = lay_out(size_job(asked_for("board", {"columns": 5, "rows": 4, "pitch": "20mm"})).job.target)
CAMERA = pinhole(160, 120, 200)
DETECT = command_of(inspect.unwrap(detect_photos))


@cache
def sight() -> Detections:
    """What a good photo shows."""
    return sighting(BOARD, CAMERA, view_from((20, -30, 220)), np.random.default_rng(0))[1]


def found(
    pixels: NDArray[np.generic], target: TargetGeometry, *, name: str, camera: Camera | None = None
) -> Detections:
    """A detector that finds the target in photos that are not black, and breaks at a white corner."""
    if pixels[0, 0] == 255:
        raise RuntimeError("white corner")
    seen, size = sight(), (pixels.shape[1], pixels.shape[0])
    keep = slice(None) if pixels.max() > 0 else slice(0)
    return Detections(
        name, size, target.layout_id, target.geometry_id, seen.ring[keep], seen.position_mm[keep],
        seen.center_px[keep], seen.cov_px2[keep],
        seen.ellipse_px[keep], seen.faces[keep], () if pixels.max() > 0 else ("no ring found",),
    )  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with a target file and photos: two good ones and a black one."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    Path("board.target.json").write_text(target_to_json(BOARD))
    Path("photos").mkdir()
    for name, level in (("img2.png", 90), ("img10.png", 120), ("img11.png", 0)):
        photo(Path("photos") / name, level)
    return tmp_path


def photo(path: Path, level: int, size: tuple[int, int] = (160, 120)) -> None:
    """An even photo."""
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full(size[::-1], level, np.uint8))


def run(
    *photos: str,
    detect: Callable[..., Detections] = found,
    out: str | None = None,
    overlay: str | None = None,
    camera: str | None = None,
) -> int:
    """The exit code of the command with a detector of choice."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("calib.detector.pipeline.detect", detect)
        return DETECT(
            target=Path("board.target.json"), photos=list(photos), out=Path(out or "exports/board/detections.csv"),
            overlay=None if overlay is None else Path(overlay), camera=camera, jobs="2", page=True, verbose=True,
        ).exit_code  # fmt: skip


def test_a_folder_becomes_a_table(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All images of a folder are searched, in the order a person counts; the sums, files and next step are said."""
    assert run("photos") == 0
    table = Path("exports/board/detections.csv")
    data = read_detections(table, BOARD, target_path=Path("board.target.json"))
    assert [one.image for one in data] == ["img2.png", "img10.png", "img11.png"]
    assert [len(one.ring) for one in data] == [len(sight().ring), len(sight().ring), 0]
    said = capsys.readouterr().out
    assert re.search(rf"img10\.png +{len(sight().ring)} +{BOARD.ring_count} ", said)
    assert re.search(r"img11\.png +0 +0 .*no ring found", said)
    counts = f"{2 * len(sight().ring)} of the {2 * BOARD.ring_count} rings"
    assert said.startswith(f"found in part: The target was found in 2 of 3 photos, with {counts}")
    assert "wrote    exports/board: detections.csv, detections.records.json" in said
    assert "next" in said


def test_bad_photos_are_recorded_with_their_failure(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Also those that break the search; the others are in the table, all are counted."""
    Path("photos/broken.png").write_bytes(Path("photos/img2.png").read_bytes()[:60])
    photo(Path("photos/white.png"), 255)
    assert run("photos", "missing.png") == 0
    said = capsys.readouterr().out
    assert "Not searched: photos/white.png: the search failed: RuntimeError: white corner" in said
    assert "3 could not be read" in said
    records = RECORDS.read(Path("exports/board/detections.records.json"))
    assert {r.image for r in records.images if r.failure} == {"broken.png", "missing.png", "white.png"}
    assert {r.image for r in records.images if not r.failure} == {"img2.png", "img10.png", "img11.png"}


def test_places_that_do_not_suit_are_refused(folder: Path) -> None:
    """A photo for the table, a file for the overlays' folder, a camera that is none: nothing is written."""
    Path("notes.csv").write_text("mine")
    Path("camera.json").write_text("{}")
    before = sorted(folder.rglob("*"))
    for options, rule in (
        ({"out": "photos/img2.png"}, "a .csv file"),
        ({"overlay": "notes.csv"}, "is a file, not a folder"),
        ({"camera": "camera.json"}, "camera.json"),
    ):
        with pytest.raises(InputError, match=rule):
            run("photos", **options)
    assert sorted(folder.rglob("*")) == before


def test_a_camera_reaches_the_detector(folder: Path) -> None:
    """With every photo."""
    given = []

    def detect(
        pixels: NDArray[np.generic], target: TargetGeometry, *, name: str, camera: Camera | None = None
    ) -> Detections:
        given.append(camera)
        return found(pixels, target, name=name, camera=camera)

    Path("camera.json").write_text(camera_to_json(CAMERA))
    assert run("photos", camera="camera.json", detect=detect) == 0
    assert [camera.image_size for camera in given if camera is not None] == [(160, 120)] * 3


def test_photos_of_one_name_are_told_apart_by_their_folders(folder: Path) -> None:
    """Names are as short as they can be and differ; a file given twice is searched once."""
    for place in ("a/x/1.png", "b/x/1.png", "b/y/1.png", "2.png"):
        photo(Path(place), 50)
    paths = [Path(p) for p in ("a/x/1.png", "b/x/1.png", "b/y/1.png", "2.png", "b/../2.png")]
    assert [photo.name for photo in named_photos(map(PhotoFile, paths))] == [
        "a/x/1.png",
        "b/x/1.png",
        "y/1.png",
        "2.png",
    ]
    assert run("a/x", "b/x", "b/y", "2.png", "2.png", out="d.csv", overlay="o") == 0
    names = [one.image for one in read_detections(Path("d.csv"), BOARD, target_path=Path("t"))]
    assert names == ["a/x/1.png", "b/x/1.png", "y/1.png", "2.png"]
    assert len(list(Path("o").glob("*.overlay.jpg"))) == 4


def test_arguments_stand_for_files_folders_and_patterns(folder: Path) -> None:
    """A pattern counts as a person does; a file with brackets in its name is itself; hidden files are left out."""
    photo(Path("photos/[1].png"), 5)
    photo(Path("photos/.hidden.png"), 5)
    Path("photos/notes.txt").write_text("x")
    assert [p.name for p in find_photos(["photos/img*.png"]).paths] == ["img2.png", "img10.png", "img11.png"]
    assert [str(p) for p in find_photos(["photos/[1].png"]).paths] == ["photos/[1].png"]
    assert {p.name for p in find_photos(["photos"]).paths} == {"[1].png", "img2.png", "img10.png", "img11.png"}
    assert find_photos(["a\0b.png"]).paths == (Path("a\0b.png"),)
    with pytest.raises(InputError, match="'' is no photo"):
        find_photos(["photos", ""])


def test_what_is_left_out_by_its_suffix_is_counted_and_named(folder: Path) -> None:
    """Photos of a phone and videos beside images: how many, of what kind, and what to do with them."""
    for name in ("IMG_1.AVIF", "IMG_2.avif", "clip.MP4", ".hidden.avif", "notes.txt"):
        Path("photos", name).touch()
    (line,) = find_photos(["photos"]).failures
    assert line.startswith("photos: 2 AVIF images are not read: convert to PNG, or to JPEG at full size")
    assert "1 video is not read: give a clip by its own name" in line
    for name in ("img2.png", "img10.png", "img11.png"):
        Path("photos", name).unlink()
    assert find_photos(["photos"]).failures == (line,)


def test_two_searches_read_a_photo_once_and_keep_no_more_than_they_may(folder: Path) -> None:
    """Of three photos two fit: gone from the disk, these two are read again, and after that nothing is kept."""
    photos = [PhotoFile(Path("photos") / name) for name in ("img2.png", "img10.png", "img11.png")]
    read = reading_once(most_bytes=2 * 160 * 120)
    first = [read(photo).pixels for photo in photos]
    for photo in photos:
        photo.path.unlink()
    assert all(read(photo).pixels is pixels for photo, pixels in zip(photos[:2], first, strict=False))
    for photo in photos:
        with pytest.raises(InputError, match=photo.path.name):
            read(photo)


def test_results_keep_the_order_and_memory_the_limit(folder: Path) -> None:
    """Results come in the order of the photos, and no more than `jobs` photos are held at once."""
    held, most, lock = [0], [0], threading.Lock()

    def slow(photo: PhotoFile, pixels: NDArray[np.generic]) -> Detections:
        with lock:
            held[0] += 1
            most[0] = max(most[0], held[0])
        time.sleep(0.05 if int(photo.name[:-4]) % 2 else 0.01)
        with lock:
            held[0] -= 1
        return found(pixels, BOARD, name=photo.name)

    photos = [PhotoFile(Path(f"{k}.png"), f"{k}.png") for k in range(9)]
    for one in photos:
        photo(one.path, 50)
    results = list(searched_photos(photos, BOARD, slow, jobs=3))
    assert [result.photo for result in results] == photos
    assert 1 < most[0] <= 3


def test_names_of_any_kind_reach_the_screen(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Brackets, line breaks and bytes that are no text neither break the table nor style it."""
    for name in (b"[red]x.png", b"a\nb.png", b"caf\xe9.png"):
        photo_path = Path(os.fsdecode(name))
        photo(Path("photos/tmp.png"), 40)
        Path("photos/tmp.png").rename(photo_path)
    assert (
        run("[red]x.png", "a\nb.png", os.fsdecode(b"caf\xe9.png"), "[bold]missing.png", out="d.csv", overlay="o") == 0
    )
    said = capsys.readouterr().out
    for text in ("[red]x.png", "a b.png", "caf", "[bold]missing.png"):
        assert text in said
    assert len(list(Path("o").glob("*.overlay.jpg"))) == 3
    assert printable("a\x1b[31mred\u202e\n b") == "a\\x1b[31mred\\u202e b"


def test_a_linked_photo_is_the_same_photo(tmp_path: Path) -> None:
    """A link beside its photo does not make a second view of it."""
    photo = tmp_path / "a.png"
    photo.write_bytes(b"x")
    link = tmp_path / "b.png"
    link.symlink_to(photo)
    assert [one.name for one in named_photos([PhotoFile(photo), PhotoFile(link)])] == ["a.png"]
