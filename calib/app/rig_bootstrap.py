"""How sure a rig is, by samples of its frames: `calib study bootstrap --rig`, `calib.rig_bootstrap("rig")`."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calib.app.options import Dask, Jobs, Resume, Seed
from calib.app.study_result import STUDY_OUT, kept_samples
from designer.base.answer import program
from designer.base.errors import InputError
from designer.base.marks import Gap
from designer.base.options import option
from designer.base.words import printable
from designer.page.capability import capability
from designer.page.output import Output, output_of
from designer.page.progress import Progress, unheard
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.rigs.result import RigCalibration
    from calib.studies.rig_bootstrap import PairSpread
    from designer.page.blocks import Headline, Page

LEAST_FRAMES = 4
QUESTION = (
    "How far would the rig be off with other frames like these? Frames are drawn with replacement, as many as there "
    "are, and solved again."
)
MEANING = (
    "Stated: by the noise, as the solution has it. Spread: standard deviation of the samples; of places and turns the "
    "length of the error. Errors of the target's shape show here in part, as other frames are bent by them otherwise; "
    "its size, and what is wrong in every frame alike, shows in no sample."
)
SMALLER = 0.98
"""Of the ratio by the noise alone: what is less is told."""
HONEST = 1.5
"""Spread over stated: what is more was not stated, beyond the chance of some twenty frames."""


@dataclass(frozen=True, eq=False)
class RigBootstrap(
    Result, kind="rig_bootstrap", title="Bootstrap of a rig",
    files={"study.sqlite": "every sample; the study goes on from it"},
):  # fmt: skip
    """How far samples of a rig scatter: `found.ratio`, `found.pairs[0].baseline_spread_mm`.

    In a notebook the result shows its page.
    """

    program: str
    settings: dict[str, str]
    rig: str
    cameras: tuple[str, ...]
    frames: int
    samples: int  # that were solved
    failed: int  # that do not determine the rig
    ratio: Gap  # spread over stated sigma by the noise, root mean square over places and turns of all pairs
    ratio_of_all: Gap  # over all that is stated, what the target may have done, too; nan: that is not known
    pairs: "tuple[PairSpread, ...]"
    remarks: tuple[str, ...]

    def page(self) -> "Page":
        """Whether the stated sigmas hold, pair by pair."""
        return _page(self)


@capability
def rig_bootstrap(
    rig: Annotated[
        "RigCalibration | Place",
        option("instead: the folder of calib rig, of which frames are drawn", metavar="FOLDER"),
    ],
    *,
    samples: Annotated[int, option("each of as many frames as there are", 2, 100_000)] = 200,
    seed: Seed = 1,
    jobs: Jobs = None,
    dask: Dask = None,
    resume: Resume = False,
    out: Annotated["Place | Output | None", STUDY_OUT] = None,
    progress: Progress = unheard,
) -> RigBootstrap:
    """Solve samples of a rig's frames, drawn with replacement: `rig_bootstrap("rig").ratio`.

    >>> found = calib.rig_bootstrap("rig", samples=100)
    >>> [(one.names, one.baseline_sigma_mm, one.baseline_spread_mm) for one in found.pairs]

    Args:
        rig: a solved rig, or its folder.
        samples: each of as many frames as there are.
        seed: of what is drawn.
        jobs: processes; None: one per core.
        dask: address of a cluster's scheduler, which computes the samples instead.
        resume: go on with the study in the folder.
        out: a folder for the samples as they come, so that a stopped study goes on, and the page; None: `save` writes
            that.
        progress: is told what is being done.

    Raises:
        InputError: a folder that cannot be read, a rig that is not determined or that a robot or a table carried, or
            too few frames.
        StudyStoppedError: interrupted; the samples in a folder are kept.
    """
    import numpy as np

    from calib.judge.rig_folder import read_rig
    from calib.rigs.result import RigCalibration
    from calib.solver.problem import SolveOptions
    from calib.studies import rig_bootstrap as frames_drawn
    from calib.studies.samples import Case
    from calib.studies.workers import CaseSpec

    options = SolveOptions()
    if isinstance(rig, RigCalibration):
        name, found = "the rig", rig
    else:
        name, (found, provenance) = str(rig), read_rig(Path(rig))
        options = provenance.options
    frames = found.observations.frame_count
    if len(found.cameras) < 2 or found.carrier is not None:
        raise InputError(f"{name}: samples are drawn of rigs of two cameras or more, without a robot or a turntable")
    if found.status == "degenerate":
        raise InputError(f"{name}: its frames do not determine the cameras ({found.remarks[0]}); take more first")
    if frames < LEAST_FRAMES:
        raise InputError(
            f"{name}: {frames} frames; samples need at least {LEAST_FRAMES}, and say little of fewer than 20"
        )
    if found.delay_s is not None:
        raise InputError(f"{name}: its time offsets were estimated, which needs the frames in their order")
    output = None if out is None else output_of(out)
    if output is not None:
        RigBootstrap.check(output.place)
    pool = frames_drawn.frame_pool(found, options)
    case = CaseSpec(Case("rig", frames, frames), pool, samples)
    identity = frames_drawn.identity(pool, seed)
    drawn = kept_samples(case, identity, output, jobs, dask, resume=resume, progress=progress)
    has_rig, is_lost = drawn.status != "failed", np.isin(drawn.status, ("failed", "degenerate"))
    pairs = frames_drawn.rig_spread(found, drawn)
    result = RigBootstrap(
        program=program(), settings={"samples": str(samples), "seed": str(seed)}, rig=printable(Path(name).name),
        cameras=tuple(map(printable, found.observations.camera_names)), frames=frames,
        samples=int(has_rig.sum()), failed=int(is_lost.sum()),
        ratio=frames_drawn.spread_ratio(pairs), ratio_of_all=frames_drawn.spread_ratio(pairs, of_all=True), pairs=pairs,
        remarks=found.observations.remarks,
    )  # fmt: skip
    if output is not None:
        output.files += result.save(output.place, has_page=False)
    return result


def _page(found: RigBootstrap) -> "Page":
    from designer.page.blocks import Facts, Page, Paragraph, Section
    from designer.page.folders import Shown, notes, number, table_of

    failed = f", {found.failed} that do not determine the rig" if found.failed else ""
    facts = Facts(
        (("rig", ", ".join(found.cameras)), ("samples", f"{found.samples} of {found.frames} frames each{failed}"))
    )
    pair = Shown["PairSpread"]
    pairs = table_of(
        found.pairs, pair("pair", lambda one: " - ".join(map(printable, one.names))),
        pair("frames", lambda one: one.frames, "that both see"),
        pair("distance mm", lambda one: number(one.baseline_mm, 6)),
        pair("stated mm", lambda one: one.baseline_sigma_mm), pair("spread mm", lambda one: one.baseline_spread_mm),
        pair("place, stated mm", lambda one: one.place_sigma_mm),
        pair("place, spread mm", lambda one: one.place_spread_mm),
        pair("turn, stated deg", lambda one: math.degrees(one.turn_sigma_rad)),
        pair("turn, spread deg", lambda one: math.degrees(one.turn_spread_rad)), visible_rows=20,
    )  # fmt: skip
    section = Section("Pairs of cameras", (pairs, *notes(found.remarks)), lead=MEANING)
    return Page(found.rig, "", _headline(found), (section,), lead=(Paragraph(QUESTION), facts))


def _headline(found: RigBootstrap) -> "Headline":
    """Whether the stated sigmas hold."""
    from designer.base.words import figure
    from designer.page.blocks import Headline

    ratio = found.ratio
    if math.isnan(ratio):
        return Headline("usable", "not known", "The rig states no sigmas that samples could be compared with.")
    chance = math.sqrt(0.5 / found.frames + 0.5 / found.samples)
    words = f"Places and turns of cameras scatter {figure(ratio, 3)} times as far as the noise's sigmas say"
    words += f" (± {100 * chance:.0f} %)"
    if found.ratio_of_all < SMALLER * ratio:
        words += f", {figure(found.ratio_of_all, 3)} times as far as is stated with the target's errors"
        ratio = found.ratio_of_all
    if ratio > HONEST:
        return Headline("usable", f"{figure(ratio, 3)} times", f"{words}: take the spread, not the stated sigmas.")
    return Headline("good", f"{figure(ratio, 3)} times", f"{words}.")
