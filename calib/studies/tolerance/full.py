"""One draw with real images: every case is rendered, detected and calibrated, as a person's photos are."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.core.parallel import one_thread
from calib.core.types import Detections
from calib.detector.pipeline import detect
from calib.renderer.options import RenderOptions
from calib.renderer.scene import scene_from_target
from calib.renderer.view import render_view
from calib.studies.tolerance.draw import drawn_values, solved, stream
from calib.studies.tolerance.measures import NONE, true_shape
from calib.studies.tolerance.seen import CONTRAST_TO_NOISE, LEAST_RINGS
from calib.studies.tolerance.setting import Setting, setting_of_observations
from designer.base.errors import InputError
from designer.target import TargetGeometry
from designer.tolerance.model import ErrorModel, displaced_shape
from designer.tolerance.shape import target_of

Array = NDArray[np.float64]

PHOTOS = RenderOptions(blur_px=0.7, contrast_to_noise=CONTRAST_TO_NOISE)
"""Photos of a good camera, whose detections the noise of the other draws was fitted to."""


@one_thread
def run_full_draws(setting: Setting, errors: ErrorModel, seed: int, numbers: range) -> Array:
    """The quantities of some draws, as `calib.studies.tolerance.draw.run_draws` has them.  # (D, C, Q)

    The errors are those of the draws without images; the noise is of the photos' pixels, the same in all cases.

    Args:
        setting: what is photographed.
        errors: of the target.
        seed: of the study.
        numbers: of the draws.
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

    Raises:
        InputError: they do not determine the camera.
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
