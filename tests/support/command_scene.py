"""A folder with everything that the commands take, made in seconds: blank photos, and a detector that knows them."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.cameras.camera import Camera, camera_to_json
from calib.cameras.rig import Rig
from calib.core.se3 import exp_rotation
from calib.core.types import Observations
from calib.observe.calibration_file import Provenance, write_calibration
from calib.observe.dataset import write_detections
from calib.observe.observations import known_points
from calib.observe.rig_observations import rig_sightings_to_csv
from calib.renderer.job import RenderJob, truth_text
from calib.renderer.options import RenderOptions
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.arrays import Array
from designer.target import target_to_json
from tests.support.calibrations import board, camera, poses_around, seen_by
from tests.support.command_line import PICTURE, detections_of, detector_of
from tests.support.rig_views import stereo_pair
from tests.support.run_folders import BLANK, PANEL
from tests.support.study_commands import nothing_drawn

SIZE = (320, 240)
BOARD = board(7, 5, "12mm")
CAMERA = camera("opencv", SIZE, 360.0)
NOISE_PX, SHIFT_PX = 0.05, 0.75


PHOTOS = tuple(f"view_{n:04d}.png" for n in range(8))


def _poses() -> Array:
    return poses_around(len(PHOTOS), np.random.default_rng(5), distance_mm=150.0)


def _seen() -> Observations:
    """What the camera sees of the board, with noise."""
    seen = seen_by(CAMERA, known_points(BOARD), _poses(), names=PHOTOS)
    noise = np.random.default_rng(6).standard_normal(seen.center_px.shape)
    return replace(seen, center_px=seen.center_px + NOISE_PX * noise)


SEEN = _seen()
FOUND = {one.image: one for one in detections_of(SEEN, BOARD)}


def without_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """The detector above, and pictures that are not drawn: both take longer than all else."""
    monkeypatch.setattr("calib.detector.pipeline.find", lambda *_: None)
    monkeypatch.setattr("calib.detector.pipeline.detect", detector_of(FOUND))
    monkeypatch.setattr("calib.draw.picture", lambda *_, **__: PICTURE)
    monkeypatch.setattr(PANEL, lambda *_, **__: BLANK)
    monkeypatch.setattr("calib.draw.style.sheet_files", nothing_drawn)
    monkeypatch.setattr("calib.draw.measured_picture.picture", lambda *_: PICTURE)


def make_scene(folder: Path) -> None:
    """A target, photos, detections, cameras, and calibrations that went well and badly."""
    (folder / "board.target.json").write_text(target_to_json(BOARD))
    (folder / "photos").mkdir()
    (folder / "blank").mkdir()
    for path in (*(folder / "photos" / name for name in PHOTOS), folder / "blank/none.png"):
        cv2.imwrite(str(path), np.full(SIZE[::-1], 90, np.uint8))
    write_detections(folder / "detections.csv", list(FOUND.values()), BOARD)
    job = RenderJob(BOARD, CAMERA, _poses(), RenderOptions(), 0)
    (folder / "truth.json").write_text(truth_text(job))
    (folder / "camera.json").write_text(camera_to_json(CAMERA))
    other = Camera("opencv", CAMERA.params + np.eye(9)[2] * SHIFT_PX, SIZE)
    (folder / "other.json").write_text(camera_to_json(other))
    _write_squarely(folder)
    _write_pair(folder)
    _write_rig(folder)
    solved = solve(SEEN, "opencv", SolveOptions())
    write_calibration(folder / "solved", solved, Provenance("test"))
    lost = replace(solved, status="degenerate", remarks=("lost",), param_covariance=np.full((9, 9), np.nan))
    write_calibration(folder / "lost", lost, Provenance("test"))


def _write_squarely(folder: Path) -> None:
    """Photos that look at the board squarely, or nearly so, from which no camera follows."""
    for name, tilt_deg in (("frontal", 0.0), ("squarely", 0.5)):
        rng = np.random.default_rng(2)
        poses = np.tile(np.eye(4), (6, 1, 1))
        tilts = exp_rotation(np.radians(tilt_deg) * rng.standard_normal((6, 3)))
        poses[:, :3, :3] = tilts @ np.diag([1.0, -1.0, -1.0])
        poses[:, 2, 3] = np.linspace(150, 220, 6)
        seen = seen_by(CAMERA, known_points(BOARD), poses, names=PHOTOS[:6])
        noisy = replace(seen, center_px=seen.center_px + NOISE_PX * rng.standard_normal(seen.center_px.shape))
        write_detections(folder / f"{name}.csv", detections_of(noisy, BOARD), BOARD)


def _write_rig(folder: Path) -> None:
    """What two cameras saw of a board, and photos of which one camera's show nothing."""
    (folder / "rig.csv").write_bytes(rig_sightings_to_csv(stereo_pair(frames=6).observations))
    (folder / "blind.csv").write_text("camera,frame,file\nleft,0,photos/view_0000.png\nright,0,blank/none.png\n")


def _write_pair(folder: Path) -> None:
    """A rig of two cameras side by side, what both see, and what one alone sees."""
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, 0, 3] = -40.0
    fixed = np.concatenate([np.zeros(9 + 6), np.zeros(9), np.full(3, 1e-4), np.full(3, 0.01)])
    pair = Rig(("left", "right"), (CAMERA, CAMERA), poses, np.diag(fixed**2), np.full(2, NOISE_PX))
    pair.save(folder / "pair.rig.json")
    points = np.column_stack([np.linspace(-20, 40, 6), np.linspace(-15, 15, 6), np.linspace(200, 300, 6)])
    lines = [
        f"{name},a,{row},{u!r},{v!r}"
        for name, pose in zip(pair.names, poses, strict=True)
        for row, (u, v) in enumerate(CAMERA.project(points + pose[:3, 3]).tolist())
    ]
    (folder / "sightings.csv").write_text("\n".join(["camera,frame,point,u,v", *lines, ""]))
    (folder / "alone.csv").write_text("\n".join(["camera,frame,point,u,v", lines[0], ""]))
