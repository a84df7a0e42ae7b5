"""Seconds a view and rays a second of the renderer, against a brute-force supersampler in the same run.

The figure is for 200 views of 2448 x 2048 px with area sampling. The peer traces 24 x 24 rays in every pixel with
the same compiled kernel and takes their mean, which leaves up to half a ray's row, 1/48, of error where an edge runs
along the rows. Since it is slow, it renders the middle of a few views only, and both are timed there.
Run: python tests/benchmarks/bench_render.py [VIEWS]
"""

import sys
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calib.cameras.camera import Camera, camera_or_preset
from calib.renderer import RenderOptions, render_view
from calib.renderer.poses import PoseGrid, grid_poses
from designer.base.arrays import Array
from designer.kinds.layout import lay_out
from designer.kinds.sizing import size_job
from designer.target import TargetGeometry
from tests.support.designs import asked_for

SAMPLES = 24
CROP = (408, 340)  # px: a sixth of the width and of the height
PEER_VIEWS = 3
AREA, BINARY = RenderOptions(), RenderOptions(sampling="binary")
ALL_EFFECTS = RenderOptions(
    shading=0.4, glare=0.6, light_gradient=0.3, vignetting=0.3, contrast_to_noise=50.0, full_well=10_000.0,
    clutter=40, occlusion=0.15,
)  # fmt: skip


def poses_of(target: TargetGeometry, views: int) -> Array:
    """Views from 400 mm: all around an icosahedron, within 60 degrees of a board's normal."""
    half_angle = np.pi / 3 if target.face_count == 1 else np.pi
    return grid_poses(PoseGrid(views, half_angle, (400.0, 400.0), True, 0.0), np.random.default_rng(0))


def seconds(action: Callable[[int], object], count: int) -> float:
    """Mean duration of an action, called with its number."""
    start = time.perf_counter()
    for number in range(count):
        action(number)
    return (time.perf_counter() - start) / count


def middle_of(camera: Camera, factor: int) -> Camera:
    """The middle of the image as a camera of its own, with `factor` times as many pixels along each side."""
    width, height = camera.image_size
    params = camera.params.copy()
    params[2:4] -= [(width - CROP[0]) / 2, (height - CROP[1]) / 2]
    params[:2] *= factor
    params[2:4] = factor * (params[2:4] + 0.5) - 0.5
    return Camera(camera.model, params, (CROP[0] * factor, CROP[1] * factor))


def supersampled(target: TargetGeometry, camera: Camera, pose: Array) -> Array:
    """The middle of a view from 24 x 24 rays a pixel."""
    fine = middle_of(camera, SAMPLES)
    image = render_view(target, fine, pose, replace(BINARY, bits=32), np.random.default_rng(0)).image
    return image.reshape(CROP[1], SAMPLES, CROP[0], SAMPLES).mean(axis=(1, 3), dtype=np.float64)


def bench(name: str, target: TargetGeometry, views: int) -> None:
    """Print the figures of one target."""
    camera = camera_or_preset("machine-vision")
    width, height = camera.image_size
    poses = poses_of(target, views)
    for label, options in (("area", AREA), ("area, all effects but blur", ALL_EFFECTS), ("binary", BINARY)):

        def render(number: int, options: RenderOptions = options) -> object:
            return render_view(target, camera, poses[number], options, np.random.default_rng([0, number]))

        render(0)
        each = seconds(render, views)
        rate = width * height / each / 1e6
        print(f"{name:12} {label:28} {views:4d} views  {each:6.3f} s a view  {rate:6.1f} M pixels/s")
    crop = middle_of(camera, 1)
    plain = replace(AREA, black=0.0, white=1.0, background=0.0, bits=32)

    def ours(number: int) -> Array:
        return render_view(target, crop, poses[number], plain, np.random.default_rng(0)).image.astype(np.float64)

    def peer(number: int) -> Array:
        return supersampled(target, camera, poses[number])

    ours(0)
    fast, slow = seconds(lambda n: ours(n % PEER_VIEWS), 30), seconds(peer, PEER_VIEWS)
    rays = CROP[0] * CROP[1] * SAMPLES**2 / slow / 1e6
    off = max(float(np.abs(ours(n) - peer(n)).max()) for n in range(PEER_VIEWS))
    print(
        f"{name:12} middle {CROP[0]} x {CROP[1]} px: ours {1e3 * fast:.1f} ms, {SAMPLES} x {SAMPLES} rays a pixel "
        f"{1e3 * slow:.0f} ms ({rays:.0f} M rays/s): {slow / fast:.0f} x; largest difference {off:.4f} of the contrast"
    )


def main() -> None:
    """Run all."""
    views = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    ico = lay_out(size_job(asked_for("ico", {"edge": "100mm"})).job.target)
    board = lay_out(size_job(asked_for("board", {"size": "220x220mm"})).job.target)
    bench("ico 100mm", ico, views)
    bench("board 220mm", board, views)


if __name__ == "__main__":
    main()
