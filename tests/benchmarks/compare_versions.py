"""What every command writes, by two versions of the program: the numbers in all files, key by key.

Run from the repository's root with another checkout: `python -m tests.benchmarks.compare_versions OTHER [--keep DIR]`.
Both run the same commands on fixed seeds, each in a folder of its own. JSON files and answers are compared key by key,
tables cell by cell; numbers that differ by less than 1e-9 of their size are equal. What says when, how long or by
which program is left out. Pages, pictures and meshes are compared by whether they are there.
"""

import argparse
import csv
import io
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

HERE = Path(__file__).parent.parent.parent
SAME = 1e-9
"""Of a number's size: rounding of another order of sums."""
LEFT_OUT = (
    "seconds", "program", "line", "detector", "made_by", "wrote", "created", "version", "next", "remarks", "said",
)  # fmt: skip
"""Keys that tell time, place or wording."""
T = "b/b.target.json"
COMMANDS: tuple[tuple[str, ...], ...] = (
    ("design", "ico", "--edge", "60mm", "-o", "i"),
    ("design", "board", "--size", "120x90mm", "--name", "b", "-o", "b"),
    ("design", "check", T),
    ("design", "templates"),
    ("calib", "target", T),
    ("calib", "render", T, "-o", "photos", "--views", "9", "--distance", "150mm..260mm", "--aim-offset", "30mm",
     "--random-roll", "--blur", "0.7px", "--contrast-to-noise", "60", "--camera", "machine-vision"),
    ("calib", "detect", T, "photos", "-o", "d.csv", "--overlay", "overlays"),
    ("calib", "run", T, "photos", "-o", "camera"),
    ("calib", "solve", "d.csv", "--target", T, "--model", "opencv", "-o", "solved"),
    ("calib", "evaluate", "solved", "--held-out", "3", "-o", "held"),
    ("calib", "report", "camera", "--criteria", "metrology"),
    ("calib", "measure", T, "d.csv", "-o", "measured/b.target.json", "--held-out", "3", "--model", "opencv"),
    ("calib", "pose", T, "solved/camera.json", "photos", "-o", "poses.json"),
    ("calib", "undistort", "solved/camera.json", "photos", "-o", "flat"),
    ("calib", "convert", "solved/camera.json", "--to", "opencv", "-o", "camera.yaml"),
    ("calib", "diff", "solved/camera.json", "camera.yaml"),
    ("calib", "study", "bootstrap", "--target", T, "--detections", "d.csv", "--sizes", "5", "--samples", "40", "--jobs",
     "1", "-o", "study"),
    ("design", "tolerance", T, "--errors", "fdm-board", "--linear", "--views", "20", "-o", "cost"),
    ("design", "tolerance", T, "--errors", "fdm-board", "--draws", "6", "--views", "12", "--jobs", "1", "-o", "draws"),
)  # fmt: skip


def main() -> None:
    """Run both, compare, and say what differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("other", type=Path, help="checkout of the other version")
    parser.add_argument("--keep", type=Path, help="folder for what both write (default: one that is deleted)")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        folder = asked.keep or Path(place)
        found = [_written(tree, folder / name) for tree, name in ((asked.other, "other"), (HERE, "this"))]
    lines = list(_differences(*found))
    for line in lines:
        print(line)
    print(f"{len(lines)} differences in {len(found[1])} keys of {len(COMMANDS)} commands")
    sys.exit(bool(lines))


def _written(tree: Path, folder: Path) -> dict[str, str | float]:
    """All values that a version writes, by file and key."""
    folder.mkdir(parents=True, exist_ok=True)
    found: dict[str, str | float] = {}
    for number, (name, *words) in enumerate(COMMANDS):
        module = {"design": "designer.cli", "calib": "calib.cli"}[name]
        done = subprocess.run(
            [sys.executable, "-m", module, *words, "--json"], cwd=folder, capture_output=True, text=True, check=False,
            env={**os.environ, "PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1"},
        )  # fmt: skip
        place = f"{number} {name} {words[0]}"
        print(f"{tree.name}: {place}: exit {done.returncode} {done.stderr.strip()[-200:]}", file=sys.stderr)
        found[f"{place} exit"] = float(done.returncode)
        if done.stdout.startswith("{"):
            found |= dict(_flat(json.loads(done.stdout), place))
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        found |= dict(_values(path, path.relative_to(folder).as_posix()))
    return found


def _values(path: Path, name: str) -> Iterator[tuple[str, str | float]]:
    """The values in a file; of one that holds no table or JSON that it is there."""
    if path.suffix == ".json" and path.name != "page.json":  # which is a page, as index.html
        yield from _flat(json.loads(path.read_text(encoding="utf-8")), name)
    elif path.suffix == ".csv":
        text = "".join(line for line in path.open(encoding="utf-8") if not line.startswith("#"))
        for number, row in enumerate(csv.DictReader(io.StringIO(text))):
            for key, cell in row.items():
                yield f"{name}:{number}.{key}", _number(cell)
    else:
        yield name, "is there"


def _flat(value: object, place: str) -> Iterator[tuple[str, str | float]]:
    """The leaves of a JSON value, each with the way to it."""
    if isinstance(value, dict):
        for key, one in value.items():
            if key not in LEFT_OUT:
                yield from _flat(one, f"{place}.{key}")
    elif isinstance(value, list):
        for number, one in enumerate(value):
            yield from _flat(one, f"{place}.{number}")
    else:
        yield place, float(value) if isinstance(value, int | float) else str(value)


def _number(cell: str) -> str | float:
    try:
        return float(cell)
    except ValueError:
        return cell


def _differences(other: dict[str, str | float], this: dict[str, str | float]) -> Iterator[str]:
    for key in sorted(other.keys() | this.keys()):
        a, b = other.get(key), this.get(key)
        if a is None or b is None:
            yield f"{'added' if a is None else 'gone'}: {key} = {b if a is None else a!s:.80}"
        elif isinstance(a, float) and isinstance(b, float):
            if not (math.isclose(a, b, rel_tol=SAME, abs_tol=1e-12) or (math.isnan(a) and math.isnan(b))):
                yield f"other: {key}: {a!r} -> {b!r}"
        elif a != b:
            yield f"other: {key}: {a!s:.80} -> {b!s:.80}"


if __name__ == "__main__":
    main()
