"""What the photos of a rig share beyond noise, and how much less sure the rig is by it.

    found = with_shared_errors(found)
    found.stated_covariance, found.remarks

As `calib.solver.capture_error` and `calib.solver.image_field` have it for one camera. What is alike in all photos of a
camera is a parameter more of that camera, beside the cameras' own, their places and the frames' poses. Those beyond
chance are named if they explain all that frames share and leave no field in the image, and what leaving them out did
is added. Then the scores of frames are compared, since the photos of a frame share the target's pose.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from calib.cameras.surface import surface_model
from calib.core.linear_algebra import pseudo_inverse
from calib.core.parallel import one_thread
from calib.rigs.result import RigCalibration
from calib.rigs.target_error import posed_frames, posed_priors, some_frames
from calib.rigs.variance_components import DISAGREES
from calib.solver.capture_error import KINDS, kinds_that_count, moved_px, weigh
from calib.solver.free_shape import PosedSightings, extra_of, free_directions
from calib.solver.image_field import shared_by_photos, with_image_field
from designer.base.arrays import Array
from designer.base.words import figure, printable


@one_thread
def with_shared_errors(found: RigCalibration) -> RigCalibration:
    """The rig with what its photos share, named and in its stated covariance; the solution stays.

    As it was where each photo may have a pose of its own, which tells the same, and of a rig with time offsets, on a
    carrier, or with a lens of many parameters.
    """
    basis = free_directions(found.covariance)
    has_more = found.slack is not None or found.carrier is not None or found.delay_s is not None
    has_many = any(one.learned is not None or surface_model(one.model) is not None for one in found.cameras)
    if found.status != "converged" or has_more or has_many or not basis.size:
        return found
    counts, frames = kinds_that_count(found.observations.points), some_frames(found)
    moved = [counts * moved_px(one) for one in found.alone]
    part, more = len(frames) / found.observations.frame_count, sum(one.shape[2] for one in moved)

    def posed() -> Iterable[PosedSightings]:
        return chain(posed_frames(found, basis, frames, moved), posed_priors(found, basis, frames, more))

    captured, amplitude, taken = _captured(found, posed(), basis, moved)
    to_q, inner = pseudo_inverse(basis), basis.shape[1]
    off = np.concatenate([-to_q @ taken @ amplitude, amplitude])
    rest = (
        replace(view, by_camera=view.by_camera[:, :, :inner], residual=view.residual + view.by_camera @ off[:, None])
        for view in posed()
    )
    shared = shared_by_photos(rest, to_q @ captured.stated_covariance @ to_q.T / part)
    if shared is None:
        return captured
    times, more = shared
    said = (
        "centres of a frame's photos err together, so that standard deviations are "
        f"{figure(times, 2)} times (RMS) those by independent errors, which is in them"
    )
    covariance = part * (basis @ more) @ (basis @ more).T
    # Causes that leave something over are none, or not all: as a camera that was pushed is like lenses that change.
    return replace(captured, photo_covariance=covariance, remarks=(*found.remarks, said))


def _captured(
    found: RigCalibration, posed: Iterable[PosedSightings], basis: Array, moved: Sequence[Array]
) -> tuple[RigCalibration, Array, Array]:
    """With what is alike in all photos of a camera, if that is beyond chance; how much, and what the rig took of it.

    Amplitudes (C K,), and what a unit of each did to the rig (N, C K).
    """
    names, kinds = found.observations.camera_names, len(KINDS)
    nothing = found, np.zeros(len(names) * kinds), np.zeros((len(basis), len(names) * kinds))
    if found.alone_scale is not None and (found.scale > DISAGREES * found.alone_scale).any():
        return nothing  # what does not fit together looks like anything
    inner = basis.shape[1]
    views = ((replace(view, by_camera=view.by_camera[:, :, :inner]), view.by_camera[:, :, inner:]) for view in posed)
    told = extra_of(views, basis, len(names) * kinds)
    weighed = None if told is None else weigh(told, np.zeros(len(names) * kinds))
    if told is None or weighed is None or not weighed.sure:
        return nothing
    sigma, said = np.sqrt(np.diagonal(weighed.covariance)), []
    mean = weighed.mean.reshape(len(names), kinds)
    sure = np.isin(np.arange(mean.size), weighed.sure).reshape(mean.shape)
    for row in weighed.sure:
        name, kind = names[row // kinds], KINDS[row % kinds]
        if not _is_as_stated(found, row // kinds, moved[row // kinds] @ (mean * sure)[row // kinds]):
            continue  # what leaves a field in the image over is no cause
        said.append(
            f"the photos of {printable(name)} show what looks like {kind.name}: {figure(weighed.mean[row], 2)} ± "
            f"{figure(sigma[row], 1)} {kind.unit}, if nothing was moved; what it did is in the standard deviations; "
            f"{kind.remedy}"
        )
    square = weighed.covariance + np.outer(weighed.mean, weighed.mean)
    covariance = told.taken @ square @ told.taken.T
    return replace(found, capture_covariance=covariance, remarks=(*found.remarks, *said)), weighed.mean, told.taken


def _is_as_stated(found: RigCalibration, camera: int, moved_px: Array) -> bool:
    """Whether what a cause leaves over of a camera's sightings (M, 2) is their noise, and no field in the image."""
    alone = found.alone[camera]
    return with_image_field(replace(alone, residual_px=alone.residual_px + moved_px)).image_field is None
