"""What a rig can be expected to measure: what `calib budget` does."""

from collections.abc import Sequence
from dataclasses import dataclass
from os import fspath
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.api.loading import Place, folder_of, rig_of
from calib.api.page_shown import ShownAsPage
from calib.api.triangulating import noise_of_person
from calib.cameras.rig import Rig
from calib.core.files import check_folder, write_files
from calib.core.parallel import one_thread
from calib.records.budget_file import (
    BUDGET,
    BUDGET_FILE,
    GRID_FILE,
    BudgetParts,
    BudgetRecord,
    LengthErrors,
    budget_record,
    grid_csv,
)
from calib.renderer.quantities import real, whole
from calib.space.budget import (
    Expected,
    if_known_exactly,
    length_errors,
    over_volume,
    position_errors,
    shape_changes,
    shape_errors,
)
from calib.space.budget_views import depth_curve, slices
from calib.space.error_size import NOT_KNOWN, errors_of, rms_error_mm
from calib.space.triangulate import UNSURE, noise_of
from calib.space.volume import WorkingVolume, box_volume, default_volume, volume_between
from calib.space.what_if import what_ifs
from designer.base.errors import InputError
from designer.base.own_files import require_ours

Array = NDArray[np.float64]

DISTANCES_MM = (1e-3, 1e7)
LENGTHS_MM = (1e-3, 1e6)
USUAL_LENGTH_MM = 100.0
NOISE_OF_RINGS = (
    "the noise is that of the target's marks in the photos that the rig was solved from; points that are found less "
    "surely are measured worse: give their noise with --noise"
)
AHEAD, ALONG = ("to the right", "down", "ahead"), ("along x", "along y", "along z")


@dataclass(frozen=True, eq=False)
class BudgetResult(ShownAsPage):
    """What to expect of a rig: `found.record.position.median_mm`, `found.expected.covariance_mm2`.

    In a notebook the result shows its page.
    """

    rig: Rig
    expected: Expected  # point by point of an even lattice over the volume
    shape_mm: Array  # (N,) by the rig's errors, the best rigid motion of all points taken off
    record: BudgetRecord  # all that is told
    kind = "budget"

    def save(self, folder: Place) -> tuple[Path, ...]:
        """Write `budget.json` and `grid.csv` into a folder; return the files.

        Raises:
            InputError: the folder takes no files, or holds somebody else's.
        """
        place = folder_of(folder)
        files = {
            place / BUDGET_FILE: BUDGET.text(self.record), place / GRID_FILE: grid_csv(self.expected, self.shape_mm)
        }  # fmt: skip
        write_files(files)
        return tuple(files)


def check_budget_folder(folder: Path) -> None:
    """Refuse a folder that takes no budget, before any work is done.

    Raises:
        InputError: the message names it.
    """
    check_folder(folder)
    require_ours(folder / BUDGET_FILE, kind=BUDGET.format)
    require_ours(folder / GRID_FILE, kind="ringsolid.budget")


@one_thread
def budget(
    rig: Rig | Place,
    *,
    volume: tuple[Sequence[float], Sequence[float]] | None = None,
    distance_mm: tuple[float, float] | None = None,
    noise_px: float | Sequence[float] | None = None,
    seen_by: int = 2,
    length_mm: float = USUAL_LENGTH_MM,
) -> BudgetResult:
    """Tell what a rig can be expected to measure, in mm: `budget("rig.json", distance_mm=(500, 4000))`.

    >>> found = calib.budget("rig.json", distance_mm=(500, 4000))
    >>> found.record.position.median_mm, found.record.by_noise.median_mm

    Args:
        rig: the cameras with their joint covariance, or the file of them.
        volume: corners low and high, each x, y, z in mm in the rig's frame.
        distance_mm: nearest and farthest, in place of a volume: what the cameras see between them. None of both: around
            where the optical axes meet, or from 5 to 25 baselines away.
        noise_px: of a coordinate, of all cameras or each; None: the rig's.
        seen_by: cameras that have to see a point.
        length_mm: whose error is told, too.

    Raises:
        InputError: a file that cannot be read, options that break a rule, or a volume that too few cameras see.
    """
    known = rig_of(rig)
    given = noise_of_person(known, noise_px)
    noise = noise_of(known, given)
    count = whole("--seen-by", seen_by, 2, len(known.names)) if len(known.names) > 1 else _alone()
    length = real("--length", length_mm, *LENGTHS_MM, " mm")
    chosen = _volume(known, volume, distance_mm, count)
    expected, share = over_volume(known, chosen, noise, count)
    parts = BudgetParts(
        known, chosen, share, count, noise, expected, _shape_mm(expected), length,
        _lengths(known, chosen, expected, length, noise), if_known_exactly(known, expected),
        what_ifs(known, chosen, noise, count), depth_curve(known, chosen, noise, count),
        slices(known, chosen, noise, count),
    )  # fmt: skip
    settings = {} if isinstance(rig, Rig) else {"rig file": fspath(rig)}
    shared = expected.calibration_mm2
    errors = {
        "position": position_errors(expected), "by_noise": errors_of(rms_error_mm(expected.noise_mm2)),
        "by_calibration": NOT_KNOWN if shared is None else errors_of(rms_error_mm(shared)),
        "shape": shape_errors(expected), "shape_by_calibration": errors_of(parts.shape_mm),
    }  # fmt: skip
    record = budget_record(parts, settings, errors, _remarks(known, expected, is_usual=given is None))
    return BudgetResult(known, expected, parts.shape_mm, record)


def _alone() -> int:
    raise InputError("a rig of one camera: depth needs two; give a rig of two cameras or more")


def _volume(
    rig: Rig, box: tuple[Sequence[float], Sequence[float]] | None, distance_mm: tuple[float, float] | None, seen_by: int
) -> WorkingVolume:
    if box is not None and distance_mm is not None:
        raise InputError("--volume and --distance: each says where is to be measured; give one")
    if box is not None:
        return box_volume(np.asarray(box[0], dtype=np.float64), np.asarray(box[1], dtype=np.float64))
    if distance_mm is None:
        return default_volume(rig, seen_by)
    near, far = (real("--distance", one, *DISTANCES_MM, " mm") for one in distance_mm)
    if not near < far:
        raise InputError(f"--distance {near:g}..{far:g} mm: the smaller comes first")
    return volume_between(rig, near, far, seen_by)


def _shape_mm(expected: Expected) -> Array:
    changes = shape_changes(expected)
    if changes is None:
        return np.full(len(expected.point_mm), np.nan)
    shape: Array = np.sqrt((changes**2).sum(axis=(1, 2)))
    return shape


def _lengths(
    rig: Rig, volume: WorkingVolume, expected: Expected, length_mm: float, noise_px: Array
) -> tuple[LengthErrors, ...]:
    """The errors of a length along each axis of the volume."""
    axes = volume.rig_from_volume[:3, :3]
    noise, shared = length_errors(rig, expected.point_mm, axes, length_mm, noise_px)
    known = expected.by_calibration is not None
    return tuple(
        LengthErrors(
            name, errors_of(np.sqrt(noise[:, axis] + (shared[:, axis] if known else 0.0))),
            errors_of(np.sqrt(noise[:, axis])), errors_of(np.sqrt(shared[:, axis])),
        )
        for axis, name in enumerate(AHEAD if volume.is_ahead else ALONG)
    )  # fmt: skip


def _remarks(rig: Rig, expected: Expected, *, is_usual: bool) -> tuple[str, ...]:
    """What a person must know of the numbers."""
    said: tuple[str, ...] = ("what stands between a camera and a point is not regarded",)
    away = np.linalg.norm(expected.point_mm[:, None] - rig.center_mm, axis=2).min(axis=1)
    lost = float((rms_error_mm(expected.covariance_mm2) > UNSURE * away).mean())
    if lost > 0:
        said = (
            f"in {100 * lost:.1f} % of the volume errors reach a third of the distance: nothing is measured there",
            *said,
        )
    if is_usual:
        said = (NOISE_OF_RINGS, *said)
    if expected.by_calibration is None:
        unknown = "the rig's file tells no covariance: all errors are of the noise alone, the rig's own come on top"
        return unknown, *said
    return said
