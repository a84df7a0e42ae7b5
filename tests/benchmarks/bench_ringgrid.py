"""The detector against `ringgrid` (PyPI), on ringgrid's own rectangular board and on ours.

Run from the repository's root: `python -m tests.benchmarks.bench_ringgrid [--quick]`, with `ringgrid` installed. Both
boards have 20 x 20 features of R = 15 px when seen straight on, focal length 2500 px, blur 0.7 px, contrast over noise
50. Pictures of ringgrid's board are drawn exactly from its layout (and compared with the artwork it writes); ours come
from the renderer.

Settings: ringgrid is told the layout and runs in three ways, of which each row of the table is printed: as it comes
(`default`), told the range of diameters in the picture (`scale told`, its most effective setting by its own guide)
and its adaptive mode with the nominal diameter (`adaptive`). The detector gets the layout and nothing else. A feature
counts as found when its centre is within 5 px of a true one; names are not asked of ringgrid, and ours must be right
up to the symmetry of the board where it carries no dots that we read.
"""

import argparse
import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import ringgrid
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.core.se3 import exp_rotation
from calib.detector.pipeline import detect
from calib.renderer import RenderOptions, render_view
from designer.kinds.board import BoardSpec
from designer.kinds.layout import lay_out
from designer.target import TargetGeometry
from tests.benchmarks.synthetic import (
    DARK,
    LIGHT,
    Array,
    apply_homography,
    best_of,
    eight_bit,
    picture_of_plane,
    plane_view,
    rms,
    row,
)

SIDE, PITCH_MM, OUTER_MM, INNER_MM = 20, 14.0, 5.6, 2.8
FOCAL_PX, OUTER_PX, BLUR_PX, TILTS_DEG = 2500.0, 15.0, 0.7, (0, 35, 45, 55, 65)
SIZE = (1100, 1100)
NOISE_LEVELS = 255 * (LIGHT - DARK) / 50
FLIP = np.diag([1.0, -1.0, 1.0])
OUR_SPEC = BoardSpec((290.0, 290.0), 3.0, SIDE, SIDE, "square", 2 * OUTER_MM, 0.45, PITCH_MM, 0.0, 1.0, dots=True)


@dataclass(frozen=True, eq=False)
class Scene:
    """One picture of a board."""

    image: NDArray[np.uint8]
    truth_px: Array  # (R, 2) in the rows of `target`
    tilt_rad: float
    target: TargetGeometry
    peer_layout: ringgrid.TargetLayout
    named: bool  # whether the board shows which way up it is


@dataclass(frozen=True, eq=False)
class Outcome:
    """What one detector made of a picture."""

    found: int
    false: int
    error_px: Array  # (K, 2)
    seconds: float
    remark: str = ""


def peer_board() -> tuple[ringgrid.TargetLayout, TargetGeometry, Array]:
    """The board of ringgrid, the same as a target of ours without dots, and its origin dots on the face (D, 2)."""
    layout = ringgrid.TargetLayout.plain_rect(PITCH_MM, SIDE, SIDE, OUTER_MM, INNER_MM, dots=True)
    column, line = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
    index = np.stack([column.ravel(), -line.ravel()], axis=1)
    middle = PITCH_MM * (SIDE - 1) / 2
    place = PITCH_MM * index + np.array([-middle, middle])
    half = middle + PITCH_MM
    outline = np.array([[[-half, -half], [half, -half], [half, half], [-half, half]]])
    target = TargetGeometry(
        source="nominal",
        spec=None,
        ring_face=np.zeros(len(index), dtype=int),
        ring_index=index,
        center_mm=np.column_stack([place, np.zeros(len(place))]),
        radius_outer_mm=np.full(len(index), OUTER_MM),
        radius_inner_mm=np.full(len(index), INNER_MM),
        is_dot=np.zeros(len(index), dtype=bool),
        target_from_face=np.eye(4)[None],
        outline_mm=outline,
        window_mm=outline,
        face_code=np.array([-1]),
        lattice_mm=np.array([[[PITCH_MM, 0.0], [0.0, PITCH_MM]]]),
    )
    dots = np.array(layout.fiducial_dots_mm()) * [1.0, -1.0] + np.array([-middle, middle])
    return layout, target, dots


def view_of(tilt_rad: float, rng: np.random.Generator) -> Array:
    """`pixel_from_face` of the board, turned a little and off the pixel raster."""
    middle = (np.array(SIZE) - 1) / 2 + rng.uniform(-0.5, 0.5, 2)
    return plane_view(FOCAL_PX, tilt_rad, 0.3, FOCAL_PX * OUTER_MM / OUTER_PX, middle) @ FLIP


def peer_scene(tilt_rad: float, rng: np.random.Generator) -> Scene:
    """A picture of ringgrid's board."""
    layout, target, dots = peer_board()
    view = view_of(tilt_rad, rng)
    place = target.center_in_face_mm[:, :2]
    dot_radius = layout.to_dict()["fiducials"]["dot_radius_mm"]
    image = picture_of_plane(SIZE, view, *_with_dots(place, dots, dot_radius), BLUR_PX)
    return Scene(
        eight_bit(image, NOISE_LEVELS, rng), apply_homography(view, place), tilt_rad, target, layout, named=False
    )


def our_scene(tilt_rad: float, rng: np.random.Generator) -> Scene:
    """A rendered picture of our board."""
    target = lay_out(OUR_SPEC)
    layout = ringgrid.TargetLayout.plain_rect(PITCH_MM, SIDE, SIDE, OUTER_MM, 0.45 * OUTER_MM, dots=False)
    middle = (np.array(SIZE) - 1) / 2 + rng.uniform(-0.5, 0.5, 2)
    camera = Camera("opencv", np.array([FOCAL_PX, FOCAL_PX, *middle, *np.zeros(5)]), SIZE)
    pose = np.eye(4)
    pose[:3, :3] = exp_rotation(tilt_rad * np.array([math.cos(0.3), math.sin(0.3), 0.0])) @ np.diag([1.0, -1.0, -1.0])
    pose[2, 3] = FOCAL_PX * OUTER_MM / OUTER_PX
    options = RenderOptions(black=DARK, white=LIGHT, background=LIGHT, blur_px=BLUR_PX, contrast_to_noise=50.0)
    view = render_view(target, camera, pose, options, rng)
    image = np.asarray(view.image, dtype=np.uint8)
    return Scene(image, view.center_px, tilt_rad, target, layout, named=True)


def _with_dots(place: Array, dots: Array, dot_radius_mm: float) -> tuple[Array, Array, Array]:
    """Centres, outer and inner radii of ringgrid's rings and dots."""
    count = len(dots)
    outer = np.r_[np.full(len(place), OUTER_MM), np.full(count, dot_radius_mm)]
    return np.vstack([place, dots]), outer, np.r_[np.full(len(place), INNER_MM), np.zeros(count)]


def artwork_difference() -> float:
    """Share of pixels in which our drawing of ringgrid's board and its own artwork disagree clearly."""
    layout, target, dots = peer_board()
    scale = 10.0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "artwork.png"
        layout.write_png(path, dpi=25.4 * scale, margin_mm=10.0, include_scale_bar=False)
        art = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), dtype=np.float64) / 255
    view = np.diag([scale, -scale, 1.0])
    view[:2, 2] = np.array(art.shape[::-1]) / 2
    dot_radius = layout.to_dict()["fiducials"]["dot_radius_mm"]
    size = art.shape[1], art.shape[0]
    drawn = picture_of_plane(size, view, *_with_dots(target.center_in_face_mm[:, :2], dots, dot_radius), 0.0, fine=1)
    return float((np.abs((drawn - DARK) / (LIGHT - DARK) - art) > 0.8).mean())


def ours(scene: Scene) -> Outcome:
    """The detector, names counted."""
    found = detect(scene.image, scene.target, name="scene")
    seconds = best_of(3, lambda: detect(scene.image, scene.target, name="scene"))
    best = Outcome(0, len(found.ring), np.zeros((0, 2)), seconds)
    for truth in [scene.truth_px] if scene.named else _turned(scene.truth_px):
        error = np.asarray(found.center_px) - truth[found.ring]
        good = np.linalg.norm(error, axis=1) < 5
        if good.sum() > best.found:
            remark = "; ".join(found.remarks)
            best = Outcome(int(good.sum()), int((~good).sum()), error[good], seconds, remark)
    return best


def _turned(truth: Array) -> list[Array]:
    """The true centres under the four rotations of a square grid's names."""
    grid = truth.reshape(SIDE, SIDE, 2)
    return [np.rot90(grid, k, axes=(0, 1)).reshape(-1, 2) for k in range(4)]


def theirs(scene: Scene, mode: str) -> Outcome:
    """Runs ringgrid in one of its modes."""
    config = ringgrid.DetectConfig(scene.peer_layout)
    if mode == "scale told":
        smallest, largest = 2 * OUTER_PX * math.cos(scene.tilt_rad), 2 * OUTER_PX
        config.marker_scale = ringgrid.MarkerScalePrior(0.85 * smallest, 1.2 * largest)
    detector = ringgrid.Detector(config)

    def run() -> ringgrid.DetectionResult:
        if mode == "adaptive":
            return detector.detect_adaptive(scene.image, nominal_diameter_px=2 * OUTER_PX)
        return detector.detect(scene.image)

    center = np.array([marker.center for marker in run().detected_markers]).reshape(-1, 2)
    distance = np.linalg.norm(center[:, None] - scene.truth_px[None], axis=2)
    nearest = distance.argmin(axis=1) if len(center) else np.zeros(0, dtype=int)
    good = distance.min(axis=1, initial=np.inf) < 5
    error = (center - scene.truth_px[nearest])[good]
    return Outcome(
        len(set(nearest[good].tolist())), int((~good).sum()), error, best_of(1 if mode == "adaptive" else 3, run)
    )


def report(name: str, draw: Callable[[float, np.random.Generator], Scene], tilts: tuple[int, ...]) -> None:
    """The table of one board: recall, 2-D error, time."""
    print(f"{name}: found of {SIDE * SIDE} (false) | RMSE 2-D px | ms")
    rng = np.random.default_rng(1)
    for tilt in tilts:
        scene = draw(math.radians(tilt), rng)
        own = ours(scene)
        row(f"{tilt} deg  calib.detector", "", _text(own), own.remark)
        for mode in ("default", "scale told", "adaptive"):
            peer = theirs(scene, mode)
            better = own.found >= peer.found and own.seconds < peer.seconds
            better &= not peer.found or rms(own.error_px) < rms(peer.error_px)
            ratio = f"error x {rms(peer.error_px) / rms(own.error_px):.1f}, time x {peer.seconds / own.seconds:.1f}"
            row(f"        ringgrid, {mode}", "all better", _text(peer), f"{ratio}{'' if better else '  NOT better'}")


def _text(outcome: Outcome) -> str:
    error = math.sqrt(2) * rms(outcome.error_px)
    return f"{outcome.found} ({outcome.false}) | {error:.4f} | {1e3 * outcome.seconds:.0f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="0 and 45 degrees only")
    tilts = (0, 45) if parser.parse_args().quick else TILTS_DEG
    print(f"ringgrid {ringgrid.__version__}; its artwork and our drawing of it differ in {artwork_difference():.2%}")
    report("ringgrid's rect board", peer_scene, tilts)
    report("our board", our_scene, tilts)


if __name__ == "__main__":
    main()
