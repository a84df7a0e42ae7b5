"""How long a user waits for the first `calib detect` of a photo, beside `import numba` in the same run.

Run from the repository's root: `python -m tests.benchmarks.bench_first_minute [--wheel WHEEL]`. From the sources on a
machine that has compiled nothing; the second time; in another clone on the same machine; and, with a wheel that
`python -m build` made, installed on a machine that has compiled nothing. The wall clock and the processor's seconds,
all processes together; of what needs no compiling, the median of five.
"""

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.benchmarks.bench_everyday import Times, command, used
from tests.benchmarks.synthetic import row

ROOT = Path(__file__).parents[2]
PHOTO = ("--views", "1", "--distance", "300mm", "--blur", "0.7px", "--contrast-to-noise", "50")


def timed(code: list[str], environment: dict[str, str], folder: Path, runs: int = 1) -> Times:
    """How long Python takes for such arguments, in a folder that holds none of the sources."""
    taken = []
    for _ in range(runs):
        wall, processor = used()
        subprocess.run([sys.executable, *code], cwd=folder, env=environment, check=True, capture_output=True)
        wall_after, processor_after = used()
        taken.append((wall_after - wall, processor_after - processor))
    return Times(*(statistics.median(one[part] for one in taken) for part in (0, 1)))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--wheel", type=Path, help="that `python -m build` made")
    wheel = parser.parse_args().wheel
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        command("design", "make", "3d-board", "-o", folder / "board")
        target = folder / "board/3d-board.target.json"
        command("calib", "render", target, "-o", folder / "photos", *PHOTO)
        detect = ["-m", "calib.cli", "detect", str(target), str(folder / "photos"), "-o", str(folder / "found.csv")]

        def environment(sources: Path, cache: str) -> dict[str, str]:
            kept = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
            return {**kept, "PYTHONPATH": str(sources), "RINGSOLID_CACHE": str(folder / cache)}

        numba = timed(["-c", "import numba"], environment(ROOT, "cache"), folder, 5)
        row("import numba", "", f"{numba.wall:.2f} s", f"processor {numba.processor:.2f} s")

        def tell(what: str, goal: str, times: Times) -> None:
            more = times.processor - numba.processor
            row(what, goal, f"{times.wall:.2f} s", f"processor {times.processor:.2f} s, numba + {more:.2f} s")

        clone = folder / "clone"
        for package in ("calib", "designer", "templates"):
            shutil.copytree(ROOT / package, clone / package, copy_function=shutil.copyfile)
        tell("from the sources, nothing compiled", "28 s", timed(detect, environment(ROOT, "cache"), folder))
        tell("likewise, the second time", "numba + .6 s", timed(detect, environment(ROOT, "cache"), folder, 5))
        tell("another clone on this machine", "2 s", timed(detect, environment(clone, "cache"), folder))
        if wheel is not None:
            pip = [
                "-m",
                "pip",
                "install",
                "-q",
                "--no-deps",
                "--no-index",
                "--target",
                "installed",
                str(wheel.resolve()),
            ]
            subprocess.run([sys.executable, *pip], cwd=folder, check=True)
            installed = environment(folder / "installed", "other-cache")
            tell("from the wheel, nothing compiled", "3 s", timed(detect, installed, folder))
            tell("likewise, the second time", "numba + .6 s", timed(detect, installed, folder, 5))


if __name__ == "__main__":
    main()
