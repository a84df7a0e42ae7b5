"""Each part of the work on a small example, to list the kernels that it needs in `calib/core/kernels.txt`.

Run from the repository's root, after a kernel, or what calls it, has other types:
`python -m tests.support.kernel_parts`. It takes some minutes, as all is compiled afresh by one process.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from calib.cameras import ABILITIES, solved_models
from calib.core.compile_ahead import ALONE, LIST, parse_line
from calib.core.kernel_store import SUFFIX, read_entry

VIEWS = ("--views", "8", "--distance", "150mm..220mm", "--aim-offset", "30mm", "--random-roll")
LOOKED = ("--blur", "0.7px", "--contrast-to-noise", "50")
BOARD = """
import sys, cv2, numpy
from designer.marks.chessboard import Chessboard
from designer.target import target_of_marks, target_to_json
target, soft, sharp = sys.argv[1:]
open(target, "w").write(target_to_json(target_of_marks([Chessboard((9, 6), 20.0)], numpy.eye(4)[None], 10.0)))
squares = numpy.pad(numpy.kron(numpy.indices((6, 9)).sum(axis=0) % 2, numpy.ones((40, 40))), 40, constant_values=1)
tilted = numpy.array([[1, 0.1, 60], [-0.05, 1.1, 80], [0, 0.0004, 1]])
seen = cv2.warpPerspective(40 + 160 * squares, tilted, (640, 480), borderValue=200)
cv2.imwrite(soft, cv2.GaussianBlur(seen, (0, 0), 0.8))
cv2.imwrite(sharp, numpy.where(seen > 120, 200, 40))
"""
LIVE = """
import sys, cv2, calib
target, folder = sys.argv[1:]
detector, guide = calib.Detector(target), calib.Guide(target)
for n in range(6):
    pixels = cv2.imread(f"{folder}/view_{n:04d}.png")
    guide = guide.with_photo(detector.detect(pixels, f"{n}.png"))
    guide.told
    detector.glance(pixels, likely=guide.camera)
    guide.look(detector.glance(pixels))
"""


def run(program: str, *arguments: object) -> None:
    """Run `design`, `calib` or a few lines of Python; a negative answer is one."""
    start = {"design": ["-m", "designer.cli"], "calib": ["-m", "calib.cli"], "python": ["-c"]}[program]
    done = subprocess.run([sys.executable, *start, *map(str, arguments)], capture_output=True, text=True, check=False)
    if done.returncode not in {0, 1} or "Traceback" in done.stderr:
        raise RuntimeError(f"{program} {' '.join(map(str, arguments))}: {done.stderr}")


class Example:
    """Targets and photos of them, in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.board, self.ico = folder / "board/board.target.json", folder / "ico/ico.target.json"

    def make(self) -> None:
        """What the parts begin with."""
        run("design", "board", "--size", "120x90mm", "-o", self.board.parent, "--name", "board", "--formats", "3mf")
        run("design", "ico", "--edge", "60mm", "-o", self.ico.parent, "--name", "ico", "--formats", "3mf")
        for name, target, camera in (
            ("photos", self.board, "webcam"), ("ico-photos", self.ico, "webcam"), ("wide", self.ico, "fisheye-190"),
        ):  # fmt: skip
            run("calib", "render", target, "-o", self.folder / name, "--camera", camera, *VIEWS, *LOOKED)
        run("calib", "render", self.ico, "-o", self.folder / "rig", "--rig", "stereo-pair", "--frames", "5", *LOOKED)

    def detect(self) -> None:
        """Find rings, with no lens known."""
        run("calib", "detect", self.board, self.folder / "photos", "-o", self.folder / "found.csv", "--jobs", "1")

    def lens(self) -> None:
        """Find rings through a lens that is known, or wide."""
        for name, camera in (("ico-photos", "webcam"), ("wide", "fisheye-190")):
            for known in ((), ("--camera", camera)):
                photos = self.folder / name
                run("calib", "detect", self.ico, photos, "-o", self.folder / f"{name}.csv", "--jobs", "1", *known)

    def solve(self) -> None:
        """Solve and judge."""
        found = self.folder / "found.csv"
        for more in ((), ("--loss", "huber", "--reject", "4"), ("--free-bend",), ("--minimise", "ray")):
            run("calib", "solve", found, "--target", self.board, "-o", self.folder / "solved", "--no-page", *more)

    def run(self) -> None:
        """From photos to a page, of an ordinary lens and a wide one."""
        run("calib", "run", self.board, self.folder / "photos", "-o", self.folder / "camera", "--jobs", "1")
        run("calib", "run", self.ico, self.folder / "wide", "-o", self.folder / "wide-camera", "--jobs", "1")

    def models(self) -> None:
        """Each other camera model."""
        cases = ((self.folder / "found.csv", self.board, solved_models()),)
        cases += (
            (self.folder / "wide.csv", self.ico, tuple(model for model in solved_models() if ABILITIES[model].is_wide)),
        )
        for table, target, models in cases:
            for model in models:
                out = self.folder / f"{model}-{table.stem}"
                run("calib", "solve", table, "--target", target, "-o", out, "--model", model, "--no-page")

    def use(self) -> None:
        """What is done with a camera."""
        camera = self.folder / "camera/luhmann/camera.json"
        photos = self.folder / "photos"
        run("calib", "evaluate", self.folder / "camera/luhmann", "--held-out", "2", "--truth", photos / "truth.json")
        run("calib", "pose", self.board, camera, photos / "view_0001.png", "-o", self.folder / "poses.json")
        run("calib", "undistort", camera, photos / "view_0001.png", "-o", self.folder / "flat")
        run("calib", "diff", camera, self.folder / "camera/opencv/camera.json")
        for form in ("colmap", "opencv", "mrcal"):
            run("calib", "convert", camera, "--to", form, "-o", self.folder / f"to-{form}")

    def rig(self) -> None:
        """Several cameras, and what is measured with them."""
        out = self.folder / "rig-solved"
        run("calib", "rig", self.ico, self.folder / "rig", "-o", out, "--jobs", "1")
        run("calib", "budget", out / "rig.json", "-o", self.folder / "budget")
        run("calib", "turntable", "--table", self.folder / "found.csv", self.board, "-o", self.folder / "turned")

    def render(self) -> None:
        """Photos with known truth."""
        run("calib", "render", self.ico, "-o", self.folder / "again", "--views", "2", *LOOKED, "--jobs", "1")
        more = ("--clutter", "3", "--glare", "20%", "--light-gradient", "10%", "--camera", "fisheye-190")
        run("calib", "render", self.board, "-o", self.folder / "more", "--views", "2", "--jobs", "1", *more)

    def measure(self) -> None:
        """Measure a print."""
        run("calib", "measure", self.board, self.folder / "found.csv", "-o", self.folder / "measured.target.json")
        run("calib", "measure", self.ico, self.folder / "ico-photos.csv", "-o", self.folder / "ico.target.json")

    def tolerance(self) -> None:
        """What errors of a print cost, and how sure a calibration is."""
        for name, more in (("linear", ("--linear",)), ("draws", ("--draws", "4", "--jobs", "1"))):
            out = self.folder / f"tolerance-{name}"
            run("design", "tolerance", self.ico, "--errors", "fdm-dual", "--views", "12", "-o", out, *more)
        taken = ("--target", self.board, "--detections", self.folder / "found.csv", "--sizes", "6", "--samples", "4")
        run("calib", "study", "bootstrap", *taken, "--jobs", "1", "-o", self.folder / "bootstrap")

    def boards(self) -> None:
        """Find and measure other makers' marks, sharp ones too."""
        board, soft, sharp = (self.folder / name for name in ("chess.target.json", "soft.png", "sharp.png"))
        run("python", BOARD, board, soft, sharp)
        run("calib", "detect", board, soft, sharp, "-o", self.folder / "boards.csv", "--jobs", "1")

    def live(self) -> None:
        """Guidance while photos are taken."""
        run("python", LIVE, self.ico, self.folder / "ico-photos")


PARTS: Mapping[str, Callable[[Example], None]] = {
    work.__name__: work
    for work in (
        *(Example.detect, Example.lens, Example.solve, Example.run, Example.models, Example.use, Example.render),
        *(Example.rig, Example.measure, Example.tolerance, Example.live, Example.boards),
    )
}
"""In the order in which a user needs them: a kernel is listed with the first that needs it."""


def kept(folder: Path) -> Iterator[str]:
    """The lines of the entries in a folder, in the order in which they were written."""
    for path in sorted(folder.glob(f"*{SUFFIX}"), key=lambda path: path.stat().st_mtime_ns):
        payload = read_entry(path)
        if payload is not None:
            yield payload.partition(b"\n")[0].decode()


def listed(example: Example, cache: Path) -> str:
    """The list: parts, and what each adds to the kernels of those before."""
    known: set[str] = set()
    text = []
    for part, work in PARTS.items():
        work(example)
        lines = [line for line in kept(cache / "kernels") if line not in known]
        known.update(lines)
        for line in lines:
            _ = parse_line(line).arguments
        text += [f"[{part}]", *lines, ""]
        print(f"{part}: {len(lines)}", flush=True)
    return "\n".join(text)


def main() -> None:
    """Write the list anew."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        example = Example(folder / "example")
        example.make()
        os.environ.update({"RINGSOLID_CACHE": str(folder / "cache"), ALONE: "alone"})
        LIST.write_text(listed(example, folder / "cache"), encoding="utf-8")


if __name__ == "__main__":
    main()
