"""Folders of pictures as commands leave them: rendered, with overlays of rings or of poses."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calib.app.detect import DetectedPhotos
from calib.app.pose import TargetPoses
from calib.app.rendered_photos import RenderedPhotos
from calib.cameras.camera import Camera
from calib.core.types import TOO_FLAT, Detections, FaceRecord
from calib.observe.photos import PhotoFile, PhotoResult, Search
from calib.observe.target_poses import PhotoWithoutPose, PoseResult, TargetPose
from calib.renderer.job import Rendered, RenderJob, truth_text
from calib.renderer.options import RenderOptions
from designer.page.blocks import Page
from designer.target import TargetGeometry
from tests.support.calibrations import board, icosahedron, poses_around
from tests.support.pages import png

CAMERA = Camera("opencv", np.array([900.0, 900.0, 319.5, 239.5, -0.2, 0.05, 0.0, 0.0, 0.0]), (640, 480))
PINHOLE = Camera("pinhole", CAMERA.params[:4], CAMERA.image_size)
BOARD, ICO = board(), icosahedron()
PLAIN = RenderOptions()


def poses(views: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Poses around a target."""
    return poses_around(views, np.random.default_rng(3), distance_mm=500.0)


def pictures(folder: Path, names: Sequence[str], content: bytes = b"") -> None:
    """Small pictures, or the same one for all."""
    folder.mkdir(parents=True, exist_ok=True)
    for row, name in enumerate(names):
        (folder / name).write_bytes(content or png(64, 48, 20 + row % 200))


def rendered(
    folder: Path, target: TargetGeometry = BOARD, options: RenderOptions = PLAIN, views: int = 4, content: bytes = b""
) -> RenderedPhotos:
    """What `calib render` leaves, but for the page."""
    job = RenderJob(target, CAMERA, poses(views), options, seed=5)
    pictures(folder, job.file_names, content)
    (folder / "truth.json").write_text(truth_text(job))
    return RenderedPhotos(job, target_file="my.target.json", folder=str(folder), done=Rendered(views, 0, 1.0, 1))


def face(found: int, expected: int, number: int = 0, flat: int = 0) -> FaceRecord:
    """A face of which some rings were found, some were not, and some are seen too flat."""
    missing = (("odd shape", expected - found), (TOO_FLAT, flat))
    return FaceRecord(number, ("dot",), 7, found, expected + flat, tuple((why, n) for why, n in missing if n))


def result(name: str, faces: Sequence[FaceRecord] = (), overlay: str = "", failure: str = "") -> PhotoResult:
    """What came of a photo."""
    if failure:
        return PhotoResult(PhotoFile(Path(name), name), None, failure)
    count = sum(one.rings_found for one in faces)
    seen = Detections(
        name, (640, 480), BOARD.layout_id, BOARD.geometry_id, np.arange(count) % BOARD.ring_count,
        BOARD.center_mm[np.arange(count) % BOARD.ring_count],
        np.zeros((count, 2)), np.tile(np.eye(2), (count, 1, 1)), np.zeros((count, 5)), tuple(faces),
    )  # fmt: skip
    return PhotoResult(PhotoFile(Path(name), name), seen, overlay=Path(overlay) if overlay else None)


def detected(
    folder: Path,
    results: Sequence[PhotoResult],
    target: TargetGeometry = BOARD,
    failures: Sequence[str] = (),
    table: Path | None = None,
) -> Page:
    """The page that `calib detect --overlay` leaves, which is written too."""
    folder.mkdir(parents=True, exist_ok=True)
    search = Search(target, tuple(results), tuple(failures), 0, 1.0)
    found = DetectedPhotos(search, "my.target.json", table or folder.parent / "detections.csv", folder)
    page, _, remark = found.draw_page(folder, "calib detect -o somewhere")
    assert page is not None, remark
    return page


def overlaid(folder: Path) -> Page:
    """Overlays of two photos in which all was found, and their page."""
    names = ["a.overlay.png", "b.overlay.png"]
    pictures(folder, names)
    return detected(folder, [result(f"{name[0]}.png", [face(40, 40, flat=3)], name) for name in names])


def posed(
    folder: Path, rms_px: Sequence[float] = (0.02, 0.03, 0.09), reasons: Sequence[str] = ("none",)
) -> TargetPoses:
    """What `calib pose --overlay` finds: photos with so much left over, and others without a pose."""
    names = [f"{row}.png" for row in range(len(rms_px) + len(reasons))]
    overlays = {name: f"{Path(name).stem}.pose.overlay.png" for name in names[: len(rms_px)]}
    pictures(folder, list(overlays.values()))
    found = tuple(
        TargetPose(name, 30, rms, np.arange(3.0), np.full(3, 0.01), 500.0, 0.02, 1e-4, pose, np.eye(6))
        for name, rms, pose in zip(names, rms_px, poses(max(len(rms_px), 1)), strict=False)
    )
    why = tuple(map(PhotoWithoutPose, names[len(rms_px) :], reasons))
    search = Search(ICO, tuple(result(name) for name in names), (), 0, 1.0)
    found_poses = PoseResult(ICO, CAMERA, search, found, why)
    by_photo = {("", name): path for name, path in overlays.items()}
    return TargetPoses(found_poses, "my.target.json", "camera.json", Path("poses.json"), folder, by_photo)
