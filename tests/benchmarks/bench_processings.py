"""Are stated uncertainties true whatever made and processed the photo? Stated against true errors, case by case.

Run from the repository's root: `python -m tests.benchmarks.bench_processings [--sets N] [--only NAME ...] [--seed S]`.
Each set is a calibration from twelve small photos of a board with a known camera. The light comes from the renderer;
what a lens, a sensor or a program then does to it is done here. Columns:

  rings       found, of those that the image holds
  true        RMS error of a centre per axis (px), and over the stated one: 1 is honest, above is too sure
  bias        mean error along the worse axis (px)
  chi2        squared errors in stated covariances, per degree of freedom: mean, and median over that of noise
  camera      squared errors of all parameters in their joint covariance, per degree of freedom
  image       RMS error of the camera over the image, in stated ones (its own rotation removed)
  said        what the detector says of the photos
"""

import argparse
import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.core.types import Detections
from calib.detector.pipeline import detect
from calib.observe.observations import observations_from_detections
from calib.renderer import RenderOptions, render_view
from calib.renderer.faces import ring_truth
from calib.renderer.scene import scene_from_target
from calib.solver.accuracy import projected_change
from calib.solver.calibrate import calibrate
from calib.solver.calibration import Calibration
from calib.solver.problem import SolveOptions
from designer.kinds.board import BoardSpec
from designer.kinds.layout import lay_out
from designer.target import TargetGeometry
from tests.benchmarks.synthetic import Array, look_at
from tests.support.sightings import pinhole

Light = NDArray[np.float32]
Levels = NDArray[np.uint8]

SIZE, FOCAL_PX = (720, 480), 1150.0
PHOTOS = 12
DISTANCE_MM, MOST_TILT = 330.0, 0.75
CLEAN = RenderOptions(blur_px=0.7, contrast_to_noise=50, bits=32)
MARGIN_PX = 20.0


@dataclass(frozen=True, eq=False)
class Shot:
    """What a photo is taken with."""

    target: TargetGeometry
    camera: Camera
    cam_from_target: Array
    rng: np.random.Generator


@dataclass(frozen=True, eq=False)
class Photo:
    """What comes out, and where its rings are."""

    image: Levels
    center_px: Array  # (R, 2) of all of the target's


Take = Callable[[Shot], Photo]


def levels(light: Light) -> Levels:
    """Eight bits."""
    return np.asarray(np.rint(np.clip(light, 0, 1) * 255), dtype=np.uint8)


def light_of(shot: Shot, options: RenderOptions = CLEAN) -> tuple[Light, Array]:
    """Light on the pixels, noise included, and the true centres."""
    view = render_view(shot.target, shot.camera, shot.cam_from_target, options, shot.rng)
    truth = ring_truth(scene_from_target(shot.target), shot.camera, shot.cam_from_target)
    return np.asarray(view.image, dtype=np.float32), truth.center_px


def noisy(light: Light, rng: np.random.Generator) -> Light:
    """With even noise."""
    return light + np.float32(CLEAN.noise_sigma) * rng.standard_normal(light.shape, dtype=np.float32)


def rendered(**options: float | str) -> Take:
    """As the renderer makes it."""
    settings = replace(CLEAN, **{"bits": 8, **options})  # type: ignore[arg-type]

    def take(shot: Shot) -> Photo:
        light, center = light_of(shot, settings)
        return Photo(np.asarray(light, dtype=np.uint8), center)

    return take


def processed(change: Callable[[Levels], Levels], options: RenderOptions = CLEAN) -> Take:
    """A photo of eight bits, and what a program makes of it."""

    def take(shot: Shot) -> Photo:
        light, center = light_of(shot, options)
        return Photo(np.ascontiguousarray(change(levels(light))), center)

    return take


def sharpened(amount: float, sigma_px: float) -> Callable[[Levels], Levels]:
    """Unsharp mask."""

    def change(image: Levels) -> Levels:
        soft = cv2.GaussianBlur(image, (0, 0), sigma_px)
        return np.asarray(cv2.addWeighted(image, 1 + amount, soft, -amount, 0), dtype=np.uint8)

    return change


def toned(image: Levels) -> Levels:
    """An S-shaped tone curve, as cameras draw pictures."""
    x = image / 255.0
    return levels(np.asarray(x * x * (3 - 2 * x), dtype=np.float32))


def jpeg(quality: int) -> Callable[[Levels], Levels]:
    """Through JPEG."""

    def change(image: Levels) -> Levels:
        _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
        return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)

    return change


def resampled(factor: float, how: int) -> Take:
    """Photographed larger and brought to size; the middle of the image stays where it is."""

    def take(shot: Shot) -> Photo:
        width, height = round(SIZE[0] / factor), round(SIZE[1] / factor)
        large = replace(shot, camera=pinhole(width, height, FOCAL_PX / factor))
        light, center = light_of(large)
        middle = np.array([(width - 1) / 2, (height - 1) / 2])
        to_large = np.array([[1 / factor, 0, 0], [0, 1 / factor, 0]])
        to_large[:, 2] = middle - (np.array(SIZE) - 1) / 2 / factor
        image = cv2.warpAffine(levels(light), to_large, SIZE, flags=how | cv2.WARP_INVERSE_MAP)
        return Photo(np.asarray(image, dtype=np.uint8), (center - middle) * factor + (np.array(SIZE) - 1) / 2)

    return take


def texture(texels_per_pitch: float) -> Take:
    """Another renderer: a black-and-white texture without grey edges, looked up between its four nearest texels."""

    def take(shot: Shot) -> Photo:
        target, scale, radius = shot.target, texels_per_pitch / 10.0, float(shot.target.radius_outer_mm[0])
        size = np.ceil((np.ptp(target.center_mm[:, :2], axis=0) + 20) * scale).astype(int)
        corner = target.center_mm[:, :2].min(axis=0) - 10
        picture = np.full((size[1], size[0]), 255, dtype=np.uint8)
        y, x = np.mgrid[: size[1], : size[0]] / scale
        for center, is_dot in zip(target.center_mm[:, :2] - corner, target.is_dot, strict=True):
            away = np.hypot(x - center[0], y - center[1])
            picture[(away < radius) & ((away > 0.45 * radius) | is_dot)] = 0
        fx, fy, cx, cy = shot.camera.params[:4]
        matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]) @ shot.cam_from_target[:3, [0, 1, 3]]
        from_texel = np.array([[1 / scale, 0, corner[0]], [0, 1 / scale, corner[1]], [0, 0, 1]])
        image = cv2.warpPerspective(picture, matrix @ from_texel, SIZE, flags=cv2.INTER_LINEAR, borderValue=(255.0,))
        truth = ring_truth(scene_from_target(target), shot.camera, shot.cam_from_target)
        return Photo(np.asarray(image, dtype=np.uint8), truth.center_px)

    return take


def defocused(aperture_mm: float, focus_mm: float, rays: int = 40) -> Take:
    """A thin lens: the mean of what pinholes all over its opening see, each shifted so that the focus stays."""

    def take(shot: Shot) -> Photo:
        total, (width, height) = np.zeros(SIZE[::-1], dtype=np.float32), SIZE
        for n in range(rays):
            # In pairs on both sides of the middle, so that no shift remains.
            radius = 0.5 * aperture_mm * math.sqrt((n // 2 + 0.5) / (rays // 2))
            angle = (n // 2) * math.pi * (3 - math.sqrt(5)) + math.pi * (n % 2)
            a = radius * np.array([math.cos(angle), math.sin(angle)])
            params = np.array(shot.camera.params)
            params[2:4] += FOCAL_PX * a / focus_mm
            pose = shot.cam_from_target.copy()
            pose[:2, 3] -= a
            part = replace(CLEAN, contrast_to_noise=0, blur_px=0)
            total += light_of(
                replace(shot, camera=Camera("opencv", params, (width, height)), cam_from_target=pose), part
            )[0]
        light = np.asarray(cv2.GaussianBlur(total / rays, (0, 0), 0.5), dtype=np.float32)
        truth = ring_truth(scene_from_target(shot.target), shot.camera, shot.cam_from_target)
        return Photo(levels(noisy(light, shot.rng)), truth.center_px)

    return take


def moved(length_px: float) -> Take:
    """The camera moves while the shutter is open."""

    def take(shot: Shot) -> Photo:
        light, center = light_of(shot, replace(CLEAN, contrast_to_noise=0))
        half, angle = math.ceil(length_px), shot.rng.uniform(0, math.pi)
        kernel = np.zeros((2 * half + 1, 2 * half + 1), dtype=np.float32)
        for t in np.linspace(-length_px / 2, length_px / 2, 200):
            u, v = half + t * math.cos(angle), half + t * math.sin(angle)
            fu, fv = u % 1, v % 1
            kernel[int(v) : int(v) + 2, int(u) : int(u) + 2] += np.outer([1 - fv, fv], [1 - fu, fu]).astype(np.float32)
        spread = np.asarray(cv2.filter2D(light, -1, kernel / kernel.sum()), dtype=np.float32)
        return Photo(levels(noisy(spread, shot.rng)), center)

    return take


CASES: dict[str, Take] = {
    "area": rendered(),
    "area, without noise": rendered(contrast_to_noise=0.0),
    "area, sharp, without noise": rendered(contrast_to_noise=0.0, blur_px=0.0),
    "shot noise": rendered(contrast_to_noise=0.0, full_well=3000.0),
    "binary": rendered(sampling="binary", blur_px=0.0, contrast_to_noise=0.0),
    "gamma 2.2": rendered(gamma=2.2),
    "tone curve": processed(toned),
    "sharpened 1 x 1 px": processed(sharpened(1.0, 1.0)),
    "sharpened .5 x 3 px": processed(sharpened(0.5, 3.0)),
    "JPEG 95": processed(jpeg(95)),
    "JPEG 75": processed(jpeg(75)),
    "median 3 x 3": processed(lambda image: np.asarray(cv2.medianBlur(image, 3), dtype=np.uint8)),
    "bilateral": processed(lambda image: np.asarray(cv2.bilateralFilter(image, 5, 25, 2), dtype=np.uint8)),
    "smoothed 1 px": processed(lambda image: np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), dtype=np.uint8)),
    "nearest, .7": resampled(0.7, cv2.INTER_NEAREST),
    "bilinear, .7": resampled(0.7, cv2.INTER_LINEAR),
    "bicubic, .7": resampled(0.7, cv2.INTER_CUBIC),
    "bicubic, 1.5": resampled(1.5, cv2.INTER_CUBIC),
    "texture of 20 texels": texture(20.0),
    "texture of 33 texels": texture(33.0),
    "texture of 45 texels": texture(45.0),
    "defocus, thin lens": defocused(4.0, 300.0),
    "motion 3 px": moved(3.0),
    "directed light": rendered(light_gradient=0.8, glare=0.6, shading=0.8),
    "clipped whites": rendered(white=1.2),
    "clipped whites and blacks": rendered(white=1.15, black=-0.1),
}


def board() -> TargetGeometry:
    """Ten by seven rings on 10 mm, their radii about fifteen pixels."""
    return lay_out(BoardSpec((110.0, 80.0), 1.0, 10, 7, "square", 6.6, 0.45, 10.0, 0.0, 1.0, dots=True))


def poses(rng: np.random.Generator) -> list[Array]:
    """Where the camera stands: tilted to all sides, near and far, rolled."""
    found = []
    for n in range(PHOTOS):
        tilt, side = MOST_TILT * math.sqrt((n + 0.5) / PHOTOS), rng.uniform(0, 2 * math.pi)
        direction = np.array([math.sin(tilt) * math.cos(side), math.sin(tilt) * math.sin(side), math.cos(tilt)])
        found.append(
            look_at(rng, direction, DISTANCE_MM * rng.uniform(0.9, 1.35), np.append(rng.uniform(-20, 20, 2), 0))
        )
    return found


@dataclass(frozen=True, eq=False)
class Outcome:
    """The errors of one calibration."""

    error_px: Array  # (N, 2)
    cov_px2: Array  # (N, 2, 2)
    expected: int
    camera_chi2: float  # per degree of freedom
    image: float  # error over stated, root mean square over the image
    focal: float  # error over stated
    said: tuple[str, ...]


def outcome(take: Take, seed: int) -> Outcome:
    """Take, detect and solve one set."""
    rng = np.random.default_rng(seed)
    target, camera = board(), pinhole(*SIZE, FOCAL_PX)
    seen: list[Detections] = []
    error, cov, expected, said = [], [], 0, []
    for n, pose in enumerate(poses(rng)):
        photo = take(Shot(target, camera, pose, rng))
        found = detect(photo.image, target, name=f"{n}.png")
        off = found.center_px - photo.center_px[found.ring]
        seen.append(found)
        error.append(off)
        cov.append(found.cov_px2)
        inside = (photo.center_px > MARGIN_PX) & (photo.center_px < np.array(SIZE) - MARGIN_PX)
        expected += int(inside.all(axis=1).sum())
        said += list(found.remarks)
    observations = observations_from_detections(seen, target)
    solved = calibrate(observations, "opencv", SolveOptions(weighted=True))
    chi2, image, focal = camera_errors(solved, camera)
    return Outcome(np.concatenate(error), np.concatenate(cov), expected, chi2, image, focal, tuple(said))


def camera_errors(solved: Calibration, true: Camera) -> tuple[float, float, float]:
    """Squared errors of the parameters per degree of freedom; errors of image and focal length in stated ones."""
    off, covariance = solved.camera.params - true.params, solved.param_covariance
    pixel = image_grid(true.image_size, 12, 9).reshape(-1, 2)
    change = projected_change(solved.camera, pixel)
    moved_px = change @ off
    stated = np.einsum("nip,pq,niq->n", change, covariance, change)
    chi2 = float(off @ np.linalg.solve(covariance, off)) / len(off)
    image = math.sqrt(float((moved_px**2).sum(axis=1).mean() / stated.mean()))
    return chi2, image, float(off[0] / math.sqrt(covariance[0, 0]))


def report(name: str, take: Take, sets: int, seed: int) -> None:
    """One line of the table."""
    outcomes = [outcome(take, seed + n) for n in range(sets)]
    error, cov = np.concatenate([o.error_px for o in outcomes]), np.concatenate([o.cov_px2 for o in outcomes])
    square = np.einsum("ni,nij,nj->n", error, np.linalg.inv(cov), error)
    true_px = math.sqrt(float((error**2).mean()))
    ratio = true_px / math.sqrt(float(np.trace(cov, axis1=1, axis2=2).mean() / 2))
    bias = float(np.abs(error.mean(axis=0)).max())
    said = Counter(text for o in outcomes for text in o.said)
    print(
        f"{name:26s} {len(error):5d}/{sum(o.expected for o in outcomes):<5d} {true_px:.4f} {ratio:5.2f} "
        f"{bias:8.4f} {square.mean() / 2:7.2f} {np.median(square) / 1.386:5.2f}"
        f"  {np.mean([o.camera_chi2 for o in outcomes]):7.2f}"
        f" {math.sqrt(np.mean([o.image**2 for o in outcomes])):6.2f} "
        f"{np.mean([o.focal for o in outcomes]):+6.2f}  "
        + "; ".join(f"{count} x {text}" for text, count in said.items()),
        flush=True,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", nargs="*", default=[""])
    arguments = parser.parse_args()
    print("case                             rings   true ratio     bias    chi2   med   camera  image  focal  said")
    for name, take in CASES.items():
        if any(part in name for part in arguments.only):
            report(name, take, arguments.sets, arguments.seed)


if __name__ == "__main__":
    main()
