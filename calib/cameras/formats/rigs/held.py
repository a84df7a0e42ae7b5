"""A rig as a format's files hold its cameras, and what that loses."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.cameras.formats.holding import Held, lost_of
from calib.cameras.formats.rigs import OWN_RIG
from calib.cameras.formats.rigs.format import RigFormat
from calib.cameras.rig import Rig
from calib.core.se3 import compose, make_pose


def rig_as_held(rig: Rig, held: Sequence[Held]) -> Rig:
    """The rig with its cameras as files hold them: poses of those whose frames were turned turn with them."""
    cameras = tuple(one.camera for one in held)
    if cameras == rig.cameras:  # the very same: what is known of their numbers stays
        return rig
    turns = [np.eye(3) if one.refit is None else one.refit.new_from_old for one in held]
    poses = compose(np.stack([make_pose(turn, np.zeros(3)) for turn in turns]), rig.cam_from_rig)
    return replace(rig, cameras=cameras, cam_from_rig=poses, covariance=None)


def lost_of_rig(rig: Rig, held: Sequence[Held], target: RigFormat) -> tuple[str, ...]:
    """What files do not say that a rig knew, a line each."""
    lost = []
    for name, camera, one in zip(rig.names, rig.cameras, held, strict=True):
        lost += [f"of {name}: {line}" for line in lost_of(camera, one, target.cameras)]
    kinds = {(camera.model, one.lens.is_wide) for camera, one in zip(rig.cameras, held, strict=True)}
    if len({model for model, _ in kinds}) < len(kinds):
        each = ", ".join(f"{name} {one.lens.name}" for name, one in zip(rig.names, held, strict=True))
        lost.append(f"that cameras are of one model, as they get lenses of two kinds: {each}")
    if target.name == OWN_RIG:
        is_gone = rig.covariance is not None and rig_as_held(rig, held).covariance is None
        return (*lost, *(("how sure it all is",) if is_gone else ()))
    if rig.covariance is not None:
        lost.append("how sure it all is, which rig.json keeps")
    if rig.delay_s is not None:
        lost.append("the delays of the cameras' time stamps")
    if not target.keeps_frame and not np.array_equal(rig.cam_from_rig[0], np.eye(4)):
        whose = f" ({rig.rig_frame})" if rig.rig_frame and rig.rig_frame not in rig.names else ""
        lost.append(f"the rig's frame{whose}; the files' is that of camera {rig.names[0]}")
    written = target.words(rig.names)
    if written != rig.names:
        lost.append(f"the cameras' names; they are called {', '.join(written[:4])}{', ...' * (len(written) > 4)}")
    return tuple(lost)
