"""How sure a rig is, by samples of its frames: what `calib study bootstrap --rig` does."""

from dataclasses import dataclass
from pathlib import Path

from calib.api.page_shown import ShownAsPage
from calib.api.table_folder import check_table_folder, write_table
from calib.app.inputs import MAX_SEED, Place
from calib.records.rig_file import read_rig
from calib.renderer.quantities import whole
from calib.rigs.result import RigCalibration
from calib.solver.options import SolveOptions
from calib.studies.rig_bootstrap import LEAST_SAMPLES, rig_spread
from calib.studies.rig_bootstrap_record import RIG_BOOTSTRAP, RigBootstrapStudy
from designer.base.answer import program
from designer.base.errors import InputError
from designer.base.words import printable
from designer.page.progress import Progress, unheard

MOST_SAMPLES, LEAST_FRAMES = 100_000, 4


@dataclass(frozen=True, eq=False)
class RigBootstrapResult(ShownAsPage):
    """How far samples of a rig scatter: `found.study.ratio`, `found.study.pairs[0].baseline_spread_mm`.

    In a notebook the result shows its page.
    """

    study: RigBootstrapStudy
    kind = "rig_bootstrap"

    def save(self, folder: Place) -> tuple[Path, ...]:
        """Write `table.json`; return the files.

        Raises:
            InputError: the folder takes no files, or holds somebody else's.
        """
        return write_table(folder, RIG_BOOTSTRAP, self.study)


def check_rig_bootstrap_folder(folder: Path) -> None:
    """Refuse a folder that takes no such study, before any work is done.

    Raises:
        InputError: the message names it.
    """
    check_table_folder(folder, RIG_BOOTSTRAP)


def rig_bootstrap(
    rig: RigCalibration | Place, *, samples: int = 200, seed: int = 1, progress: Progress = unheard
) -> RigBootstrapResult:
    """Solve samples of a rig's frames, drawn with replacement: `rig_bootstrap("rig").study.ratio`.

    >>> found = calib.rig_bootstrap("rig", samples=100)
    >>> [(one.names, one.baseline_sigma_mm, one.baseline_spread_mm) for one in found.study.pairs]

    Args:
        rig: a solved rig, or its folder.
        samples: each of as many frames as there are.
        seed: of what is drawn.
        progress: is told what is being done.

    Raises:
        InputError: a folder that cannot be read, a rig that is not determined or that a robot or a table carried, or
            too few frames.
    """
    options = SolveOptions()
    if isinstance(rig, RigCalibration):
        name, found = "the rig", rig
    else:
        name, (found, provenance) = str(rig), read_rig(Path(rig))
        options = provenance.options
    samples = whole("--samples", samples, LEAST_SAMPLES, MOST_SAMPLES)
    seed = whole("--seed", seed, 0, MAX_SEED)
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
    progress("sampling", 0, samples)
    spread = rig_spread(found, samples, seed, options, lambda done: progress("sampling", done, samples))
    study = RigBootstrapStudy(
        program=program(), settings={"samples": str(samples), "seed": str(seed)},
        rig=printable(Path(name).name), cameras=tuple(map(printable, found.observations.camera_names)), frames=frames,
        samples=spread.samples, failed=spread.failed, ratio=spread.ratio,
        ratio_of_all=spread.ratio_of_all, pairs=spread.pairs,
        remarks=found.observations.remarks,
    )  # fmt: skip
    return RigBootstrapResult(study)
