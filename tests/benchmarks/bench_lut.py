"""How accurate, large and quick is a table of rays, in C++ and JavaScript, beside OpenCV's functions?

Run from the repository's root: `python -m tests.benchmarks.bench_lut`. Ten million places all over the image of each
camera, on one core, in processor time; the sums are printed so that nothing is optimised away. The peers are
`cv2.undistortPoints` and `cv2.fisheye.undistortPoints` to 1e-9, `cv2.projectPoints` and `cv2.fisheye.projectPoints`,
all of them at once, and lensboy's table, if it is installed.
"""

import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

import calib
from calib.cameras.camera import Camera
from calib.cameras.formats import lut
from tests.support.programs import run

CPP = """
#include <cstdio>
#include <ctime>
#include "ringsolid_lut.h"
int main(int, char** words) {
  ringsolid::Lut lut; std::string error;
  if (!lut.read(words[1], error)) return 1;
  const int count = 10000000; double sum = 0, ray[3], pixel[2];
  std::vector<double> rays(3 * count);
  auto since = [](std::clock_t begin) { return double(std::clock() - begin) / CLOCKS_PER_SEC; };
  std::clock_t begin = std::clock();
  for (int k = 0; k < count; ++k) {
    lut.unproject(k * 0.61803398875 * lut.width() - lut.width() * static_cast<long>(k * 0.61803398875),
                  k * 0.41421356237 * lut.height() - lut.height() * static_cast<long>(k * 0.41421356237), &rays[3 * k]);
    sum += rays[3 * k];
  }
  const double there = since(begin); begin = std::clock();
  for (int k = 0; k < count; ++k) if (lut.project(&rays[3 * k], pixel)) sum += pixel[0];
  std::printf("%.1f %.1f %g\\n", there / count * 1e9, since(begin) / count * 1e9, sum);
}
"""
JS = """
import {readFileSync} from "node:fs";
import {readLut} from "./ringsolid_lut.mjs";
const lut = readLut(readFileSync(process.argv[2])), count = 1e6, rays = [];
const now = () => process.cpuUsage().user / 1e3;
let sum = 0, begin = now();
const {width, height} = lut;
for (let k = 0; k < count; k++) rays.push(lut.unproject((k * 0.618) % 1 * (width - 1), (k * 0.414) % 1 * (height - 1)));
const there = now() - begin;
begin = now();
for (const ray of rays) sum += ray ? (lut.project(ray) ?? [0])[0] : 0;
console.log((there / count * 1e6).toFixed(0), ((now() - begin) / count * 1e6).toFixed(0), sum);
"""


def main() -> None:
    """Print a line a camera."""
    brown = Camera("opencv", np.array([1300.0, 1301, 960, 540, -0.3, 0.1, 0.0006, -0.0004, -0.012]), (1920, 1080))
    fisheye = Camera("fisheye", np.array([620.0, 621, 958, 541, -0.01, 0.004, -0.006, 0.0012]), (1920, 1080))
    splined = calib.load_camera("templates/cameras/phase-one-spline.toml")
    print("                          worst px  file kB  ns a ray: C++  JavaScript  OpenCV  ns a pixel: C++  JS  OpenCV")
    print(f"lensboy's table of the brown camera, cells of 32 px: {_lensboy(brown)}")
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for name, camera in {"brown": brown, "fisheye": fisheye, "splined, 100 megapixels": splined}.items():
            begin = time.process_time()
            table = lut.ray_table(camera, lut.TABLE_PX)
            seconds = time.process_time() - begin
            calib.convert(camera, "lut").save(folder / "c.lut")
            (folder / "bench.cc").write_text(CPP)
            (folder / "bench.mjs").write_text(JS)
            run("g++", "-std=c++17", "-O2", folder / "bench.cc", "-o", folder / "bench")
            in_cpp = run(folder / "bench", folder / "c.lut").stdout.split()
            in_js = run("node", folder / "bench.mjs", folder / "c.lut").stdout.split()
            of_opencv = _opencv(camera) if name in ("brown", "fisheye") else ("-", "-")
            size = (folder / "c.lut").stat().st_size / 1000
            print(f"{name:24} {table.max_px:9.5f} {size:9.0f} {in_cpp[0]:>15} {in_js[0]:>11} {of_opencv[0]:>8}"
                  f" {in_cpp[1]:>16} {in_js[1]:>4} {of_opencv[1]:>7}   made in {seconds:.2f} s")  # fmt: skip


def _lensboy(camera: Camera) -> str:
    """How far off and how large is the table that is most like ours."""
    try:
        import lensboy
    except ImportError:
        return "not installed (pip install lensboy)"
    model = lensboy.OpenCV(*camera.image_size, *camera.params[:4], camera.distortion)
    table = lensboy.UnprojectLUT.from_camera_model(model, pixel_stride=32)
    pixel = np.random.default_rng(0).uniform(0, np.array(camera.image_size) - 1, (10**5, 2))
    off = np.linalg.norm(camera.project(table.normalize_points(pixel)[0]) - pixel, axis=1)
    return f"{np.nanmax(off):.3f} px, {table.xy_grid.nbytes / 1000:.0f} kB"


def _opencv(camera: Camera) -> tuple[str, str]:
    """Nanoseconds a point of both ways."""
    pixel = np.random.default_rng(0).uniform((0, 0), camera.image_size, (10**6, 1, 2))
    ray = camera.rays(pixel[:, 0])
    ahead = np.ascontiguousarray(ray[ray[:, 2] > 0.05])[:, None]
    is_wide = camera.model == "fisheye"
    room, zero = cv2.fisheye if is_wide else cv2, np.zeros(3)
    end = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-9)
    lens = camera.distortion
    undistort = room.undistortPoints if is_wide else cv2.undistortPoints
    there = lambda: undistort(pixel, camera.matrix, lens, criteria=end)  # noqa: E731
    back = _nanoseconds(lambda: room.projectPoints(ahead, zero, zero, camera.matrix, lens), len(ahead))
    return f"{_nanoseconds(there, len(pixel)):.0f}", f"{back:.0f}"


def _nanoseconds(work: Callable[[], object], count: int) -> float:
    """Processor time a point, the best of three."""
    cv2.setNumThreads(1)
    times = []
    for _ in range(3):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return min(times) / count * 1e9


if __name__ == "__main__":
    main()
