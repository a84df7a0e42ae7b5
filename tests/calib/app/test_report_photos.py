"""The photos on a calibration's page: pictures of what was found, the worst first, within the page's size."""

import json
import shutil
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import pytest

from calib.draw.gallery import MOST_PICTURES
from calib.draw.run_photos import photo_rows, photos_section
from calib.judge.folders import read_run
from designer.page.blocks import Findings, Gallery, Page, Table
from designer.page.shell import page_html
from tests.support.pages import blocks_of, section_of, table_of
from tests.support.run_folders import BLANK, PANEL, page_of_run, solved, write_overlays, write_run


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with overlays; not to be changed."""
    folder = tmp_path_factory.mktemp("kept") / "run"
    every = solved(("opencv",))
    write_run(folder, every)
    write_overlays(folder, every[0].observations.view_names)
    return folder


@pytest.fixture(autouse=True)
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are blank."""
    monkeypatch.setattr(PANEL, lambda *_, **__: BLANK)


@pytest.fixture
def page(kept: Path, undrawn: None) -> Page:
    """Its page."""
    return page_of_run(kept)


@pytest.fixture
def run(kept: Path, tmp_path: Path) -> Path:
    """A copy to change."""
    return Path(shutil.copytree(kept, tmp_path / "run"))


def test_numbers_of_photos_are_those_of_the_table_of_views(kept: Path, page: Page) -> None:
    """One row a photo, with its own error."""
    lines = (kept / "opencv/metrics_views.csv").read_text().splitlines()
    head = lines[0].split(",")
    rmse = {line.split(",")[0]: float(line.split(",")[head.index("reprojection_rmse_px")]) for line in lines[1:]}
    rows = table_of(page, "All photos").rows
    assert {row[0].text: row[3].value for row in rows} == pytest.approx(rmse, rel=1e-4)


def test_pictures_come_worst_first_and_lead_to_the_overlays(kept: Path, page: Page) -> None:
    """Each photo with its overlay is in the gallery, by falling error, linked to the file in full."""
    gallery = next(block for block in blocks_of(page) if isinstance(block, Gallery))
    rmse = {row[0].text: row[3].value or 0.0 for row in table_of(page, "All photos").rows}
    shown = [rmse[picture.name] for picture in gallery.pictures]
    assert len(shown) == 8
    assert shown == sorted(shown, reverse=True)
    assert all((kept / picture.path).is_file() for picture in gallery.pictures)
    assert all("points" in picture.caption and "px" in picture.caption for picture in gallery.pictures)


def test_without_overlays_the_table_stands_alone(run: Path) -> None:
    """A line says what is missing, and what draws it."""
    shutil.rmtree(run / "overlays")
    photos = section_of(page_of_run(run), "Photos")
    assert not any(isinstance(block, Gallery) for block in photos.blocks)
    assert any(isinstance(block, Findings) and "calib run" in block.rows[0].text for block in photos.blocks)
    assert any(isinstance(block, Table) for block in photos.blocks)


def huge_png() -> bytes:
    """A PNG of 100 000 x 100 000 px that says so in a few bytes."""
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", 100_000, 100_000, 8, 2, 0, 0, 0)), (b"IDAT", zlib.compress(bytes(99)))]
    body = b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in (*chunks, (b"IEND", b""))
    )
    return b"\x89PNG\r\n\x1a\n" + body


def test_broken_overlays_are_skipped_and_named(run: Path) -> None:
    """No picture, half a picture, one of far too many pixels: the others are shown, and nothing is decoded in vain."""
    places = sorted((run / "overlays").iterdir())
    places[0].write_bytes(b"no picture")
    places[1].write_bytes(places[2].read_bytes()[:3000])
    places[3].write_bytes(huge_png())
    places[4].unlink()
    places[4].mkdir()
    photos = section_of(page_of_run(run), "Photos")
    gallery = next(block for block in photos.blocks if isinstance(block, Gallery))
    assert len(gallery.pictures) == 4
    broken = next(block.rows[0] for block in photos.blocks if isinstance(block, Findings))
    assert broken.title == "3 pictures cannot be shown"
    for place in (places[0], places[1], places[3]):
        assert place.name in broken.text
    assert str(run) not in broken.text


def test_of_very_many_photos_the_worst_are_shown(tmp_path: Path, kept: Path) -> None:
    """As many as fit, and the page says how many are not."""
    run = read_run(kept)
    row = photo_rows(run.best.evaluation, run.records)[0]
    rows = [replace(row, name=f"{number:04d}.png", rmse_px=float(number)) for number in range(MOST_PICTURES + 50)]
    write_overlays(tmp_path, [one.name for one in rows], (16, 12))
    shown = next(b for b in photos_section(tmp_path, rows, (), is_flat=True).blocks if isinstance(b, Gallery))
    assert len(shown.pictures) == MOST_PICTURES
    assert shown.pictures[0].name == f"{MOST_PICTURES + 49:04d}.png"
    assert f"{MOST_PICTURES} of {MOST_PICTURES + 50} are shown" in shown.note


def test_photos_without_the_target_are_listed(run: Path) -> None:
    """They come first among the pictures, are marked, and the reason stands there."""
    place = run / "detections.records.json"
    document = json.loads(place.read_text())
    lost = {**document["images"][0], "image": "lost.png", "features": 0, "faces": [], "remarks": ["too blurred"]}
    document["images"].append(lost)
    place.write_text(json.dumps(document))
    write_overlays(run, ["lost.png"])
    page = page_of_run(run)
    row = next(row for row in table_of(page, "All photos").rows if row[0].text == "lost.png")
    assert row[0].level == "bad"
    assert row[-1].text == "too blurred"
    gallery = next(block for block in blocks_of(page) if isinstance(block, Gallery))
    assert gallery.pictures[0].name == "lost.png"
    assert "8 of 9 photos were used" in section_of(page, "Photos").lead


def test_what_all_photos_have_in_common_is_said_once(run: Path) -> None:
    """A remark of each photo tells none from another."""
    place = run / "detections.records.json"
    document = json.loads(place.read_text())
    for image in document["images"]:
        image["remarks"] = ["ambiguous orientation"]
    document["images"][2]["remarks"].append("page 1 of 2 read")
    place.write_text(json.dumps(document))
    text = page_html(page_of_run(run)).decode()
    assert text.count("ambiguous orientation") == 1
    assert text.count("page 1 of 2 read") == 2  # under the picture and in the table
