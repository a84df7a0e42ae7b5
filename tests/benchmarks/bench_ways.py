"""The ranking of ways of making against draws, way by way.

Run from the repository's root: `python -m tests.benchmarks.bench_ways [--draws 40] [--kind board]`. A board of
220 x 220 mm in 30 photos, and an icosahedron of edge 100 mm in 90, as `design ways` photographs them. The error of the
camera where the target was seen, as it is predicted, over what draws of the same way give; and whether it was marked.
`--docs` prints the tables of docs/choose-a-target.md instead.
"""

import argparse
import time

import calib
import designer

BY = "distortion_map"
VIEWS = {"board": 30, "ico": 90}


HEADS = {"board": "board of 220 x 220 mm, 30 photos", "ico": "icosahedron of edge 100 mm, 90 photos"}
TOLD = (("distortion_map", "px"), ("focal_length", "px"), ("intersection_true", "mm"))


def docs_table(kind: str) -> None:
    """A table of the docs, as the command finds it."""
    made = designer.board(size_mm=(220, 220)) if kind == "board" else designer.ico(edge_mm=100)
    study = calib.ways(made.geometry, views=VIEWS[kind], by=BY).study
    print(f"| {HEADS[kind]} | camera where seen | focal length | intersection, true shape | price, EUR | hours |")
    print("|---|--:|--:|--:|--:|--:|")
    ways = study.ways()
    noise = " | ".join(f"{study.noise(name):.1g} {unit}" for name, unit in TOLD)
    print(f"| noise alone | {noise} | | |")
    for one in ways:
        mark = {name: "~" * one.is_beyond(name) for name, _ in TOLD}
        values = " | ".join(f"{mark[name]}{two(one.total(name))} {unit}" for name, unit in TOLD)
        print(f"| {one.way.title}, `{one.way.name}` | {values} | {two(one.way.price_eur)} | {two(one.way.hours)} |")


def two(value: float) -> str:
    """With two digits."""
    return f"{float(f'{value:.2g}'):g}"


def main() -> None:
    """Print a line a way."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--kind", choices=VIEWS, nargs="*", default=list(VIEWS))
    parser.add_argument("--docs", action="store_true")
    asked = parser.parse_args()
    for kind in asked.kind if asked.docs else ():
        docs_table(kind)
    for kind in () if asked.docs else asked.kind:
        made = designer.board(size_mm=(220, 220)) if kind == "board" else designer.ico(edge_mm=100)
        begin = time.perf_counter()
        ways = calib.ways(made.geometry, views=VIEWS[kind], by=BY).study.ways()
        print(f"{kind}: {len(ways)} ways in {time.perf_counter() - begin:.1f} s")
        drawn = {}
        for one in ways:
            found = calib.tolerance(made.geometry, one.way.name, views=VIEWS[kind], draws=asked.draws, by=BY, jobs=1)
            drawn[one.way.name] = found.study.total(BY)
            mark = "marked" if one.is_beyond(BY) else ""
            print(
                f"  {one.way.name:20} predicted {one.total():.3g} px, drawn {drawn[one.way.name]:.3g} px, "
                f"ratio {one.total() / drawn[one.way.name]:.3f} {mark}",
                flush=True,
            )
        order = sorted(drawn, key=lambda name: drawn[name])
        print(f"  order by draws: {', '.join(order)}; the same: {order == [one.way.name for one in ways]}")


if __name__ == "__main__":
    main()
