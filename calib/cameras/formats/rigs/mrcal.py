"""mrcal's camera models, a file for each camera: `rt_cam_ref` is its pose from the reference, in metres.

The reference is the rig's frame. Older files call the pose `extrinsics`.
"""

from collections.abc import Mapping

import numpy as np

from calib.cameras.formats import FORMATS
from calib.cameras.formats.format import ReadCamera
from calib.cameras.formats.mrcal import camera_of, literal, model_text
from calib.cameras.formats.parsing import numbers, required
from calib.cameras.formats.rigs.format import ReadRig, RigFiles, RigFormat, WrittenRig, assembled
from calib.cameras.formats.rigs.poses import vector_pose
from calib.core.se3 import log_rotation
from designer.base.arrays import Array

SUFFIX = ".cameramodel"
POSE = ("rt_cam_ref", "extrinsics")


def write(written: WrittenRig) -> Mapping[str, str]:
    """The texts for a rig, a file a camera."""
    turn = log_rotation(written.cam_from_rig[:, :3, :3])
    pose = np.concatenate([turn, written.cam_from_rig[:, :3, 3]], axis=1)
    each = zip(written.words, written.rig.cameras, written.lenses, pose.tolist(), strict=True)
    return {f"{word}{SUFFIX}": model_text(camera, lens, rt) for word, camera, lens, rt in each}


def read(files: RigFiles) -> ReadRig:
    """The rig of several models, named after their files."""
    found, poses = [], []
    for name, text in files.texts.items():
        camera, pose = _model(text, files.unit, files.origin_of(name))
        found.append(camera)
        poses.append(pose)
    names = [name.removesuffix(SUFFIX) for name in files.texts]
    return assembled(files, names, found, poses, "m")


def _model(text: str, unit: str, origin: str) -> tuple[ReadCamera, Array]:
    values = literal(text, origin)
    pose = numbers(required(values, POSE, origin), POSE[0], origin, (6,))
    return camera_of(values, origin), vector_pose(pose[:3], pose[3:], unit, origin)


FORMAT = RigFormat(
    name="mrcal",
    title="mrcal camera models",
    file_name="cameras",
    opens_with="mrcal-show-geometry {file}/*.cameramodel; the reference is the rig's frame",
    cameras=FORMATS["mrcal"],
    unit="m",
    write=write,
    read=read,
    patterns=(f"*{SUFFIX}",),
    has_own_unit=True,
)
