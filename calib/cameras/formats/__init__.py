"""Camera and rig files of other tools behind one protocol each.

A format is a file of this folder, which holds it as `FORMAT` for a camera and as `RIG_FORMAT` for a rig, and a name in
the lists here. Files are loaded when used.
"""

from typing import TYPE_CHECKING

from calib.core.registry import Registry

if TYPE_CHECKING:
    from calib.cameras.formats.format import CameraFormat
    from calib.cameras.formats.rig_format import RigFormat

NAMES = [
    *("json", "photonvision", "gyroflow", "nerfstudio", "depthai", "realsense", "orbslam", "vins", "matlab"),
    *("basalt", "mrcal", "metashape", "kalibr", "ros", "opencv", "colmap"),
]
"""In the order in which a file of unknown kind is tried, the more particular first."""
RIG_NAMES = [
    *("json", "depthai", "orbslam", "matlab", "kalibr", "opencv", "colmap", "ros", "mrcal", "anipose", "caliscope")
]
ONLY_READ, RIGS_ONLY_READ = ["zed", "azure_kinect", "ocamcalib"], ["zed", "azure_kinect"]
"""Of makers, whose cameras take no other file."""
ONLY_WRITTEN = ["lut"]
"""For programs, and less than a camera."""
ACCEPTED_PX = 0.1
"""A fit of a program's own choosing, in reading or in writing, that is off by more is refused, unless it is allowed."""
OWN = "json"
"""The program's own, which holds cameras of any model, and how sure a rig is."""

FORMATS: "Registry[CameraFormat]" = Registry(__name__, "FORMAT", NAMES)
RIG_FORMATS: "Registry[RigFormat]" = Registry(__name__, "RIG_FORMAT", RIG_NAMES)
WRITTEN_FORMATS: "Registry[CameraFormat]" = Registry(__name__, "FORMAT", [*NAMES, *ONLY_WRITTEN])
READ_FORMATS: "Registry[CameraFormat]" = Registry(__name__, "FORMAT", [*NAMES, *ONLY_READ])
READ_RIG_FORMATS: "Registry[RigFormat]" = Registry(__name__, "RIG_FORMAT", [*RIG_NAMES, *RIGS_ONLY_READ])
"""All that are written, and all that are read, which are more than those that are both."""
