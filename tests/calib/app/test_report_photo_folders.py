"""Pages of folders of pictures: from what they store, honest about what is missing, and safe whatever files hold."""

import os
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.app.render_page import option_words
from calib.draw.camera_scene import MOST_VIEWS, place_view
from calib.draw.gallery import MOST_PICTURES, Shot, spread
from calib.judge.folders import keep_target, kept_target
from calib.observe.photos import find_photos
from calib.renderer.faces import ring_truth
from calib.renderer.job import run_jobs
from calib.renderer.options import RenderOptions
from calib.renderer.scene import scene_from_target
from designer.page.blocks import Gallery, Page, Table
from designer.page.page_file import PAGE, StoredPage
from designer.page.scene import Cameras
from designer.page.shell import page_html
from designer.target import TargetGeometry
from tests.support.pages import HOSTILE, blocks_of, png
from tests.support.picture_folders import (
    BOARD,
    CAMERA,
    ICO,
    detected,
    face,
    overlaid,
    pictures,
    posed,
    poses,
    rendered,
    result,
)

MOST_BYTES = 10_000_000


def the_gallery(page: Page) -> Gallery:
    """Its pictures."""
    return next(block for block in blocks_of(page) if isinstance(block, Gallery))


def the_table(page: Page) -> Table:
    """Its table of photos."""
    return next(block for block in blocks_of(page) if isinstance(block, Table) and block.title == "All photos")


def column(page: Page, title: str) -> list[str]:
    """A column of the table of photos."""
    table = the_table(page)
    at = [one.title for one in table.columns].index(title)
    return [row[at].text for row in table.rows]


def headline(page: Page) -> tuple[str, str, str]:
    """Level, word and sentence."""
    assert page.headline is not None
    return page.headline.level, page.headline.word, page.headline.sentence


def test_rings_that_the_detector_does_not_want_are_called_too_small(tmp_path: Path) -> None:
    """A set of which no photo shows a ring of 5 px says so at once, and by how much; a nearer one does not."""
    far = rendered(tmp_path / "far", ICO, views=3)
    assert headline(far.page())[:2] == ("usable", "rings too small")
    (warning,) = far.warnings
    assert max(ring_sizes_px(ICO, 3)) < 5
    assert f"radius of {max(ring_sizes_px(ICO, 3)):.2g} px; the detector wants 5 px" in warning
    near = rendered(tmp_path / "board", BOARD, views=3)
    assert bool(near.warnings) == (min(ring_sizes_px(BOARD, 3)) < 5)
    assert (headline(near.page())[1] == "rings too small") == (max(ring_sizes_px(BOARD, 3)) < 5)


def ring_sizes_px(target: TargetGeometry, views: int) -> list[float]:
    """The largest semi-minor axis of the rings that each rendered photo shows."""
    scene = scene_from_target(target)
    truths = [ring_truth(scene, CAMERA, pose) for pose in poses(views)]
    return [float(one.minor_radius_px[one.visible].max()) for one in truths]


def test_a_rendered_set_says_what_it_is(tmp_path: Path) -> None:
    """Target, camera, distance, effects that are on, and seed; what is off is not said."""
    made = rendered(tmp_path, ICO, RenderOptions(blur_px=0.7, contrast_to_noise=50, gamma=2.2), views=6)
    _, _, sentence = headline(made.page())
    for words in (
        "6 photos of 640 x 480 px",
        "icosahedron",
        "opencv",
        "436 to 587 mm",
        "0.7 px",
        "50",
        "gamma 2.2",
        "seed 5",
    ):
        assert words in sentence
    assert "glare" not in sentence
    assert "clutter" not in sentence


def test_every_option_of_a_rendered_set_is_said() -> None:
    """Whatever differs from a plain set shows in the facts."""
    plain = RenderOptions()
    changed = {
        "sampling": "binary", "black": 0.2, "white": 0.7, "background": 0.1, "blur_px": 1.0, "aperture_mm": 3.0,
        "contrast_to_noise": 9.0, "read_noise": 0.1, "full_well": 900.0, "vignetting": 0.3, "light_gradient": 0.2,
        "shading": 0.4, "glare": 0.5, "clutter": 3, "occlusion": 0.2, "gamma": 2.2,
    }  # fmt: skip
    for name, value in changed.items():
        assert option_words(replace(plain, **{name: value})) != option_words(plain), name  # type: ignore[arg-type]


def test_photos_that_are_gone_are_said(tmp_path: Path) -> None:
    """Photos that are told of and are not there any more are named, and not linked."""
    made = rendered(tmp_path)
    (tmp_path / "view_0002.png").unlink()
    page = made.page_in(tmp_path)
    assert "view_0002.png: is not there" in page_html(page).decode()
    assert [row[0].path for row in the_table(page).rows].count("") == 1
    assert len(the_gallery(page).pictures) == 3


def test_of_a_great_many_cameras_some_are_drawn() -> None:
    """So that the page stays quick; it is said, and no more than the most are drawn."""
    pose = np.tile(np.eye(4), (2 * MOST_VIEWS + 1, 1, 1))
    pose[:, 2, 3] = 100
    view = place_view(None, CAMERA, pose, tuple(map(str, range(len(pose)))))
    drawn = [len(s.names) for layer in view.scene.layers for s in layer.shapes if isinstance(s, Cameras)]
    assert drawn == [-(-len(pose) // 3)]
    assert "One of 3" in view.caption


def test_a_page_does_not_disturb_other_commands(tmp_path: Path) -> None:
    """A finished set with its page is kept by the next run, and only its photos are photos."""
    made = rendered(tmp_path)
    made.draw_page(tmp_path)
    job = made.job
    again = run_jobs({tmp_path: job}, processes=1, overwrite=False, on_view=lambda *_: None)
    assert (again.rendered, again.kept) == (0, 4)
    assert [path.name for path in find_photos([str(tmp_path)]).paths] == job.file_names


@pytest.mark.parametrize(
    ("found", "level"), [(1000, "good"), (950, "good"), (949, "usable"), (500, "usable"), (499, "bad"), (0, "bad")]
)
def test_levels_of_detections(found: int, level: str, tmp_path: Path) -> None:
    """95 % and 50 % of the rings that could have been measured; those that are seen too flat do not count."""
    faces = [face(found, 1000, flat=5000)] if found else []
    page = detected(tmp_path / "o", [result("a.png", faces)])
    assert headline(page)[0] == level
    if found:
        assert f"{found} of the 1000 rings" in headline(page)[2]
        assert column(page, "expected") == ["1000"]


def test_photos_without_the_target_and_without_content_count(tmp_path: Path) -> None:
    """All rings of some photos make no good set if others show nothing, or cannot be read; the reason is shown."""
    good = [result(f"{row}.png", [face(9, 9)]) for row in range(9)]
    assert headline(detected(tmp_path / "o", [*good, result("none.png")]))[0] == "usable"
    page = detected(tmp_path / "o", [*good, result("x.png", failure="x.png: is empty (0 bytes)")])
    assert headline(page)[0] == "usable"
    assert "1 could not be read" in headline(page)[2]
    assert "x.png: is empty" in page_html(page).decode()
    assert headline(detected(tmp_path / "o", good))[0] == "good"


def test_missing_rings_and_unseen_faces_are_named(tmp_path: Path) -> None:
    """Reasons by photo and in all, worst photo first in the gallery, faces that no photo shows."""
    pictures(tmp_path, ["a.overlay.png", "b.overlay.png"])
    results = [result("a.png", [face(36, 36, 3)], "a.overlay.png"), result("b.png", [face(20, 36, 5)], "b.overlay.png")]
    page = detected(tmp_path, results, ICO)
    assert column(page, "missing") == ["", "16 odd shape"]
    assert column(page, "faces") == ["3", "5"]
    assert [picture.name for picture in the_gallery(page).pictures] == ["b.png", "a.png"]
    faces = next(block for block in blocks_of(page) if isinstance(block, Table) and block.title == "All faces")
    assert [row[0].text for row in faces.rows if row[0].level is None] == ["3", "5"]


def test_detections_outside_are_told_and_inside_are_linked(tmp_path: Path) -> None:
    """A table above the folder cannot be linked, so its place is said; one inside is linked."""
    html = page_html(overlaid(tmp_path / "o")).decode()
    assert "from this folder: ../detections.csv" in html
    assert 'href="../' not in html
    (tmp_path / "o" / "d.csv").write_text("x")
    page = detected(tmp_path / "o", [result("a.png", [face(9, 9)])], table=tmp_path / "o" / "d.csv")
    assert 'href="d.csv"' in page_html(page).decode()


@pytest.mark.parametrize(
    ("rms_px", "reasons", "level"),
    [
        ((0.02,) * 19, ("no target",), "good"), ((0.02,) * 9, ("no target",), "usable"), ((0.02,), ("a", "b"), "bad"),
        ((0.6,), (), "usable"), ((2.1,), (), "bad"), ((), ("a",), "bad"),
    ],
)  # fmt: skip
def test_levels_of_poses(rms_px: tuple[float, ...], reasons: tuple[str, ...], level: str, tmp_path: Path) -> None:
    """By the share of photos with a pose, and by what is left over in the median one."""
    assert headline(posed(tmp_path, rms_px, reasons).page())[0] == level


def test_the_worst_pose_comes_first(tmp_path: Path) -> None:
    """It is marked if it stands out, and photos without a pose have their reason."""
    page = posed(tmp_path, (0.02, 0.09, 0.03), ("too few rings",)).page()
    worst = the_gallery(page).pictures[0]
    assert (worst.name, worst.level) == ("1.png", "usable")
    assert "3.png: too few rings" in page_html(page).decode()


def test_hostile_names_stay_text_and_reach_nothing(tmp_path: Path) -> None:
    """Names that are markup, lead upwards or hold control characters: no picture from outside, no link, no markup."""
    pictures(tmp_path, ["secret.png"], png(10, 10, 255))
    names = (*HOSTILE, "../secret.png", str(tmp_path / "secret.png"), "a\\..\\secret.png", "\ud800")
    page = detected(tmp_path / "d", [result(name, [face(3, 4)], name) for name in names])
    html = page_html(page).decode()
    assert not any(isinstance(block, Gallery) for block in blocks_of(page))
    assert "<img src=x" not in html
    assert "secret.png" not in "".join(re.findall(r'(?:href|src|data-full)="[^"]*"', html))


def test_photos_with_odd_names_are_shown(tmp_path: Path) -> None:
    """Names as files may have them, bytes that are no text among them, are shown and lead to the file."""
    names = ["a b#?%.png", "<b>&.png", "\u202egnp.png", os.fsdecode(b"\xff\xfe.png")]
    pictures(tmp_path, names)
    page = detected(tmp_path, [result(name, [face(3, 3)], name) for name in names])
    assert [picture.path for picture in the_gallery(page).pictures] == names
    assert page_html(page)


def test_broken_pictures_are_left_out_and_said(tmp_path: Path) -> None:
    """A picture that is cut off, empty or a folder is no reason to have no page."""
    made = rendered(tmp_path)
    broken, *others = sorted(tmp_path.glob("*.png"))
    broken.write_bytes(broken.read_bytes()[:40])
    page = made.page_in(tmp_path)
    assert len(the_gallery(page).pictures) == len(others)
    assert "1 picture cannot be shown" in page_html(page).decode()
    for path in (broken, *others):
        path.unlink()
        path.mkdir()
    assert page_html(made.page_in(tmp_path))


def test_a_page_stays_small(tmp_path: Path) -> None:
    """At most 10 MB for 300 photos of the worst kind, noise; all are in the table."""
    views = 300
    noise = np.random.default_rng(0).integers(0, 256, (600, 800), dtype=np.uint8)
    content = cv2.imencode(".png", noise, [cv2.IMWRITE_PNG_COMPRESSION, 0])[1].tobytes()
    page = rendered(tmp_path, views=views, content=content).page_in(tmp_path)
    assert len(page_html(page)) < MOST_BYTES
    assert len(the_table(page).rows) == views
    shown = the_gallery(page).pictures
    assert len(shown) == min(views, MOST_PICTURES)
    assert {shown[0].name, shown[-1].name} == {"view_0000.png", f"view_{views - 1:04d}.png"}


def test_of_many_pictures_those_shown_are_spread() -> None:
    """First and last are among them, no gap is much larger than another, and none is lost."""
    shots = [Shot(str(row), "", "") for row in range(1234)]
    order = [int(shot.path) for shot in spread(shots)]
    assert sorted(order) == list(range(1234))
    shown = order[:MOST_PICTURES]
    assert (shown[0], shown[-1]) == (0, 1233)
    assert max(np.diff(shown)) - min(np.diff(shown)) <= 1


def test_a_page_replaces_none_of_another_kind(tmp_path: Path) -> None:
    """Free folders and folders of the same kind are taken; others, and somebody's own index.html, stay."""
    made = rendered(tmp_path)
    (tmp_path / "index.html").write_text("mine")
    assert "stays as it is" in made.draw_page(tmp_path)[2]
    (tmp_path / "page.json").write_bytes(PAGE.text(StoredPage("calibration", made.page())))
    assert "calibration" in made.draw_page(tmp_path)[2]
    assert (tmp_path / "index.html").read_text() == "mine"
    (tmp_path / "page.json").write_bytes(PAGE.text(StoredPage("photos", made.page())))
    (tmp_path / "index.html").unlink()
    assert made.draw_page(tmp_path)[2] == ""
    (tmp_path / "page.json").write_text("{}")
    assert "page.json" in made.draw_page(tmp_path)[2]


def test_a_kept_target_replaces_only_our_own(tmp_path: Path) -> None:
    """Somebody's target.json stays, and a target put there by hand; one of an earlier run goes with its photos."""
    place = (tmp_path / "target.json",)
    for is_again in (False, True):
        assert keep_target(tmp_path, BOARD, is_again=is_again) == place
    assert keep_target(tmp_path, ICO, is_again=False) == ()
    assert kept_target(tmp_path, BOARD.geometry_id)[0] == BOARD
    assert keep_target(tmp_path, ICO, is_again=True) == place
    assert kept_target(tmp_path, ICO.geometry_id)[0] == ICO
    place[0].write_text("{}")
    assert keep_target(tmp_path, BOARD, is_again=True) == ()
    assert place[0].read_text() == "{}"
