"""Whether verdicts are right: random calibrations with known cameras, judged as `calib run` judges, against the truth.

Run from the repository's root: `python -m tests.benchmarks.bench_verdict [--runs N] [--first N] [--virtual]`. Each run
draws a target (board, icosahedron), a lens (mild, strong, one that no Brown polynomial fits), a habit of taking photos
(number, place, size, tilts, distances; some tilt the target about one axis only and never roll), noise, and more than
half of them a fault (a target that is not as its file says: printed, bent or stretched; glare, a focus that moves; what
all photos share: a target that moves while the shutter rolls, a focal length that follows distance or time, centres off
along the tilt). A
target that is as its file says is judged as one, as that of rendered photos is, others by how their kind is usually
made; `--assume` takes all targets to be made so, also those that are better. The sightings are computed, not rendered.
The true error of the camera is what 95 % of the image differs by from the true one, their best rotation removed, in
pixels. The peer is the rule people go by: a root-mean-square reprojection error of OpenCV's model below 0.2 px is good.
`--virtual` solves the learned map too, as `calib run` does: several times slower on icosahedra. `--faults` draws of
these alone, and `--careful` many photos taken with care, so that a verdict of good is at stake.
"""

import argparse
import os
import time
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from designer.base.arrays import Array, Flags

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"  # before NumPy is loaded

import numpy as np  # noqa: E402

from calib.cameras.camera import Camera  # noqa: E402
from calib.cameras.refit import camera_difference  # noqa: E402
from calib.judge.checks import read_criteria  # noqa: E402
from calib.judge.coverage import coverage_of  # noqa: E402
from calib.judge.halves import half_split  # noqa: E402
from calib.judge.judge import Judged  # noqa: E402
from calib.judge.verdict import Criteria, Grade, Limits  # noqa: E402
from calib.solver.calibrate import calibrate  # noqa: E402
from calib.solver.calibration import Calibration  # noqa: E402
from calib.solver.capture_error import with_capture_error  # noqa: E402
from calib.solver.problem import SolveOptions  # noqa: E402
from calib.solver.target_error import with_target_error  # noqa: E402
from designer.base.errors import InputError  # noqa: E402
from designer.tolerance.made import EXACT, how_made  # noqa: E402
from tests.benchmarks.verdict_scenes import FAULTS, Case, case_of, lens_of, sightings_of, target_of  # noqa: E402
from tests.support.verdict_cases import judge_run  # noqa: E402

RUNS = 600
PEER_RMSE_PX = 0.2
QUANTILE = 95
GRADES: tuple[Grade, ...] = ("good", "usable", "bad")


def promised_px(criteria: Criteria) -> Limits:
    """Within what error a camera is that is called good, being two standard deviations at most, or usable."""
    return Limits(2 * criteria["uncertainty"].good, criteria["uncertainty"].usable)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What the verdict said, and what is true."""

    case: Case
    truth: Camera
    calibrations: tuple[Calibration, ...]  # the judged one first
    judged: Judged
    true_px: float  # error within which 95 % of the image is
    inside_px: float  # 95 % of what the sightings cover
    rmse_px: float  # of OpenCV's model

    @property
    def grade(self) -> Grade:
        """Of the verdict."""
        return self.judged.verdict.grade


def outcome_of(case: Case, criteria: Criteria, models: Sequence[str], *, assumes: bool) -> Outcome | None:
    """Solve and judge; None if no camera can be solved."""
    rng = np.random.default_rng([8, case.seed])
    truth = lens_of(case, rng)
    seen = sightings_of(case, truth, rng)
    if seen is None:
        return None
    options = SolveOptions(reject_sigma=4.0 if case.rejects else None)
    solved: list[Calibration] = []
    for model in models:
        try:
            solved.append(calibrate(seen, model, options))
        except InputError:
            continue
    if not solved:
        return None
    way = how_made(target_of(case), EXACT if case.is_exact and not assumes else None)
    solved = [with_capture_error(with_target_error(one, way)) for one in solved]
    best = min(range(len(solved)), key=lambda row: _order(solved[row]))
    halves = half_split(solved[best], options)
    judged = judge_run(solved, best, halves, criteria)
    camera = solved[best].camera
    whole, inside = _true_errors(truth, camera, coverage_of(solved[best]).is_covered)
    peer = next((_rmse(one) for one in solved if one.camera.model == "opencv"), _rmse(solved[best]))
    ordered = (solved[best], *(one for row, one in enumerate(solved) if row != best))
    return Outcome(case, truth, ordered, judged, whole, inside, peer)


def _order(one: Calibration) -> tuple[bool, bool, float]:
    """As the report of a run chooses the camera to go on with."""
    return one.status != "converged", one.camera.learned is not None, _rmse(one)


def _rmse(one: Calibration) -> float:
    square = (one.residual_px[~one.is_outlier] ** 2).sum(axis=1)
    return float(np.sqrt(square.mean())) if len(square) else np.inf


def _true_errors(truth: Camera, solved: Camera, is_covered: Flags) -> tuple[float, float]:
    """What 95 % of the image, and of its covered part, differ by; without bound where the camera knows nothing."""
    try:
        found = camera_difference(truth, solved)
    except InputError:
        return np.inf, np.inf
    length = np.where(np.isfinite(found.length_px), found.length_px, np.inf)
    column = np.clip(found.pixel[..., 0] / truth.image_size[0] * is_covered.shape[1], 0, is_covered.shape[1] - 1)
    row = np.clip(found.pixel[..., 1] / truth.image_size[1] * is_covered.shape[0], 0, is_covered.shape[0] - 1)
    covered = is_covered[row.astype(int), column.astype(int)]
    inside = float(_quantile(length[covered])) if covered.any() else np.inf
    return _quantile(length.reshape(-1)), inside


def _quantile(values: Array) -> float:
    return float(np.percentile(values, QUANTILE, method="inverted_cdf"))


def outcomes(cases: Sequence[Case], criteria: Criteria, models: Sequence[str], *, assumes: bool) -> list[Outcome]:
    """All runs that give a camera."""
    found = (outcome_of(case, criteria, models, assumes=assumes) for case in cases)
    return [one for one in found if one is not None]


def _level(one: Outcome, criteria: Criteria) -> Grade:
    """What a judge who knows the truth would say."""
    limits = promised_px(criteria)
    return "good" if one.true_px <= limits.good else "usable" if one.true_px <= limits.usable else "bad"


def _share(part: Sequence[Outcome], whole: Sequence[Outcome]) -> str:
    """So many of so many."""
    return f"{len(part):4} of {len(whole):4} {100 * len(part) / max(len(whole), 1):5.1f} %"


def print_confusion(found: Sequence[Outcome], criteria: Criteria) -> None:
    """Verdicts against the truth, and who praises falsely."""
    limits = promised_px(criteria)
    print(f"{'verdict':12}{f'<= {limits.good:g} px':>10}{f'<= {limits.usable:g} px':>10}{'beyond':>10}   (true error)")
    for grade in GRADES:
        count = Counter(_level(one, criteria) for one in found if one.grade == grade)
        print(f"{grade:12}" + "".join(f"{count[level]:10}" for level in GRADES))
    good = [one for one in found if one.grade == "good"]
    peer = [one for one in found if one.rmse_px <= PEER_RMSE_PX]
    bad = [one for one in found if one.grade == "bad"]
    for limit in (limits.good, limits.usable):
        ours, theirs = ([one for one in praised if one.true_px > limit] for praised in (good, peer))
        wrong = [one for one in found if one.true_px > limit]
        print(f"\npraised, and off by more than {limit:g} px; of those praised, and of all that are so far off")
        print(f"  verdict good        {_share(ours, good)}   {_share([o for o in wrong if o in ours], wrong)}")
        print(f"  RMSE <= {PEER_RMSE_PX:g} px      {_share(theirs, peer)}   {_share(theirs, wrong)}")
        rates = [len(part) / max(len(whole), 1) for part, whole in ((theirs, peer), (ours, good))]
        print(f"  ratio               {rates[0] / rates[1] if rates[1] else np.inf:.1f}")
    fine, usable = [one for one in found if one.true_px <= limits.good], [one for one in found if one.grade == "usable"]
    alarms, far = [one for one in bad if one in fine], [one for one in usable if one.true_px > limits.usable]
    print(f"\nbad, and within {limits.good:g} px: of those bad {_share(alarms, bad)}; of all {_share(alarms, fine)}")
    print(f"usable, and beyond {limits.usable:g} px: {_share(far, usable)}")


def print_checks(found: Sequence[Outcome], criteria: Criteria) -> None:
    """How often each check is not good, and bad, by the true error; and alone."""
    groups: dict[Grade, list[Outcome]] = {level: [o for o in found if _level(o, criteria) == level] for level in GRADES}
    print(f"\n{'check':14}" + "".join(f"{'true ' + level:>22}" for level in GRADES) + f"{'alone':>16}")
    print(f"{'':14}" + f"{'usable, bad, unknown':>22}" * 3 + f"{'right, false':>16}")
    names = list(dict.fromkeys(check.name for one in found for check in one.judged.verdict.checks))
    for name in names:
        cells = []
        for part in groups.values():
            grades = Counter(_grade(one, name) for one in part)
            share = [100 * grades[grade] / max(len(part), 1) for grade in ("usable", "bad", "unknown")]
            cells.append(f"{', '.join(f'{one:.0f}' for one in share) + ' %':>22}")
        alone = [one for one in found if _alone(one) == name]
        right = sum(one.true_px > promised_px(criteria).good for one in alone)
        print(f"{name:14}" + "".join(cells) + f"{f'{right}, {len(alone) - right}':>16}")
    print("alone: the only check that is not good or unknown, with a camera that is off (right) or is not (false)")


def _grade(one: Outcome, name: str) -> str:
    return next((check.grade for check in one.judged.verdict.checks if check.name == name), "")


def _alone(one: Outcome) -> str:
    """The only check that found something; "" if there are none or several."""
    faults = [check.name for check in one.judged.verdict.checks if check.grade in ("usable", "bad")]
    return faults[0] if len(faults) == 1 else ""


def print_kinds(found: Sequence[Outcome], criteria: Criteria) -> None:
    """False praise and false alarms by what was drawn."""
    limits = promised_px(criteria)
    print(f"\n{'kind':20}{'runs':>6}{'good':>6}{'of these off':>14}{'far off':>9}{'bad':>6}{'of these fine':>15}")
    kinds: tuple[Callable[[Case], str], ...] = (
        lambda case: case.target, lambda case: f"fault {case.fault}", lambda case: f"lens {case.lens}",
        lambda case: f"habit {case.habit}", lambda case: f"views {_size_class(case.views)}",
    )  # fmt: skip
    for kind in kinds:
        for name in sorted({kind(one.case) for one in found}):
            part = [one for one in found if kind(one.case) == name]
            good, bad = ([one for one in part if one.grade == grade] for grade in ("good", "bad"))
            off, far = (sum(one.true_px > limit for one in good) for limit in (limits.good, limits.usable))
            fine = sum(one.true_px <= limits.good for one in bad)
            print(f"{name:20}{len(part):6}{len(good):6}{off:14}{far:9}{len(bad):6}{fine:15}")


def print_stated(found: Sequence[Outcome]) -> None:
    """What is stated against what is true, and what is named, by fault and amount."""
    print(
        f"\n{'fault':12}{'amounts':>22}{'runs':>6}{'true px':>10}{'stated px':>11}{'true > 2 stated':>17}{'named':>7}"
    )
    for fault in FAULTS:
        part = sorted((one for one in found if one.case.fault == fault), key=lambda one: one.case.amount)
        for third in (part[: len(part) // 3], part[len(part) // 3 : 2 * len(part) // 3], part[2 * len(part) // 3 :]):
            if not third:
                continue
            stated = [_check(one, "uncertainty") for one in third]
            beyond = sum(one.true_px > 2 * sigma for one, sigma in zip(third, stated, strict=True))
            errors = [one.calibrations[0].capture_error for one in third]
            named = sum(error is not None and any(effect.explains for effect in error.effects) for error in errors)
            amounts = f"{third[0].case.amount:.2g} to {third[-1].case.amount:.2g}"
            middle = np.median([one.true_px for one in third]), np.median(stated)
            print(f"{fault:12}{amounts:>22}{len(third):6}{middle[0]:10.3f}{middle[1]:11.3f}{beyond:17}{named:7}")
    print("true px, stated px: medians of the errors that 95 % of the image is within, and of the stated deviations")


def _check(one: Outcome, name: str) -> float:
    """The value of a check; infinite if it is not known."""
    value = next((check.value for check in one.judged.verdict.checks if check.name == name), None)
    return np.inf if value is None else value


def _size_class(views: int) -> str:
    return "1-3" if views < 4 else "4-9" if views < 10 else "10-40"


def print_false(found: Sequence[Outcome], criteria: Criteria, count: int) -> None:
    """The worst false praises and false alarms, one line each."""
    limits = promised_px(criteria)
    praised = [one for one in found if one.grade == "good" and one.true_px > limits.good]
    alarms = [one for one in found if one.grade == "bad" and one.true_px <= limits.good]
    for title, part in (("false praise", praised), ("false alarm", alarms)):
        print(f"\n{title}: {len(part)}")
        for one in sorted(part, key=lambda one: -one.true_px)[:count]:
            case = one.case
            faults = [f"{check.name} {check.grade}" for check in one.judged.verdict.checks if check.grade == "bad"]
            print(
                f"  {case.seed}: off {one.true_px:.2f} px (inside {one.inside_px:.2f}); {case.target} {case.lens} "
                f"{case.habit} {case.views} views, noise {case.noise_px:.2f}, {case.fault} {case.amount:.2g}"
                f"{' ' + case.print_model if case.fault == 'print' else ''}  {', '.join(faults)}"
            )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=RUNS)
    parser.add_argument("--first", type=int, default=0, help="seed of the first run")
    parser.add_argument("--criteria", default="standard")
    parser.add_argument("--virtual", action="store_true", help="solve the learned map too")
    parser.add_argument("--assume", action="store_true", help="take exact targets to be made as usual too")
    parser.add_argument("--faults", nargs="+", default=(), choices=FAULTS)
    parser.add_argument("--careful", action="store_true", help="many photos, taken with care")
    parser.add_argument("--shown", type=int, default=12, help="false praises and alarms that are listed")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore", RuntimeWarning)
    criteria = read_criteria(arguments.criteria)
    models = ("luhmann", "opencv", *(("virtual",) if arguments.virtual else ()))
    begin = time.perf_counter(), time.process_time()
    seeds = range(arguments.first, arguments.first + arguments.runs)
    cases = [case_of(seed, tuple(arguments.faults), careful=arguments.careful) for seed in seeds]
    found = outcomes(cases, criteria, models, assumes=arguments.assume)
    wall, processor = time.perf_counter() - begin[0], time.process_time() - begin[1]
    seconds = f"{wall:.0f} s, {processor:.0f} s of the processor"
    print(f"{len(found)} cameras of {arguments.runs} runs, {seconds}, limits {criteria.name}\n")
    print_confusion(found, criteria)
    print_checks(found, criteria)
    print_kinds(found, criteria)
    print_stated(found)
    print_false(found, criteria, arguments.shown)


if __name__ == "__main__":
    main()
