"""What everyday commands cost beside `import numba`: processor time, modules, memory, and the ten dearest imports.

`python -m tests.benchmarks.bench_startup [--rows detect,solve] [--runs N] [--folder DIR]`. Each command runs in turns
with `python -c 'import numba'`, once uncounted, which compiles; told are the least processor times (user and system),
their difference and ratio, and the peak of memory. Modules, and what each takes by itself, come from `-X importtime`,
which counts the wall clock and slows all alike: what counts there is the order.

The photo is of 5 megapixels, a board; the observations are 20 views of it. `--folder` keeps them for the next time.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tests.benchmarks.synthetic import row

DEAREST = 10
MEASURED = """
import os, sys
child = os.posix_spawn(sys.argv[1], sys.argv[1:], os.environ, file_actions=[(os.POSIX_SPAWN_DUP2, 2, 1)])
_, status, usage = os.wait4(child, 0)
if os.waitstatus_to_exitcode(status) not in (0, 1):
    sys.exit(1)
print(usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024)
"""
"""Run by a small process: to a child's peak of memory counts what its parent had when it was born."""
BARE = ("-c", "import numba")
TARGET, PHOTOS, CAMERA, SEEN = "b/b.target.json", "photos", "machine-vision", "seen.csv"
LINES = {
    "detect": f"detect {TARGET} {PHOTOS}/view_0000.png -o one.csv",
    "solve": f"solve {SEEN} --target {TARGET} --model opencv --no-page -o solved",
    "convert": "convert solved/camera.json --to opencv -o camera.yaml",
    "pose": f"pose {TARGET} {CAMERA} {PHOTOS}/view_0000.png -o poses.json",
    "triangulate": "triangulate rig.json points.csv -o places.csv",
    "help": "detect --help",
}
GOALS_S = {"detect": 0.6, "solve": 0.35, "convert": 0.2}
GOAL_MB = {"detect": 220}


@dataclass(frozen=True)
class Cost:
    """Of a process."""

    processor_s: float
    peak_mb: float


def cost_of(arguments: Sequence[str]) -> Cost:
    """Run Python once; one that ends badly stops the benchmark."""
    run = subprocess.run(
        [sys.executable, "-c", MEASURED, sys.executable, *arguments], capture_output=True, text=True, check=False
    )
    *_, last = run.stdout.splitlines() or [""]
    if run.returncode or not last:
        raise RuntimeError(f"{' '.join(arguments)}: {run.stderr}")
    return Cost(*map(float, last.split()))


def imports_of(arguments: Sequence[str]) -> list[tuple[int, str]]:
    """Microseconds and name of each module, the dearest first."""
    run = subprocess.run([sys.executable, "-X", "importtime", *arguments], capture_output=True, text=True, check=False)
    return sorted(
        ((int(found[1]), found[2]) for found in re.finditer(r"import time: +(\d+) \| +\d+ \| +(\S+)", run.stderr)),
        reverse=True,
    )


def make_inputs() -> None:
    """What the commands take, in the current folder; what is there is used again."""
    if Path("points.csv").exists():
        return

    def command(package: str, line: str) -> None:
        cost_of(("-m", f"{package}.cli", *line.split()))

    command("designer", "board --size 200x160mm --pitch 8mm --formats png -o b")
    command("calib", f"render {next(Path('b').glob('*.target.json'))} --camera {CAMERA} --views 20 -o {PHOTOS}")
    next(Path("b").glob("*.target.json")).rename(TARGET)
    command("calib", f"detect {TARGET} {PHOTOS} -o {SEEN}")
    command("calib", LINES["solve"])

    from calib.cameras.camera import load_camera
    from calib.cameras.rig import Rig

    camera, cam_from_rig = load_camera(Path("solved/camera.json")), np.tile(np.eye(4), (2, 1, 1))
    cam_from_rig[1, 0, 3] = -100.0
    rig = Rig(("left", "right"), (camera, camera), cam_from_rig)
    rig.save("rig.json")
    point_mm = np.random.default_rng(1).uniform((-50, -50, 750), (50, 50, 850), (50, 3))
    lines = [
        f"{name},a,{number},{u},{v},0.1"
        for name, pose in zip(rig.names, cam_from_rig, strict=True)
        for number, (u, v) in enumerate(camera.project(point_mm + pose[:3, 3]).tolist())
    ]
    Path("points.csv").write_text("\n".join(["camera,frame,point,u,v,sigma_px", *lines, ""]))


def measure(name: str, runs: int) -> None:
    """A command's rows."""
    arguments = ("-m", "calib.cli", *LINES[name].split())
    cost_of(arguments)
    both = [(cost_of(BARE), cost_of(arguments)) for _ in range(runs)]
    bare_s, own_s = (min(one.processor_s for one in each) for each in zip(*both, strict=True))
    peak_mb = max(one.peak_mb for _, one in both)
    found = imports_of(arguments)
    goal = f"<= {GOALS_S[name]} s" if name in GOALS_S else ""
    row(f"calib {name}, more than import numba", goal, f"{own_s - bare_s:.2f} s", f"x {own_s / bare_s:.1f}")
    row("  peak memory", f"<= {GOAL_MB[name]} MB" if name in GOAL_MB else "", f"{peak_mb:.0f} MB")
    row("  modules", "", f"{len(found)}", f"ours {sum(word.startswith(('calib', 'designer')) for _, word in found)}")
    row("  dearest, in ms", "", ", ".join(f"{word} {taken / 1e3:.0f}" for taken, word in found[:DEAREST]))


def main() -> None:
    """Measure the commands that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rows", default=",".join(LINES), help=f"of {', '.join(LINES)} (default: all)")
    parser.add_argument("--runs", type=int, default=5, help="how often each is timed (default 5)")
    parser.add_argument("--folder", type=Path, help="where inputs are kept (default: a temporary one)")
    asked = parser.parse_args()
    os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (os.getcwd(), os.environ.get("PYTHONPATH"))))
    with tempfile.TemporaryDirectory() as scratch:
        folder = asked.folder or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        os.chdir(folder)
        make_inputs()
        for name in asked.rows.split(","):
            measure(name, asked.runs)
        os.chdir("/")


if __name__ == "__main__":
    main()
