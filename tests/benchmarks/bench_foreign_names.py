"""Photos of all targets before the files of all targets: how many names are wrong.

Run from the repository's root: `python -m tests.benchmarks.bench_foreign_names [--views N] [--first SEED]`.
A view is one photo before one file. Each seed draws a photo of a target, from the templates or at random, clean or with
clutter, covers and glare, whole or in part, and holds it against the template files, its own file, a sibling (one row
more or less, or a ring more along a side) and a file drawn at random. One process; the log, a line a photo, lets a
killed run resume as long as the detector did not change.

Names of another target are wrong, all of them, unless the photo shows nothing that could tell: a part of a board that
the other board has as well, in the same proportions, each ring with the same name counted from the dots, all that
differs outside the image; or one face of a solid. Such photos are counted apart. What only a cover hides is not
excused. An icosahedron of other proportions is another target, though its codes are the same.
"""

import argparse
import hashlib
import json
import math
import tempfile
from collections import Counter
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

import calib
from calib.detector.pipeline import detect
from calib.renderer import RenderOptions
from designer.kinds.board import BoardSpec
from designer.kinds.layout import lay_out
from designer.target import TargetGeometry
from tests.benchmarks.synthetic import row
from tests.support.foreign_views import Photo, false_names, is_alike, photo_of, random_target, template_targets

DUE = 12
"""A photo shows the target if so many of its features are in clear view."""

PARTLY = 0.8


@dataclass(frozen=True)
class Record:
    """What one photo before one file gave."""

    seed: int
    shown: str
    asked: str
    is_own: bool  # of the same layout and proportions
    named: int
    wrong: int
    due: int  # features of the target shown in clear view
    refused: bool  # named at first, and refused by the evidence


def drawn(seed: int) -> tuple[str, Photo, dict[str, TargetGeometry]]:
    """The photo of a seed, and the files that it is held against."""
    rng = np.random.default_rng(seed)
    templates = dict(template_targets())
    name = list(templates)[int(rng.integers(len(templates)))] if rng.random() < 0.4 else "random"
    shown = templates.get(name) or random_target(rng)
    is_dirty = rng.random() < 0.6
    options = RenderOptions(
        blur_px=rng.uniform(0.4, 1.5),
        contrast_to_noise=math.exp(rng.uniform(math.log(20), math.log(100))),
        light_gradient=rng.uniform(0, 0.5),
        shading=rng.uniform(0, 0.5),
        vignetting=0.3 * float(rng.integers(2)),
        glare=is_dirty * float(rng.integers(2)) * rng.uniform(0, 0.8),
        clutter=is_dirty * int(rng.integers(1, 60)),
        occlusion=is_dirty * float(rng.integers(2)) * rng.uniform(0, 0.3),
    )
    photo = photo_of(shown, rng, options=options, radius_px=(4, 18), is_whole=bool(rng.integers(2)))
    files = {**templates, "own": shown, "sibling": sibling(shown, rng), "another": random_target(rng)}
    kept: dict[str, TargetGeometry] = {}
    for asked, target in files.items():
        if asked == "own" or not any(is_alike(target, other) for other in (shown, *kept.values())):
            kept[asked] = target
    return name, photo, kept


def sibling(target: TargetGeometry, rng: np.random.Generator) -> TargetGeometry:
    """The same target with a row or two more or less, its proportions kept."""
    spec, change = target.spec, int(rng.choice([-2, -1, 1, 2]))
    if isinstance(spec, BoardSpec):
        grown = change * spec.pitch_mm
        if rng.random() < 0.5:
            size = (spec.size_mm[0] + grown, spec.size_mm[1])
            return lay_out(replace(spec, columns=max(spec.columns + change, 3), size_mm=size))
        return lay_out(
            replace(spec, rows=max(spec.rows + change, 3), size_mm=(spec.size_mm[0], spec.size_mm[1] + grown))
        )
    assert spec is not None
    rings = max(spec.rings_per_side + change, 5)
    return lay_out(
        replace(spec, rings_per_side=rings, edge_mm=spec.edge_mm + (rings - spec.rings_per_side) * spec.pitch_mm)
    )


def measure(seed: int) -> list[Record]:
    """Draw a photo and hold it against the files."""
    shown, photo, files = drawn(seed)
    records = []
    for asked, target in files.items():
        found = detect(photo.view.image, target, name=str(seed))
        records.append(
            Record(
                seed=seed,
                shown=shown,
                asked=asked,
                is_own=is_alike(target, photo.target),
                named=len(found.ring),
                wrong=false_names(found, photo, target),
                due=int(photo.view.clean.sum()),
                refused=any(remark.startswith("not taken for the target") for remark in found.remarks),
            )
        )
    return records


def default_log() -> Path:
    """A log for this state of renderer and detector."""
    sources = [Path(__file__), *sorted(Path(calib.__file__).parent.rglob("*.py"))]
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()
    return Path(tempfile.gettempdir()) / f"ringsolid-bench-foreign-names-{digest[:12]}.jsonl"


def run(views: int, first: int, log: Path) -> list[Record]:
    """Measure photo after photo until there are so many views, those of the log first."""
    lines = log.read_text(encoding="utf-8").splitlines() if log.exists() else []
    known = {part[0]["seed"]: part for part in (json.loads(line) for line in lines if line.endswith("]"))}
    records: list[Record] = []
    seed = first
    with log.open("a", encoding="utf-8") as file:
        while len(records) < views:
            new = [Record(**one) for one in known[seed]] if seed in known else measure(seed)
            if seed not in known:
                file.write(json.dumps([asdict(one) for one in new]) + "\n")
                file.flush()
            for one in new:
                if one.wrong or (one.is_own and one.refused):
                    print(f"  {one}", flush=True)
            records += new
            seed += 1
    return records


def report(records: list[Record]) -> None:
    """The table."""
    own, foreign = [r for r in records if r.is_own], [r for r in records if not r.is_own]
    row("wrong names, file of another target", "0", f"{sum(r.wrong for r in foreign)}",
        f"in {sum(r.wrong > 0 for r in foreign)} of {len(foreign)} views")  # fmt: skip
    untold = [r for r in foreign if r.named and not r.wrong]
    row("named by another file, all that differs being outside the image", "", f"{len(untold)}", "views")
    row("named at first and refused by the evidence", "", f"{sum(r.refused for r in foreign)}", "views")
    row("wrong names, file of this target", "0", f"{sum(r.wrong for r in own)}", f"of {sum(r.named for r in own)}")
    shown = [r for r in own if r.due >= DUE]
    row("own target named", "", f"{sum(r.named > 0 for r in shown)}", f"of {len(shown)} views")
    part = [r for r in shown if 0 < r.named < PARTLY * r.due]
    row("own target named in part", "", f"{len(part)}", f"views with under {PARTLY:.0%} of what is clear")
    refused = Counter(r.shown for r in shown if r.refused)
    row("own target refused by the evidence", "0", f"{sum(refused.values())}", f"{dict(refused)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--views", type=int, default=5000)
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--log", type=Path, default=default_log())
    arguments = parser.parse_args()
    print(f"log: {arguments.log}", flush=True)
    report(run(arguments.views, arguments.first, arguments.log))


if __name__ == "__main__":
    main()
