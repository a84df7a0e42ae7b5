"""How long do undistorted photos of a wide lens take, beside cv2.remap, and how far off are edges?

Run from the repository's root: `python -m tests.benchmarks.bench_undistort`. A colour photo of 3072 x 2304 px by a
fisheye of 190 degrees, to each picture without a lens. The peer is what OpenCV does with the same places: `cv2.remap`,
cubic and Lanczos, which gets them for nothing here. Processor seconds, best of three. Edges: a parabola of grey levels
is resampled; what its value is off by, over its slope, is how far an edge would move.
"""

import time
from collections.abc import Callable

import cv2
import numpy as np

import calib
from calib.cameras import pictures
from calib.cameras.undistortion import resample


def main() -> None:
    """Print a line a picture, and the edges."""
    camera = calib.load_camera("templates/cameras/fisheye-190.toml")
    photo = np.random.default_rng(0).integers(0, 255, (*camera.image_size[::-1], 3), np.uint8)
    print("CPU ms a megapixel  all of ours  our places  cv2.remap cubic  Lanczos")
    for to in pictures():
        made = calib.Undistorter(camera, to=to)
        megapixels = np.prod(made.new_camera.image_size) / 1e6
        place = made.source_px.astype(np.float32)
        seconds = [
            _seconds(lambda made=made: made.undistort(photo)),  # type: ignore[misc]
            _seconds(lambda made=made: made.source_px),  # type: ignore[misc]
            *(
                _seconds(lambda place=place, kind=kind: cv2.remap(photo, place[..., 0], place[..., 1], kind))  # type: ignore[misc]
                for kind in (cv2.INTER_CUBIC, cv2.INTER_LANCZOS4)
            ),
        ]
        print(f"{to:18}", *(f"{1e3 * one / megapixels:11.0f}" for one in seconds))
    print("an edge is off by, px:", ", ".join(f"{name} {off:.4f}" for name, off in _edges().items()))


def _seconds(work: Callable[[], object]) -> float:
    """Processor seconds, the best of three after one that compiles."""
    work()
    times = []
    for _ in range(3):
        begin = time.process_time()
        work()
        times.append(time.process_time() - begin)
    return min(times)


def _edges() -> dict[str, float]:
    """The largest error of a resampled parabola over its slope there."""
    u, v = np.meshgrid(np.arange(200.0), np.arange(20.0))
    curve = lambda at: 2000 + 1.5 * at**2  # noqa: E731
    source = np.rint(curve(u)).astype(np.uint16)
    off: dict[str, float] = {}
    for shift in np.linspace(0.01, 0.49, 17):
        place = np.stack([u + shift, v], axis=-1)[5:-5, 100:-20]
        truth, slope = curve(place[..., 0]), 3.0 * place[..., 0]
        ours = np.empty(place.shape[:2], np.uint16)
        resample(source, place, ours)
        single = place.astype(np.float32)
        found = {"ours": ours}
        for name, kind in (("cv2 cubic", cv2.INTER_CUBIC), ("cv2 Lanczos", cv2.INTER_LANCZOS4)):
            found[name] = cv2.remap(source, single[..., 0], single[..., 1], kind).astype(np.uint16)
        for name, picture in found.items():
            error = float((np.abs(picture - truth) / slope).max())
            off[name] = max(off.get(name, 0.0), error)
    return off


if __name__ == "__main__":
    main()
