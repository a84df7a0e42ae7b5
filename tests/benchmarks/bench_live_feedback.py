"""How long a person waits for the page of `calib live`: for a look at a frame, and for what follows from a photo.

`python -m tests.benchmarks.bench_live_feedback [--photos N]`

A whole session with the real server, and a WebSocket in the page's place, which sends frames of 1280 x 720 as the page
does and takes a photo by hand of each. Told are milliseconds from when a frame is sent until its look is there, from
the key until the page knows that the photo is written (it flashes and sounds then), and until the new map, bars and
ghost are there; a browser paints them a sixtieth of a second later. The goal is less than 300 ms.
"""

import argparse
import json
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from websockets.sync.client import ClientConnection, connect

import calib
from calib.capture.messages import FrameHeader, with_header
from calib.renderer import RenderOptions, render_view
from calib.renderer.scene import scene_from_target
from designer.target import TargetGeometry
from tests.benchmarks.synthetic import target_of
from tests.support.guided_scenes import WEBCAM
from tests.support.ring_views import board
from tests.support.verdict_cases import all_over

TARGETS = {"board, 256 rings": board(columns=16, rows=16), "ico, 720 rings": target_of("ico 100 mm")}
OPTIONS = RenderOptions(blur_px=0.6, contrast_to_noise=50)
PARTS = ("look", "photo written", "new guidance")


def photos_of(target: TargetGeometry, count: int) -> list[NDArray[np.uint8]]:
    """What the camera sees."""
    rng, scene = np.random.default_rng(0), scene_from_target(target)
    poses = all_over(count, rng, distance_mm=330.0)
    return [np.asarray(render_view(scene, WEBCAM, pose, OPTIONS, rng).image, dtype=np.uint8) for pose in poses]


def waited_for(page: ClientConnection, kind: str) -> float:
    """The time at which a message of a kind came."""
    while True:
        data = page.recv(timeout=120)
        if isinstance(data, str) and json.loads(data)["kind"] == kind:
            return time.perf_counter()


def taken_by(page: ClientConnection, images: list[NDArray[np.uint8]]) -> list[tuple[float, float, float]]:
    """Milliseconds of `PARTS`, for each photo."""
    waits = []
    page.send('{"kind": "by_hand"}')
    for number, image in enumerate(images):
        header = FrameHeader(0, number, 0.1 * number, image.shape[1], image.shape[0])
        begin = time.perf_counter()
        page.send(with_header(header, image.tobytes()))
        look = waited_for(page, "look") - begin
        begin = time.perf_counter()
        page.send('{"kind": "take"}')
        written = waited_for(page, "taken") - begin
        waits.append((1e3 * look, 1e3 * written, 1e3 * (waited_for(page, "guidance") - begin)))
    page.send('{"kind": "finish"}')
    while '"phase": "done"' not in (data := page.recv(timeout=600)) and '"phase": "failed"' not in str(data):
        pass
    page.send('{"kind": "bye"}')
    return waits


def session(target: TargetGeometry, images: list[NDArray[np.uint8]]) -> list[tuple[float, float, float]]:
    """All photos."""
    waits: list[tuple[float, float, float]] = []

    def be_page(address: str) -> None:
        where = address.removeprefix("http://").split("/")[0]
        with connect(f"ws{address[4:]}socket", origin=f"http://{where}", max_size=None) as page:
            waits.extend(taken_by(page, images))

    with tempfile.TemporaryDirectory() as folder:
        calib.live(
            target, Path(folder) / "live", made="exact", model="opencv",
            opened=lambda address: threading.Thread(target=be_page, args=(address,), daemon=True).start(),
        )  # fmt: skip
    return waits


def main() -> None:
    """Print a line a target."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--photos", type=int, default=30)
    count = parser.parse_args().photos
    for name, target in TARGETS.items():
        images = photos_of(target, count)
        session(target, images[:3])  # what compiles does so here
        waits = np.array(session(target, images))
        for part, column in zip(PARTS, waits.T, strict=True):
            low, most = np.percentile(column, (50, 95))
            last = float(np.median(column[-5:]))
            print(
                f"{name:24} {part:14} median {low:4.0f}, 95 % {most:4.0f}, after {count} photos {last:4.0f} ms",
                flush=True,
            )


if __name__ == "__main__":
    main()
