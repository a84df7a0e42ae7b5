"""Draws of a what-if study kept in `study.sqlite`, as the samples of other studies are: resumable and in parallel.

One draw with real images: every case is rendered, detected and calibrated, as a person's photos are.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.core.parallel import one_thread
from calib.core.types import Detections
from calib.detector.pipeline import detect
from calib.renderer.options import RenderOptions
from calib.renderer.scene import scene_from_target
from calib.renderer.view import render_view
from calib.studies.identity import identity_of
from calib.studies.runner import DrawCount, Sampling, Tell
from calib.studies.samples import Case, SampleResult, SampleStatus
from calib.studies.tolerance.draw import (
    NONE,
    case_names,
    drawn_values,
    error_settings,
    run_draws,
    solved,
    stream,
    true_shape,
)
from calib.studies.tolerance.quantities import QUANTITIES
from calib.studies.tolerance.seen import CONTRAST_TO_NOISE, LEAST_RINGS
from calib.studies.tolerance.setting import Setting, setting_of_observations
from calib.studies.workers import CaseSpec, SamplePool
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.target import TargetGeometry
from designer.tolerance.model import ErrorModel, displaced_shape
from designer.tolerance.shape import target_of

PHOTOS = RenderOptions(blur_px=0.7, contrast_to_noise=CONTRAST_TO_NOISE)
"""Photos of a good camera, whose detections the noise of the other draws was fitted to."""


@one_thread
def run_full_draws(setting: Setting, errors: ErrorModel, seed: int, numbers: range) -> Array:
    """The quantities of some draws, as `calib.studies.tolerance.draw.run_draws` has them.  # (D, C, Q)

    The errors are those of the draws without images; the noise is of the photos' pixels, the same in all cases.
    """
    result = np.empty((len(numbers), len(errors.amounts) + 2, len(NONE)))
    for place, number in enumerate(numbers):
        values = drawn_values(setting, errors, seed, number)
        cases = [{}, *({name: values[name]} for name in errors.sources), values]
        result[place] = [_case(setting, errors, case, seed, number) for case in cases]
    return result


def _case(setting: Setting, errors: ErrorModel, values: Mapping[str, Array], seed: int, number: int) -> Array:
    """Quantities (Q,); nan where no target, no photos of it or no camera come out."""
    try:
        shape = displaced_shape(setting.target, values, model=errors)
        found = photographed(setting, target_of(shape), seed, number)
        own, measured = setting_of_detections(setting, found)
    except InputError:
        return NONE
    return solved(own, measured, true_shape(shape, own.seen), None)[0]


def photographed(setting: Setting, made: TargetGeometry, seed: int, number: int) -> list[Detections]:
    """What the detector finds, with the drawing and the lens known, in photos of a made target; one for each view."""
    scene = scene_from_target(made)
    found = []
    for view, pose in enumerate(setting.cam_from_target):
        rng = np.random.default_rng(stream(seed, number, f"photo {view}").integers(2**63))
        photo = render_view(scene, setting.camera, pose, PHOTOS, rng)
        image = np.asarray(photo.image, dtype=np.uint8)
        found.append(detect(image, setting.target, name=f"view {view}", camera=setting.camera))
    return found


def setting_of_detections(setting: Setting, found: list[Detections]) -> tuple[Setting, Array]:
    """The setting with those of its observations that were detected, and their pixels (M, 2).

    Rings that are seen flatter or smaller than the setting counts are left out, that the numbers may be compared.
    """
    every = setting.observations
    counted = [np.isin(one.ring, every.point[every.view == view]) for view, one in enumerate(found)]
    kept = np.array([rows.sum() >= LEAST_RINGS for rows in counted])
    some = [(one, rows) for one, rows, ok in zip(found, counted, kept, strict=True) if ok]
    if not some:
        raise InputError("no photo shows the target; move closer or farther, or use a longer lens")
    seen = replace(
        every,
        view_names=tuple(one.image for one, _ in some),
        view=np.repeat(np.arange(len(some)), [rows.sum() for _, rows in some]),
        point=np.concatenate([one.ring[rows] for one, rows in some]),
        center_px=np.concatenate([one.center_px[rows] for one, rows in some]),
        cov_px2=np.concatenate([one.cov_px2[rows] for one, rows in some]),
    )
    return setting_of_observations(setting, setting.cam_from_target[kept], seen), seen.center_px


AGAINST_FILE, SWEEPS_FOLDER = "against.sqlite", "sweeps"
KIND = "tolerance"
CASE = "draws"


@dataclass(frozen=True, eq=False)
class DrawPool(SamplePool):
    """What draws are made from."""

    setting: Setting
    errors: ErrorModel
    full: bool  # with images, rendered and detected

    @property
    def view_count(self) -> int:
        """Of the setting."""
        return self.setting.view_count

    @property
    def model(self) -> str:
        """The kind of study."""
        return KIND

    @property
    def value_count(self) -> int:
        """All quantities of all cases."""
        return len(case_names(self.errors)) * len(QUANTITIES)

    def run(self, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
        """Draws; one in which a case has no solution is not converged."""
        draws = (run_full_draws if self.full else run_draws)(self.setting, self.errors, seed, numbers)
        results = []
        for number, draw in zip(numbers, draws, strict=True):
            lost = [name for name, row in zip(case_names(self.errors), draw, strict=True) if not np.isfinite(row).all()]
            message = f"no solution with {', '.join(lost)}" if lost else ""
            values = tuple(draw.ravel().tolist())
            status: SampleStatus = "stopped" if lost else "converged"
            results.append(SampleResult(number, status, self.view_count, values, message=message))
        return results


def kept_draws(
    sampling: Sampling, pool: DrawPool, file: str, inputs: Mapping[str, Path | str], seed: int, count: int, tell: Tell
) -> tuple[Array, DrawCount]:
    """The first draws of a study (D, C, Q), and how many of them its file did not have.

    Raises:
        InputError: the file is there and is not to be gone on with, or is of another study.
        StudyStoppedError: interrupted, or no workers are left.
    """
    case = CaseSpec(Case(CASE, pool.view_count, pool.view_count), pool, count)
    identity = identity_of(seed, _settings(pool), inputs)
    kept, drawn = sampling.run_one(identity, case, file=file, tell=tell, chunk=1 if pool.full else None)
    return kept.params[:count].reshape(-1, len(case_names(pool.errors)), len(QUANTITIES)), drawn


def check_unused(sampling: Sampling, *, predicts: bool) -> None:
    """Refuse a folder that holds a study already, unless it is gone on with."""
    sweeps = sorted((sampling.folder / SWEEPS_FOLDER).glob("*.sqlite"))
    for path in (sampling.path, sampling.folder / AGAINST_FILE, *sweeps):
        if path.exists() and predicts:
            raise InputError(f"{path}: the folder holds a study with draws; choose another -o for the prediction")
        if path.exists() and not sampling.resume:
            raise InputError(f"{path}: there is a study already; go on with it with --resume, or choose another -o")


def _settings(pool: DrawPool) -> dict[str, str]:
    """What decides a draw beside the seed."""
    setting, errors = pool.setting, pool.errors
    return {
        "study": KIND,
        "images": "yes" if pool.full else "no",
        **error_settings(errors),
        "model": setting.model,
        "options": repr(setting.options),
        "views": str(setting.view_count),
        "camera": _digest((json.dumps(setting.camera.to_json(), indent=2) + "\n").encode()),
        "poses": _digest(setting.cam_from_target.tobytes()),
        "noise": _digest(setting.noise_root.tobytes()),
        "bed": "",  # on its last face, as in all studies so far
    }


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]
