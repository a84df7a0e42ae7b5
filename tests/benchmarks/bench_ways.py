"""The ranking of ways of making against draws, way by way.

Run from the repository's root: `python -m tests.benchmarks.bench_ways [--draws 40] [--kind board]`. A board of
220 x 220 mm in 30 photos, and an icosahedron of edge 100 mm in 90, as `design ways` photographs them. The error of the
camera where the target was seen, as it is predicted, over what draws of the same way give; and whether it was marked.
"""

import argparse
import time

import calib
import designer

BY = "distortion_map"
VIEWS = {"board": 30, "ico": 90}


def main() -> None:
    """Print a line a way."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--kind", choices=VIEWS, nargs="*", default=list(VIEWS))
    asked = parser.parse_args()
    for kind in asked.kind:
        made = designer.board(size_mm=(220, 220)) if kind == "board" else designer.ico(edge_mm=100)
        begin = time.perf_counter()
        ways = calib.ways(made.geometry, views=VIEWS[kind], by=BY).study.ways()
        print(f"{kind}: {len(ways)} ways in {time.perf_counter() - begin:.1f} s")
        drawn = {}
        for one in ways:
            found = calib.tolerance(
                made.geometry, one.way.name, views=VIEWS[kind], draws=asked.draws, by=BY, jobs=1
            )  # fmt: skip
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
