"""From files to a rig: photos, tables and observations give the same, in any order, or are refused in a line."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import calib
from calib.app.report import report
from calib.app.solved_rig import SIGHTINGS_FILE, SolvedRig
from calib.cameras.camera import Camera
from calib.core.se3 import invert, log_rotation
from calib.core.types import Detections
from calib.observe.observations import known_points
from designer.target import TargetGeometry
from tests.support.calibrations import icosahedron
from tests.support.command_line import detections_of
from tests.support.rig_views import SIZE, RigScene, ring

ICO = icosahedron()
SCENE: RigScene = ring(known_points(ICO), count=3, frames=8, noise_px=0.05)
SEEN = SCENE.observations
MARK = 17
"""Grey on the left of photos in which the detector of these tests finds something, on the right of mirrored ones."""
OPENCV = {"model": "opencv"}


@pytest.fixture(scope="module")
def solved() -> SolvedRig:
    """The rig as its observations give it."""
    return calib.rig(SEEN, **OPENCV)


@pytest.fixture(autouse=True)
def without_halves(solved: SolvedRig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Halves of the frames are solved of one rig here, no more."""
    monkeypatch.setattr("calib.judge.joint_solution.rig_halves", lambda *_: solved.judged.rig_halves)


@pytest.fixture
def photos(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Blank photos, a folder a camera, and a detector that knows what they show by their names; overlays are blank."""
    known: dict[str, Detections] = {}
    for name, seen in zip(SEEN.camera_names, SEEN.sightings, strict=True):
        (tmp_path / name).mkdir()
        named = replace(seen, view_names=tuple(f"{name}-{view}" for view in seen.view_names))
        for one in detections_of(named, ICO):
            known[one.image] = one
            cv2.imwrite(str(tmp_path / name / one.image), np.full(SIZE[::-1], 90, np.uint8))

    def detect(
        pixels: NDArray[np.generic], _: TargetGeometry, *, name: str, camera: Camera | None = None, **__: object
    ) -> Detections:
        any_one = next(iter(known.values()))
        found = known.get(name, any_one if pixels[0, 0] == MARK else any_one.keep(slice(0)))
        if pixels[0, -1] == MARK:
            found = found.keep(slice(0))
        return replace(found, image=name, image_size=(pixels.shape[1], pixels.shape[0]))

    monkeypatch.setattr("calib.detector.pipeline.find", lambda *_: None)
    monkeypatch.setattr("calib.detector.pipeline.detect", detect)
    monkeypatch.setattr("calib.detector.overlay.draw_overlay", lambda *_: np.full((40, 60, 3), 200, np.uint8))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def assert_same_rig(one: SolvedRig, other: SolvedRig, within_mm: float = 1e-6) -> None:
    """The same cameras at the same places, whatever their order."""
    for name in one.rig.names:
        a, b = one.rig.row(name), other.rig.row(name)
        np.testing.assert_allclose(one.rig.center_mm[a], other.rig.center_mm[b], atol=within_mm)
        np.testing.assert_allclose(one.rig.cameras[a].params, other.rig.cameras[b].params, rtol=1e-5, atol=1e-8)


def test_photos_of_folders_give_the_rig_of_what_they_show(photos: Path, solved: SolvedRig) -> None:
    """With what the photos' records say; what is saved reads back, and its table solves to the same again."""
    found = calib.rig(ICO, [str(photos / name) for name in SEEN.camera_names], made="exact", **OPENCV)
    assert_same_rig(found, solved, 0.05)  # what is written of sightings has six digits
    assert found.rig.geometry_id == ICO.geometry_id
    saved = found.save("rig")
    wrote = {"rig.json", "rig_calibration.json", "verdict.json", SIGHTINGS_FILE, "target.json", "index.html"}
    assert {path.name for path in saved} >= wrote
    assert repr(found).startswith(f"<SolvedRig, {found.verdict.grade}: ")
    np.testing.assert_array_equal(calib.load_rig("rig/rig.json").cam_from_rig, found.rig.cam_from_rig)
    again = calib.rig(ICO, table=Path("rig", SIGHTINGS_FILE), made="exact", **OPENCV)
    assert_same_rig(again, found)
    assert_same_rig(calib.rig(None, table=Path("rig", SIGHTINGS_FILE), **OPENCV), found)
    _assert_pictures(found, again, Path("rig"))


def _assert_pictures(found: SolvedRig, again: SolvedRig, folder: Path) -> None:
    """The worst and a usual photo of each camera are on the page, drawn again or not; a table takes them away."""
    names = {path.relative_to(folder).as_posix() for path in folder.rglob("*.overlay.*")}
    assert len(names) == 2 * len(SEEN.camera_names)
    page = folder / "index.html"
    for camera, name in enumerate(SEEN.camera_names):
        seen = found.calibration.observations.sightings[camera]
        square = (found.calibration.residual_px[camera] ** 2).sum(axis=1)
        rms = np.sqrt(np.bincount(seen.view, square) / np.bincount(seen.view))
        worst = Path(seen.view_names[int(rms.argmax())]).stem
        assert f"cameras/{name}/overlays/{worst}.overlay.jpg" in names
        assert f"cameras/{name}/overlays/{worst}.overlay.jpg" in page.read_text()
    before = page.read_bytes()
    report(folder)
    assert page.read_bytes() == before
    again.save(folder)
    assert not list(folder.rglob("*.overlay.*"))
    assert "Photos</h2>" not in page.read_text()


def test_the_page_of_a_robots_camera_has_pictures_of_its_photos(photos: Path) -> None:
    """The one camera's worst photo and a usual one, as of a rig."""
    name, seen = SEEN.camera_names[0], SEEN.sightings[0]
    base_from_flange = invert(SCENE.cam_from_rig[0] @ SCENE.rig_from_target[SEEN.frame[0]])
    rows = ["image,x_mm,y_mm,z_mm,rx_rad,ry_rad,rz_rad"]
    for view, pose in zip(seen.view_names, base_from_flange, strict=True):
        rows.append(
            ",".join([f"{name}-{view}", *map(repr, [*pose[:3, 3].tolist(), *log_rotation(pose[:3, :3]).tolist()])])
        )
    (photos / "robot.csv").write_text("\n".join(rows) + "\n")
    (photos / name / "broken.png").write_bytes(b"")
    found = calib.hand_eye(ICO, photos / name, robot="robot.csv", camera=SCENE.cameras[0], made="exact")
    assert any("broken.png" in line for line in found.remarks), "a photo that cannot be read is named"
    found.save("hand")
    pictures = sorted(Path("hand").rglob("*.overlay.jpg"))
    assert [one.parent.as_posix() for one in pictures] == ["hand/cameras/camera/overlays"] * 2
    page = Path("hand", "index.html").read_text()
    assert all(one.relative_to("hand").as_posix() in page for one in pictures)


def test_given_lenses_are_kept_or_solved_on() -> None:
    """A kept one comes out as it went in, without a variance, and with a word on what that leaves out."""
    first, given = SEEN.camera_names[0], replace(SCENE.cameras[0], params=SCENE.cameras[0].params * 1.0)
    found = calib.rig(SEEN, cameras={first: given}, **OPENCV)
    np.testing.assert_array_equal(found.rig.cameras[0].params, given.params)
    assert found.rig.covariance is not None
    assert not found.rig.covariance[found.rig.params_rows(0)].any()
    assert any("kept as it was given" in line for line in found.remarks)
    on = calib.rig(SEEN, cameras={first: given}, refine=[first], fix=[f"{first}:k3=0"], **OPENCV)
    assert ("fix", f"{first}:k3=0") in on.run.provenance.settings
    assert on.rig.cameras[0].params[-1] == 0 != on.rig.cameras[0].params[4]
    assert on.rig.cameras[1].params[-1] != 0


def test_swapped_lenses_are_told() -> None:
    """Each fits what the other camera saw."""
    a, _, b = SEEN.camera_names
    found = calib.rig(SEEN, cameras={a: SCENE.cameras[2], b: SCENE.cameras[0]}, refine=True, **OPENCV)
    assert any("may be swapped" in line for line in found.remarks)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"reference": "cam9"}, "reference 'cam9': no such camera; did you mean"),
        ({"cameras": {"nobody": SCENE.cameras[0]}}, "--camera 'nobody': no such camera; there are"),
        ({"fix": ["k9"]}, "no such parameter"),
        ({"fix": ["nobody:k3"]}, "fix 'nobody': no such camera"),
        ({"refine": ["cam0"]}, "is solved anyway"),
        ({"delays": True}, "delays: time offsets are told by time stamps"),
        ({"model": {"cam0": "periscope"}}, "no such model"),
        ({"model": "virtual"}, "is solved alone"),
        ({"table": "more.csv"}, "observations: are all there is"),
        ({"cameras": {"cam0": replace(SCENE.cameras[0], image_size=(640, 480))}}, "camera file of 640 x 480 px"),
    ],
)
def test_wishes_that_cannot_be_are_refused(options: dict[str, object], said: str) -> None:
    """In a line with the name or value, before anything is solved."""
    with pytest.raises(calib.InputError) as caught:
        calib.rig(SEEN, **{**OPENCV, **options})
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_photos_of_another_size_and_of_nothing_are_refused_by_name(photos: Path) -> None:
    """A camera whose photos are of two sizes, lenses of swapped sizes, and a camera that sees no target."""
    first, second, third = SEEN.camera_names
    folders = [str(photos / name) for name in SEEN.camera_names]
    one = next(iter((photos / second).iterdir()))
    cv2.imwrite(str(one), np.full((480, 640), 90, np.uint8))
    with pytest.raises(
        calib.InputError, match=f"camera '{second}': .* and .* has 640 x 480 px; a camera of a rig|has 640"
    ):
        calib.rig(ICO, folders, **OPENCV)
    for path in (photos / second).iterdir():
        cv2.imwrite(str(path), np.full((480, 640), 90, np.uint8))
    small = replace(SCENE.cameras[1], image_size=(640, 480))
    with pytest.raises(calib.InputError, match="may be swapped"):
        calib.rig(ICO, folders, cameras={first: small, second: SCENE.cameras[0]}, **OPENCV)
    for path in (photos / third).iterdir():
        path.rename(path.with_name(path.name.replace(f"{third}-", "")))
    with pytest.raises(
        calib.InputError, match=f"camera '{third}': none of {SEEN.sightings[2].view_count} photos shows"
    ):
        calib.rig(ICO, [folders[0], folders[2]], **OPENCV)


def test_a_camera_that_mirrors_is_told_from_one_that_sees_nothing(photos: Path) -> None:
    """Its photos show the target when they are flipped, which the detector here tells by a mark."""
    folders = [str(photos / name) for name in SEEN.camera_names[:2]]
    for path in (photos / SEEN.camera_names[1]).iterdir():
        pixels = np.full(SIZE[::-1], 90, np.uint8)
        pixels[:, -1] = MARK
        cv2.imwrite(str(path), pixels)
    with pytest.raises(calib.InputError, match="but they do when they are flipped"):
        calib.rig(ICO, folders, **OPENCV)
