"""How long a tolerance study takes, by draws and by prediction, and how far the two agree.

Run from the repository's root: `python -m tests.benchmarks.bench_tolerance [--draws N] [--errors NAME] [--scratch N]`.
An icosahedron (edge 100 mm, 36 rings a face) in 90 views at 400 mm of a 5 megapixel camera, one process and one thread.
The time of 200 draws on two cores is half of what these draws say. Then, by source and quantity: cost by draws over
that by prediction, and its standard error in per cent. With `--scratch`, so many draws of all errors together are
solved from scratch, and their cameras compared.
"""

import argparse
import os
import time
from dataclasses import dataclass, replace

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before NumPy is loaded

import numpy as np  # noqa: E402

from calib.cameras.camera import Camera  # noqa: E402
from calib.solver.solve import solve  # noqa: E402
from calib.studies.tolerance.anchor import minimum_of  # noqa: E402
from calib.studies.tolerance.draw import drawn_noise, drawn_values, run_draws, seen_px  # noqa: E402
from calib.studies.tolerance.predict import ToleranceTable, linear_table, table_of_draws  # noqa: E402
from calib.studies.tolerance.quantities import NAMES  # noqa: E402
from calib.studies.tolerance.seen import aimed_at  # noqa: E402
from calib.studies.tolerance.setting import Setting, make_setting  # noqa: E402
from designer.kinds.ico import IcoSpec  # noqa: E402
from designer.kinds.layout import lay_out  # noqa: E402
from designer.tolerance.error_file import error_model  # noqa: E402
from designer.tolerance.model import ErrorModel, displaced_shape  # noqa: E402
from designer.tolerance.shape import centers_mm  # noqa: E402

CAMERA = Camera("opencv", np.array([2500.0, 2500, 1223.5, 1023.5, 0, 0, 0, 0, 0]), (2448, 2048))
MANY, PROCESSES = 200, 2
DRAWS_GOAL_S, LINEAR_GOAL_S = 40.0, 0.3
NOT_THERE = 0.2
"""A cost below this part of what noise alone shows is not compared."""


@dataclass(frozen=True)
class Seconds:
    """On the wall and of the processor; other work on the machine shows in the first only."""

    wall: float
    processor: float


def line(first: str, *cells: str) -> None:
    """Print a line of the table."""
    print(f"{first:<14}" + "".join(f"{cell:>14}" for cell in cells), flush=True)


def clock() -> Seconds:
    """Now."""
    return Seconds(time.perf_counter(), time.process_time())


def since(begin: Seconds) -> Seconds:
    """The time since then."""
    now = clock()
    return Seconds(now.wall - begin.wall, now.processor - begin.processor)


def compare(drawn: ToleranceTable, linear: ToleranceTable) -> None:
    """Print cost by draws over prediction; `-` where there is none to speak of."""
    line("draws / linear", *(name[:12] for name in NAMES))
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = drawn.cost.value / linear.cost.value
        error = 100 * drawn.cost.error / drawn.cost.value
    for place, source in enumerate(linear.sources):
        is_there = linear.cost.value[place] > NOT_THERE * linear.baseline.value
        cells = (
            f"{one:.2f} +-{off:.0f}%" if there else "-"
            for one, off, there in zip(ratio[place], error[place], is_there, strict=True)
        )
        line(source, *cells)
    line("all together", *(f"{one:.2f}" for one in drawn.together.value / linear.together.value))


def from_scratch(setting: Setting, errors: ErrorModel, draws: int) -> None:
    """Print how far the cameras of draws are from those solved from scratch."""
    for number in range(draws):
        values = drawn_values(setting, errors, 0, number)
        shape = displaced_shape(setting.target, values, model=errors)
        pixel = seen_px(setting, centers_mm(shape)) + drawn_noise(setting, 0, number)
        found = minimum_of(setting.anchor, np.ascontiguousarray(pixel.T))
        scratch = solve(replace(setting.observations, center_px=pixel), setting.model)
        if found is None:
            print(f"draw {number}: no minimum, from scratch: {scratch.status}")
            continue
        sigma = np.sqrt(np.diagonal(scratch.param_covariance))
        off = np.abs((found.camera.params - scratch.camera.params) / sigma).max()
        cost = found.cost / (scratch.residual_px**2).sum() - 1
        print(f"draw {number}: {off:.1e} standard deviations, cost {cost:+.1e} of that from scratch")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=50)
    parser.add_argument("--errors", default="fdm-dual-calibrated")
    parser.add_argument("--scratch", type=int, default=0)
    chosen = parser.parse_args()
    errors = error_model(chosen.errors)
    target = lay_out(IcoSpec(100.0, 8, 7.0, 0.45, 10.0, 2.0, 1.0))
    begin = clock()
    setting = make_setting(target, CAMERA, views=90, photos=aimed_at(target, 400.0), model="opencv", seed=1)
    print(
        f"setting: {since(begin).wall:.2f} s, {len(setting.observations.view)} sightings, {len(errors.sources)} sources"
    )
    run_draws(setting, errors, 0, range(1))  # compiles
    linear_table(setting, errors)  # compiles
    begin = clock()
    linear = linear_table(setting, errors)
    took = since(begin)
    print(f"prediction: {took.wall:.2f} s, {took.processor:.2f} s of the processor; goal {LINEAR_GOAL_S:g} s")
    begin = clock()
    draws = run_draws(setting, errors, 0, range(chosen.draws))
    took = since(begin)
    each = took.processor / chosen.draws
    print(
        f"draws: {1e3 * each:.0f} ms each ({1e3 * took.wall / chosen.draws:.0f} on the wall), {MANY} on {PROCESSES} "
        f"cores {each * MANY / PROCESSES:.0f} s; goal {DRAWS_GOAL_S:g} s"
    )
    compare(table_of_draws(errors, draws), linear)
    from_scratch(setting, errors, chosen.scratch)


if __name__ == "__main__":
    main()
