"""A rig as it might be: with more frames, other baselines, another camera. Budgets of it tell what that would buy."""

from dataclasses import dataclass, replace

import numpy as np

from calib.cameras.rig import Rig
from calib.core.linear_algebra import symmetric_inverse
from calib.core.se3 import make_pose, rotation_between
from calib.space.budget import over_volume, position_errors, shape_errors
from calib.space.error_size import PointErrors
from calib.space.volume import WorkingVolume
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError


@dataclass(frozen=True)
class ChangedRig:
    """What a change of a rig would do."""

    change: str
    assumes: str
    position: PointErrors
    shape: PointErrors
    share: float  # of the volume that enough cameras see


def with_frames(rig: Rig, times: float) -> Rig:
    """Calibrated from so many times as many frames of the same kind: `with_frames(rig, 4)`."""
    return rig if rig.covariance is None else replace(rig, covariance=rig.covariance / times)


def with_baseline(rig: Rig, times: float) -> Rig:
    """All cameras so many times as far from their middle, looking where they look, as surely known."""
    middle = rig.center_mm.mean(axis=0)
    rotation = rig.cam_from_rig[:, :3, :3]
    shift = -np.einsum("cij,cj->ci", rotation, middle + times * (rig.center_mm - middle))
    return replace(rig, cam_from_rig=make_pose(rotation, shift))


def with_camera(rig: Rig, like: int, eye_mm: Array, aim_mm: Array, name: str = "another") -> Rig:
    """One more camera like one of the rig's, calibrated with the others as that one is.

    Args:
        rig: to add it to.
        like: the row of the camera that it is like, whose own axes it has but for the smallest turn.
        eye_mm: where it is.  # (3,)
        aim_mm: where it looks.  # (3,)
        name: of it.
    """
    frame = rig.rig_from_cam[like, :3, :3]
    ahead = (aim_mm - eye_mm) / np.linalg.norm(aim_mm - eye_mm)
    rotation = (rotation_between(frame[:, 2], ahead) @ frame).T
    covariance = rig.covariance
    if covariance is not None:
        covariance = _with_one_like(covariance, np.arange(rig.first_row[like], rig.first_row[like + 1]))
    while name in rig.names:
        name += "'"
    return replace(
        rig, names=(*rig.names, name), cameras=(*rig.cameras, rig.cameras[like]),
        cam_from_rig=np.concatenate([rig.cam_from_rig, make_pose(rotation, -rotation @ eye_mm)[None]]),
        covariance=covariance, noise_px=None if rig.noise_px is None else np.append(rig.noise_px, rig.noise_px[like]),
        delay_s=None,
    )  # fmt: skip


def _with_one_like(covariance: Array, own: Rows) -> Array:
    """The covariance with unknowns more, which go with all others as those of the rows `own` do.

    A camera is calibrated together with the others: what its pose owes to their lenses it shares with them. So the new
    errors are those that the others' let expect of `own`, and as much that is theirs alone.
    """
    others = np.setdiff1d(np.arange(len(covariance)), own)
    expected: Array = covariance[np.ix_(own, others)] @ symmetric_inverse(covariance[np.ix_(others, others)]).inverse
    across = np.empty((len(own), len(covariance)))
    across[:, others] = covariance[np.ix_(own, others)]
    across[:, own] = expected @ covariance[np.ix_(others, own)]
    return np.block([[covariance, across.T], [across, covariance[np.ix_(own, own)]]])


def _one_above(rig: Rig, volume: WorkingVolume) -> Rig | None:
    """The rig with a camera more, as far above its middle as its cameras are apart, that looks into the volume."""
    center = rig.center_mm
    middle, aim = center.mean(axis=0), np.asarray(volume.rig_from_volume[:3, 3])
    if volume.near_mm == 0 or volume.is_ahead:
        local = (volume.low_mm + volume.high_mm) / 2
        aim = volume.rig_from_volume[:3, :3] @ local + volume.rig_from_volume[:3, 3]
    apart = float(np.linalg.norm(center[:, None] - center, axis=2).max())
    up = -volume.rig_from_volume[:3, 1] if volume.is_ahead else _across(center, rig)
    eye = middle + apart * up
    if not apart > 0 or np.linalg.norm(aim - eye) < 1e-6:
        return None
    return with_camera(rig, len(center) - 1, eye, aim)


def _across(center: Array, rig: Rig) -> Array:
    """The direction in which cameras stand least, upwards as they have it."""
    axis = np.linalg.svd(center - center.mean(axis=0))[2][2]
    up: Array = axis * (-1.0 if axis @ rig.rig_from_cam[:, :3, 1].mean(axis=0) > 0 else 1.0)
    return up


def what_ifs(rig: Rig, volume: WorkingVolume, noise_px: Array, seen_by: int) -> tuple[ChangedRig, ...]:
    """What changes of a rig would buy, where it sees the volume as it is and changed."""
    changes: dict[str, tuple[str, Rig | None, Array]] = {
        "four times as many frames": (
            "the covariance is a quarter: true of noise, not of errors of the target, which more frames leave",
            with_frames(rig, 4), noise_px,
        ),
        "centres twice as sure": ("half the noise when measuring; the rig as it is", rig, noise_px / 2),
        "one and a half times the baseline": (
            "each camera's position and rotation are as sure as now", with_baseline(rig, 1.5), noise_px,
        ),
        "one camera more": (
            f"like {rig.names[-1]}, as well calibrated, above the others, looking into the volume",
            _one_above(rig, volume), np.append(noise_px, noise_px[-1]),
        ),
    }  # fmt: skip
    return tuple(
        told
        for change, (assumes, changed, noise) in changes.items()
        if changed is not None and (told := _told(change, assumes, changed, rig, volume, noise, seen_by)) is not None
    )


def _told(
    change: str, assumes: str, rig: Rig, unchanged: Rig, volume: WorkingVolume, noise_px: Array, seen_by: int
) -> ChangedRig | None:
    try:
        expected, share = over_volume(rig, volume, noise_px, seen_by, unchanged)
    except InputError:  # it would see nothing of the volume
        return None
    return ChangedRig(change, assumes, position_errors(expected), shape_errors(expected), share)
