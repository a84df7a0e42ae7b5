"""How long everyday work takes: a photo, a run, a solution, a design, a what-if; each beside its peer in the same run.

Run from the repository's root: `python -m tests.benchmarks.bench_everyday [--rows detect,solve] [--runs N]
[--folder DIR] [--accept]`. After one run that is not counted (it compiles), the median of five: of the wall clock, and
of the processor's seconds (user and system, of all threads and processes). Whole commands run as a user runs them; the
detector, the solver and their peers on one core, in turns, so that a busy machine slows all alike.

So that no figure slips back unseen, `everyday_accepted.json` beside this file keeps what each row took when it was
last accepted: its processor's seconds over those of its peer in the same run, which another machine, or a busy one,
hardly changes. What takes more than a tenth longer than that is told at the end, and the exit code is 1; `--accept`
keeps the ratios of this run instead. Whole commands have `python -c 'import numba'` as that peer.

The photos are rendered: an icosahedron of 100 mm edge, 5 megapixels. Peers: `cv2.aruco.CharucoDetector` with corner
refinement on a board of 256 corners, 5 megapixels and 1280 x 720; `cv2.calibrateCamera`; the same solid made by
build123d, where that is installed; OpenCV's bare threshold and contours of a photo of 100 megapixels. `--folder` keeps
the rendered photos for the next time.
"""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import count
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.synthetic import Array, eight_bit, plane_view, row

MODULE = "tests.benchmarks.bench_everyday"
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS"), "1")
ACCEPTED_FILE = Path(__file__).with_name("everyday_accepted.json")
WORSE = 0.10
ROUNDING = 0.03
"""Of the peer: 10 ms, which the shortest commands differ by from run to run."""
IMPORT = "import numba"
"""The peer of whole commands: a process that loads a compiler, and does nothing."""
AS_INSTALLED = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
"""Where modules are compiled again and again, commands take a tenth longer than a user's."""
EDGE, NAME = "100mm", "ico-100mm"
PHOTOS = ("--views", "12", "--distance", "260mm..360mm", "--aim-offset", "40mm", "--random-roll", "--blur", "0.7px")
CONTRAST_TO_NOISE = 50.0
SQUARES, SQUARE_MM, MARKER_MM, TILT_RAD, BLUR_PX = 17, 10.0, 7.5, 0.35, 0.7
CORNERS = (SQUARES - 1) ** 2
FIVE_MEGAPIXELS, SMALLER, HD = (2448, 2048), (1224, 1024), (1280, 720)

Grey = NDArray[np.uint8]


@dataclass(frozen=True)
class Times:
    """Medians, in seconds."""

    wall: float
    processor: float


@dataclass(frozen=True)
class Setting:
    """What the rows share."""

    folder: Path
    runs: int
    ratios: Path  # a line a row that was measured, from this process and from those on one core

    def note(self, what: str, times: Times, peer: Times) -> None:
        """Keep what a row took over what its peer did."""
        with self.ratios.open("a") as file:
            file.write(json.dumps([what, round(times.processor / peer.processor, 3)]) + "\n")

    def whole(self, works: Mapping[str, Callable[[], object]]) -> dict[str, Times]:
        """Medians of whole commands, noted beside the peer of all of them."""

        def numba() -> object:
            return subprocess.run([sys.executable, "-c", IMPORT], check=True, env=AS_INSTALLED)

        times = in_turns({**works, IMPORT: numba}, self.runs)
        for name in works:
            self.note(name, times[name], times[IMPORT])
        return times


@dataclass(frozen=True)
class Row:
    """A row of the table, or a few that belong together."""

    measure: Callable[[Setting], None]
    on_one_core: bool


def used() -> tuple[float, float]:
    """The wall clock, and the processor's seconds of this process and of those it has waited for."""
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return time.perf_counter(), sum(one.ru_utime + one.ru_stime for one in usage)


def in_turns(works: Mapping[str, Callable[[], object]], runs: int) -> dict[str, Times]:
    """Medians of each work, after one run that is not counted."""
    taken: dict[str, list[tuple[float, float]]] = {name: [] for name in works}
    for _ in range(runs + 1):
        for name, work in works.items():
            wall, processor = used()
            work()
            wall_after, processor_after = used()
            taken[name].append((wall_after - wall, processor_after - processor))
    return {
        name: Times(*(statistics.median(one[part] for one in all_runs[1:]) for part in (0, 1)))
        for name, all_runs in taken.items()
    }


def tell(what: str, goal: str, times: Times, against: str = "") -> None:
    """A line of the table."""
    row(what, goal, f"{times.wall:.3f} s", f"processor {times.processor:.3f} s{'; ' if against else ''}{against}")


def command(program: str, *arguments: object, code: int = 0) -> None:
    """Run `design` or `calib` as a user does; an icosahedron's what-if may miss its limit, which is exit code 1."""
    package = {"design": "designer", "calib": "calib"}[program]
    run = subprocess.run(
        [sys.executable, "-m", f"{package}.cli", *map(str, arguments)],
        capture_output=True, text=True, check=False, env=AS_INSTALLED,
    )  # fmt: skip
    if run.returncode not in (0, code):
        raise RuntimeError(f"{program} {' '.join(map(str, arguments))}: {run.stderr}")


def target_file(setting: Setting) -> Path:
    """The icosahedron, made if it is not there."""
    path = setting.folder / NAME / f"{NAME}.target.json"
    if not path.exists():
        command("design", "ico", "--edge", EDGE, "-o", path.parent)
    return path


def photo_folder(setting: Setting) -> Path:
    """The rendered photos; a set that is there is gone on with."""
    folder = setting.folder / "photos"
    command("calib", "render", target_file(setting), "-o", folder, *PHOTOS, "--contrast-to-noise", CONTRAST_TO_NOISE)
    return folder


def charuco(size: tuple[int, int]) -> Grey:
    """A photo of a ChArUco board that fills its height, tilted, blurred and noisy as the others."""
    board, scale = charuco_board(), 100
    plain = board.generateImage((SQUARES * scale, SQUARES * scale)).astype(np.float32) / 255
    plane_mm = np.diag([SQUARE_MM / scale, SQUARE_MM / scale, 1.0])
    plane_mm[:2, 2] = -SQUARES * SQUARE_MM / 2
    focal_px, side_mm = 1.2 * size[0], SQUARES * SQUARE_MM
    view = plane_view(focal_px, TILT_RAD, 0.6, 1.1 * side_mm * focal_px / size[1], (np.array(size) - 1) / 2)
    seen = cv2.warpPerspective(
        plain, view @ plane_mm, size, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_CONSTANT, borderValue=1.0
    )
    blurred: Array = 0.1 + 0.7 * cv2.GaussianBlur(seen, (0, 0), BLUR_PX)
    return eight_bit(blurred, 255 * 0.7 / CONTRAST_TO_NOISE, np.random.default_rng(0))


@cache
def charuco_board() -> cv2.aruco.CharucoBoard:
    """17 x 17 squares: 16 x 16 inner corners."""
    markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
    return cv2.aruco.CharucoBoard((SQUARES, SQUARES), SQUARE_MM, MARKER_MM, markers)


def charuco_corners(image: Grey) -> int:
    """How many corners OpenCV finds, each refined."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.CharucoDetector(charuco_board(), cv2.aruco.CharucoParameters(), parameters)
    corners = detector.detectBoard(image)[0]
    return 0 if corners is None else len(corners)


def detection(setting: Setting) -> None:
    """The detector on one photo, against ChArUco with as many points."""
    from calib.detector.pipeline import detect
    from designer.target import load_target

    target = load_target(target_file(setting))
    photos = [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in sorted(photo_folder(setting).glob("view_*.png"))]
    large = max(photos, key=lambda photo: len(detect(photo, target, name="").ring))
    small = cv2.resize(large, SMALLER, interpolation=cv2.INTER_AREA)
    boards = {"ChArUco": charuco(FIVE_MEGAPIXELS), "ChArUco, 1280 x 720": charuco(HD)}
    ours = {"5 megapixels": np.asarray(large), "1224 x 1024": np.asarray(small)}
    times = in_turns(
        {
            **{name: lambda image=image: detect(image, target, name="") for name, image in ours.items()},
            **{name: lambda image=image: charuco_corners(image) for name, image in boards.items()},
        },
        setting.runs,
    )
    peer = times["ChArUco"].wall
    for (name, image), goal in zip(ours.items(), ("<= 0.15 s", "<= 0.10 s"), strict=True):
        rings = len(detect(image, target, name="").ring)
        setting.note(f"detect, {name}", times[name], times["ChArUco"])
        tell(f"detect, {name}, {rings} rings", goal, times[name], f"ChArUco x {peer / times[name].wall:.1f}")
    for name, image in boards.items():
        tell(f"  cv2 {name}, {charuco_corners(image)} of {CORNERS} corners", "", times[name])


def solution(setting: Setting) -> None:
    """The solver against cv2.calibrateCamera; OpenCV's rounding of pixels is the scene's."""
    from tests.benchmarks.bench_solve import PITCH_MM, SIDE, grid, opencv, ours, scene

    for views, goal in ((20, ">= x 10"), (120, ">= x 15")):
        seen = scene(grid(SIDE, SIDE, PITCH_MM), views)
        times = in_turns({"ours": lambda: ours(seen, "opencv"), "cv2": lambda: opencv(seen)}, setting.runs)  # noqa: B023
        ratio = times["cv2"].wall / times["ours"].wall
        setting.note(f"solve, {views} views", times["ours"], times["cv2"])
        tell(f"solve, {views} views x {SIDE * SIDE}", goal, times["ours"], f"cv2.calibrateCamera x {ratio:.1f}")
        tell("  cv2.calibrateCamera", "", times["cv2"])


def large_photo(setting: Setting) -> None:
    """A photo of 100 megapixels, against the bare threshold and contours."""
    from calib.detector.pipeline import detect
    from designer.kinds.layout import lay_out
    from tests.benchmarks.bench_large_image import SPEC, bare_pass, picture

    target = lay_out(SPEC)
    image = eight_bit(picture(target, 1.0)[0], 1.0, np.random.default_rng(1))
    times = in_turns(
        {"ours": lambda: detect(image, target, name="large"), "bare": lambda: bare_pass(image)}, setting.runs
    )
    ratio = times["ours"].wall / times["bare"].wall
    setting.note("detect, 100 megapixels", times["ours"], times["bare"])
    tell("detect, 100 megapixels, two cores", "<= 0.45 s", times["ours"], f"{ratio:.1f} x bare Otsu + findContours")
    tell("  bare Otsu + findContours", "", times["bare"])


def one_photo(setting: Setting) -> None:
    """The whole command, without and with the picture of what was found."""
    target, photo = target_file(setting), photo_folder(setting) / "view_0000.png"
    out = setting.folder / "one" / "detections.csv"
    times = setting.whole({
        "calib detect": lambda: command("calib", "detect", target, photo, "-o", out),
        "calib detect --overlay": lambda: command(
            "calib", "detect", target, photo, "-o", out, "--overlay", out.parent / "overlay"
        ),
    })  # fmt: skip
    tell("calib detect of one photo", "<= 1.2 s", times["calib detect"])
    tell("  the same with --overlay", "", times["calib detect --overlay"])
    tell(f"  {IMPORT}", "", times[IMPORT])


def tables(setting: Setting) -> None:
    """A camera from a table of points, and its file for another tool: whole commands without a photo."""
    from tests.benchmarks.bench_solve import PITCH_MM, SIDE, SIZE, grid, scene

    seen, table = scene(grid(SIDE, SIDE, PITCH_MM), 20), setting.folder / "points.csv"
    lines = [
        f"{seen.view_names[view]},{u!r},{v!r},{x!r},{y!r},{z!r}"
        for view, (u, v), (x, y, z) in zip(
            seen.view.tolist(), seen.center_px.tolist(), seen.points.position_mm[seen.point].tolist(), strict=True
        )
    ]
    table.write_text("\n".join([f"# image_size {SIZE[0]} x {SIZE[1]}", "image,u,v,X,Y,Z", *lines, ""]))
    out = setting.folder / "solved"
    times = setting.whole({
        "calib solve": lambda: command("calib", "solve", table, "--model", "opencv", "-o", out, code=1),
        "calib convert": lambda: command(
            "calib", "convert", out / "camera.json", "--to", "opencv", "-o", setting.folder / "converted.yaml"
        ),
    })  # fmt: skip
    tell("calib solve, 20 views", "", times["calib solve"])
    tell("calib convert", "", times["calib convert"])
    tell(f"  {IMPORT}", "", times[IMPORT])


def calibration(setting: Setting) -> None:
    """Twelve photos to the verdict and the page."""
    target, photos = target_file(setting), photo_folder(setting)
    out = setting.folder / "camera"
    times = setting.whole({"calib run": lambda: command("calib", "run", target, photos, "-o", out, code=1)})
    tell("calib run, 12 photos of 5 megapixels", "<= 9 s", times["calib run"])


def design(setting: Setting) -> None:
    """The whole command, and the solid alone by CAD."""
    out = setting.folder / "design"
    times = setting.whole({"design ico": lambda: command("design", "ico", "--edge", EDGE, "-o", out)})
    try:
        from tests.benchmarks.bench_geometry import cad_route

        cad = in_turns({"cad": cad_route}, setting.runs)["cad"]
        peer = f"build123d's solid alone x {cad.wall / times['design ico'].wall:.1f}"
    except ImportError:
        peer = "no build123d here"
    tell(f"design ico --edge {EDGE}", "<= 1.5 s", times["design ico"], peer)


def help_texts(setting: Setting) -> None:
    """What a user waits for first."""
    works: dict[str, Callable[[], object]] = {
        f"{program} --help": lambda program=program: command(program, "--help") for program in ("design", "calib")
    }
    for package in ("designer", "calib"):
        works[f"import {package}"] = lambda package=package: subprocess.run(
            [sys.executable, "-c", f"import {package}"], check=True, env=AS_INSTALLED
        )
    works["python, nothing imported"] = lambda: subprocess.run([sys.executable, "-c", ""], check=True)
    for name, times in setting.whole(works).items():
        goal = "<= 0.05 s" if name.startswith("import ") and name != IMPORT else ""
        tell(name, "<= 0.5 s" if "help" in name else goal, times)


def prediction(setting: Setting) -> None:
    """What a print's errors cost: the whole command, and the prediction alone."""
    from calib.cameras.camera import camera_or_preset
    from calib.studies.tolerance.predict import linear_table
    from calib.studies.tolerance.setting import make_setting
    from designer.kinds.layout import advised_photos
    from designer.target import load_target
    from designer.tolerance.error_file import error_model

    target, errors = target_file(setting), error_model("fdm-dual")
    nominal = load_target(target)
    scene = make_setting(
        nominal, camera_or_preset("machine-vision"), views=90, photos=advised_photos(nominal), model="luhmann", seed=1
    )
    out = setting.folder / "predicted"
    arguments = ("tolerance", target, "--errors", "fdm-dual", "--linear", "-o", out)
    whole, alone = "design tolerance --linear", "linear prediction"
    times = setting.whole({whole: lambda: command("design", *arguments), alone: lambda: linear_table(scene, errors)})
    tell(whole, "<= 3 s", times[whole])
    tell(f"  {alone} itself", "<= 0.3 s", times[alone])


def requirement(setting: Setting) -> None:
    """How good a print must be, by draws."""
    arguments = ("tolerance", target_file(setting), "--errors", "fdm-dual", "--require", "intersection=0.1mm", "-o")
    folders = (setting.folder / f"required-{number}" for number in count())
    whole = "design tolerance --require"
    times = setting.whole({whole: lambda: command("design", *arguments, next(folders), code=1)})
    tell(whole, "<= 60 s", times[whole])


ROWS: Mapping[str, Row] = {
    "detect": Row(detection, on_one_core=True),
    "command": Row(one_photo, on_one_core=False),
    "tables": Row(tables, on_one_core=False),
    "run": Row(calibration, on_one_core=False),
    "solve": Row(solution, on_one_core=True),
    "design": Row(design, on_one_core=False),
    "linear": Row(prediction, on_one_core=False),
    "require": Row(requirement, on_one_core=False),
    "large": Row(large_photo, on_one_core=False),
    "help": Row(help_texts, on_one_core=False),
}


def measure(names: list[str], setting: Setting, *, on_one_core: bool) -> None:
    """All rows asked for; those of one core in a process that is kept on it, and whose libraries start no threads."""
    for name in names:
        if on_one_core or not ROWS[name].on_one_core:
            ROWS[name].measure(setting)
            continue
        arguments = ("--rows", name, "--runs", str(setting.runs), "--folder", str(setting.folder), "--one-core")
        subprocess.run([sys.executable, "-m", MODULE, *arguments], check=True, env={**os.environ, **ONE_THREAD})


def compared(ratios: Path, *, accept: bool) -> int:
    """Tell of rows that take longer than was accepted, or accept what they take; how many are worse."""
    known: dict[str, float] = json.loads(ACCEPTED_FILE.read_text()) if ACCEPTED_FILE.exists() else {}
    new: dict[str, float] = dict(map(json.loads, ratios.read_text().splitlines()))
    if accept:
        ACCEPTED_FILE.write_text(json.dumps(known | new, indent=1) + "\n")
        print(f"accepted: {', '.join(new)}")
        return 0
    worse = {name: ratio for name, ratio in new.items() if ratio > (1 + WORSE) * known.get(name, ratio) + ROUNDING}
    for name, ratio in worse.items():
        print(f"WORSE: {name}: {ratio:.2f} x its peer, accepted were {known[name]:.2f}")
    if unknown := [name for name in new if name not in known]:
        print(f"not accepted yet (--accept): {', '.join(unknown)}")
    return len(worse)


def keep_on_one_core() -> None:
    """This process and its threads on one core, where the system can (Linux)."""
    cv2.setNumThreads(1)
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", default=",".join(ROWS), help=f"of {', '.join(ROWS)} (default: all)")
    parser.add_argument("--runs", type=int, default=5, help="how often each is timed (default 5)")
    parser.add_argument("--folder", type=Path, help="where photos are kept (default: a temporary one)")
    parser.add_argument("--accept", action="store_true", help="keep the ratios to peers as the accepted ones")
    parser.add_argument("--one-core", action="store_true", help="stay on one core, which rows of one core do anyway")
    options = parser.parse_args()
    names = options.rows.split(",")
    if unknown := [name for name in names if name not in ROWS]:
        parser.error(f"no such row: {', '.join(unknown)}; there are {', '.join(ROWS)}")
    if options.one_core:
        keep_on_one_core()
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.folder or Path(scratch)
        setting = Setting(folder, options.runs, folder / "ratios.jsonl")
        if not options.one_core:
            setting.ratios.parent.mkdir(parents=True, exist_ok=True)
            setting.ratios.write_text("")
        measure(names, setting, on_one_core=options.one_core)
        if not options.one_core and compared(setting.ratios, accept=options.accept):
            sys.exit(1)


if __name__ == "__main__":
    main()
