"""Are stated sigmas true at every incidence, whatever optics and processing? Errors in stated ones, photos of a solid.

Run from the repository's root: `python -m tests.benchmarks.bench_sigmas [--draws N] [--only NAME ...] [--seed S]`.
The same photos of an icosahedron, twenty from all sides, are taken with new noise in each draw. Light comes from the
renderer; gloss, lens, tone and files are made here. Columns, by incidence of the rings (0-30, 30-50, 50-65, 65-90 deg):

  detector    root mean square of errors in sigmas that the photos state: 1 is honest, above is too sure
  solved      the same in sigmas of the calibration, in which is what the residuals say of all photos
  true px     RMS error of a centre per axis
  camera      squared errors of all parameters in their joint covariance, per degree of freedom: mean over the draws
  k3          error of the last radial parameter over its sigma: mean over the draws
"""

import argparse
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.cameras import rays
from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.core.se3 import transform
from calib.core.types import Detections
from calib.detector.pipeline import detect
from calib.observe.observations import observations_from_detections
from calib.renderer import RenderOptions, render_view
from calib.renderer.faces import ring_truth
from calib.renderer.light import blurred
from calib.renderer.poses import PoseGrid, grid_poses
from calib.renderer.scene import RenderScene, scene_from_target
from calib.solver.solve import solve
from tests.benchmarks.synthetic import Array, target_of
from tests.support.sightings import pinhole

Light = NDArray[np.float32]
Levels = NDArray[np.uint8]

CAMERA = pinhole(1000, 800, 2000.0)
TARGET = "ico 100 mm"
BANDS_DEG = (0, 30, 50, 65, 90)
PHOTOS = 20
GRID = PoseGrid(PHOTOS, math.pi, (450.0, 700.0), random_roll=True, aim_offset_mm=30.0)
SHARP = RenderOptions(bits=32)
BLUR_PX, NOISE = 0.7, 0.7 / 60
LAMPS, LAMP_RING_MM, LOBE_RAD, GLOSS = 16, 60.0, 0.12, 0.6
OPENINGS, FOCUS_MM = 24, 560.0


@dataclass(frozen=True)
class Case:
    """How photos are made: the light of a pose on the pixels, and what a camera makes of it."""

    light: Callable[[RenderScene, Array, int], Light]
    file: Callable[[Light], Levels]
    noise: float = NOISE


def drawn(scene: RenderScene, pose: Array, seed: int, options: RenderOptions = SHARP, camera: Camera = CAMERA) -> Light:
    """As the renderer does it, without noise and blur."""
    return np.asarray(render_view(scene, camera, pose, options, np.random.default_rng(seed)).image, dtype=np.float32)


def clean(scene: RenderScene, pose: Array, seed: int) -> Light:
    """Evenly lit and in focus."""
    return blurred(drawn(scene, pose, seed), BLUR_PX)


def soft(scene: RenderScene, pose: Array, seed: int) -> Light:
    """With a wider blur."""
    return blurred(drawn(scene, pose, seed), 1.2)


def hard_light(scene: RenderScene, pose: Array, seed: int) -> Light:
    """A lamp from the side: faces of all brightnesses, gradients, a highlight."""
    lit = replace(SHARP, shading=0.8, light_gradient=0.6, glare=0.4)
    return blurred(drawn(scene, pose, seed, lit), BLUR_PX)


def glossy(scene: RenderScene, pose: Array, seed: int) -> Light:
    """A glossy target with a ring of lamps around the lens."""
    ray = rays(CAMERA, image_grid(CAMERA.image_size, *CAMERA.image_size))
    frames = np.stack([face.target_from_face for face in scene.faces])
    normal = frames[:, :3, 2] @ pose[:3, :3].T
    height = (normal * transform(pose, frames[:, :3, 3])).sum(axis=1)
    facing = height < 0
    # The first point of a convex body on a ray lies on the farthest of the planes that face the camera.
    depth = height[facing] / np.minimum(ray @ normal[facing].T, -1e-9)
    face = depth.argmax(axis=-1)
    point, outward = ray * depth.max(axis=-1)[..., None], normal[facing][face]
    light, angle = np.zeros(face.shape), 2 * np.pi * np.arange(LAMPS) / LAMPS
    for lamp in LAMP_RING_MM * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(LAMPS)]):
        to_lamp = lamp - point
        half = to_lamp / np.linalg.norm(to_lamp, axis=-1, keepdims=True) - ray
        cosine = (half * outward).sum(axis=-1) / np.linalg.norm(half, axis=-1)
        light += np.exp(-(1 - cosine) / LOBE_RAD**2) / LAMPS
    view = drawn(scene, pose, seed)
    beyond = drawn(scene, pose, seed, replace(SHARP, background=0.9))
    on_target = 1 - (beyond - view) / 0.5
    return blurred(np.asarray(view + GLOSS * light * on_target, dtype=np.float32), BLUR_PX)


def defocused(aperture_mm: float) -> Callable[[RenderScene, Array, int], Light]:
    """A thin lens: the mean of what pinholes all over its opening see, each shifted so that the focus stays."""

    def take(scene: RenderScene, pose: Array, seed: int) -> Light:
        total = np.zeros(CAMERA.image_size[::-1], dtype=np.float32)
        for n in range(OPENINGS):
            # In pairs on both sides of the middle, so that no shift remains.
            radius = 0.5 * aperture_mm * math.sqrt((n // 2 + 0.5) / (OPENINGS // 2))
            angle = (n // 2) * math.pi * (3 - math.sqrt(5)) + math.pi * (n % 2)
            aside, params, moved = (
                radius * np.array([math.cos(angle), math.sin(angle)]),
                CAMERA.params.copy(),
                pose.copy(),
            )
            params[2:4] += CAMERA.params[:2] * aside / FOCUS_MM
            moved[:2, 3] -= aside
            total += drawn(scene, moved, seed, camera=Camera(CAMERA.model, params, CAMERA.image_size))
        return blurred(np.asarray(total / OPENINGS, dtype=np.float32), 0.5)

    return take


def moved(length_px: float) -> Callable[[RenderScene, Array, int], Light]:
    """The camera turns while the shutter is open."""

    def take(scene: RenderScene, pose: Array, seed: int) -> Light:
        half, angle = math.ceil(length_px), np.random.default_rng(seed).uniform(0, math.pi)
        kernel = np.zeros((2 * half + 1, 2 * half + 1), dtype=np.float32)
        for t in np.linspace(-length_px / 2, length_px / 2, 200):
            u, v = half + t * math.cos(angle), half + t * math.sin(angle)
            fu, fv = u % 1, v % 1
            kernel[int(v) : int(v) + 2, int(u) : int(u) + 2] += np.outer([1 - fv, fv], [1 - fu, fu]).astype(np.float32)
        return np.asarray(cv2.filter2D(clean(scene, pose, seed), -1, kernel / kernel.sum()), dtype=np.float32)

    return take


def linear(light: Light) -> Levels:
    """Eight bits."""
    return np.asarray(np.rint(np.clip(light, 0, 1) * 255), dtype=np.uint8)


def gamma(light: Light) -> Levels:
    """A power of 1 / 2.2."""
    return linear(np.asarray(np.clip(light, 0, 1) ** np.float32(1 / 2.2), dtype=np.float32))


def srgb(light: Light) -> Levels:
    """The tone of sRGB."""
    x = np.clip(light, 0, 1)
    return linear(np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** np.float32(1 / 2.4) - 0.055).astype(np.float32))


def s_curve(light: Light) -> Levels:
    """As cameras draw pictures: sRGB, and an S-shaped curve on it."""
    x = srgb(light) / np.float32(255)
    return linear(x * x * (3 - 2 * x))


def jpeg(light: Light) -> Levels:
    """sRGB, through JPEG."""
    data = cv2.imencode(".jpg", srgb(light), [cv2.IMWRITE_JPEG_QUALITY, 90])[1]
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


def bayer(light: Light) -> Levels:
    """A colour sensor whose mosaic is interpolated, and made grey; colours of a warm lamp."""
    raw = light.copy()
    raw[0::2, 0::2] *= 0.9
    raw[1::2, 1::2] *= 0.6
    rgb = cv2.cvtColor(linear(raw), cv2.COLOR_BayerRGGB2RGB).astype(np.float32) / np.array([0.9, 1, 0.6])
    return linear(rgb.astype(np.float32) @ np.array([0.299, 0.587, 0.114], dtype=np.float32) / 255)


CASES: dict[str, Case] = {
    "linear": Case(clean, linear),
    "gamma 2.2": Case(clean, gamma),
    "sRGB": Case(clean, srgb),
    "sRGB and S-curve": Case(clean, s_curve),
    "sRGB, JPEG 90": Case(clean, jpeg),
    "Bayer": Case(clean, bayer),
    "noisy": Case(clean, linear, 3 * NOISE),
    "soft": Case(soft, linear),
    "defocus 3 mm": Case(defocused(3.0), linear),
    "defocus 5 mm": Case(defocused(5.0), linear),
    "motion 3 px": Case(moved(3.0), linear),
    "motion 3 px, sRGB": Case(moved(3.0), srgb),
    "gloss, ring light": Case(glossy, linear),
    "hard light": Case(hard_light, linear),
    "hard light, sRGB": Case(hard_light, srgb),
}


@dataclass(frozen=True, eq=False)
class Draw:
    """The centres and the camera of one calibration."""

    incidence_deg: Array  # (M,)
    error_px: Array  # (M, 2)
    cov_px2: Array  # (M, 2, 2) as detected
    solved_px2: Array  # (M, 2, 2) as the calibration has them
    camera_chi2: float  # per degree of freedom
    k3: float  # in sigmas


def photographed(case: Case, draws: int, seed: int) -> Iterator[list[Detections]]:
    """What is detected in each draw."""
    target = target_of(TARGET)
    scene, poses = scene_from_target(target), photo_poses(seed)
    light = [case.light(scene, pose, seed + n) for n, pose in enumerate(poses)]
    for draw in range(draws):
        rng = np.random.default_rng([seed, draw])
        noisy = (one + np.float32(case.noise) * rng.standard_normal(one.shape, dtype=np.float32) for one in light)
        yield [detect(case.file(one), target, name=f"{n:02d}") for n, one in enumerate(noisy)]


def photo_poses(seed: int) -> Array:
    """Where the camera stands.  # (V, 4, 4)"""
    return grid_poses(GRID, np.random.default_rng(seed))


def outcome(found: list[Detections], seed: int) -> Draw:
    """The errors of one draw."""
    target = target_of(TARGET)
    scene = scene_from_target(target)
    stated = observations_from_detections(found, target)
    solved = solve(stated, CAMERA.model)
    seen = solved.observations
    truth = [ring_truth(scene, CAMERA, pose) for pose in photo_poses(seed)]
    number = np.array([int(name) for name in seen.view_names])[seen.view]
    center = np.stack([one.center_px for one in truth])[number, seen.point]
    incidence = np.stack([one.incidence_rad for one in truth])[number, seen.point]
    assert stated.cov_px2 is not None
    assert seen.cov_px2 is not None
    assert len(seen.view) == len(stated.view)
    off = solved.camera.params - CAMERA.params
    chi2 = float(off @ np.linalg.solve(solved.param_covariance, off)) / len(off)
    k3 = float(off[-1] / math.sqrt(solved.param_covariance[-1, -1]))
    cov = solved.scale**2 * seen.cov_px2
    return Draw(np.degrees(incidence), seen.center_px - center, stated.cov_px2, cov, chi2, k3)


def in_sigmas(error: Array, cov: Array) -> float:
    """Root mean square of errors in stated sigmas."""
    return math.sqrt(float(np.einsum("ni,nij,nj->n", error, np.linalg.inv(cov), error).mean()) / 2)


def report(name: str, draws: list[Draw]) -> None:
    """One line of the table."""
    incidence, error, cov, solved = (
        np.concatenate([getattr(one, part) for one in draws])
        for part in ("incidence_deg", "error_px", "cov_px2", "solved_px2")
    )
    bands = [(incidence >= low) & (incidence < high) for low, high in pairwise(BANDS_DEG)]
    print(
        f"{name:20s}{len(error) // len(draws):6d} "
        + " ".join(f"{in_sigmas(error[band], cov[band]):5.2f}" for band in bands) + "  "
        + " ".join(f"{in_sigmas(error[band], solved[band]):5.2f}" for band in bands) + "  "
        + " ".join(f"{math.sqrt(float((error[band] ** 2).mean())):.4f}" for band in bands)
        + f"  {np.mean([one.camera_chi2 for one in draws]):6.2f} {np.mean([one.k3 for one in draws]):+6.2f}",
        flush=True,
    )  # fmt: skip


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=[""])
    asked = parser.parse_args()
    print(f"{'case':20s} rings  {'detector':24s}{'solved':25s}{'true px':28s} camera     k3")
    for name, case in CASES.items():
        if any(part in name for part in asked.only):
            report(name, [outcome(found, asked.seed) for found in photographed(case, asked.draws, asked.seed)])


if __name__ == "__main__":
    main()
