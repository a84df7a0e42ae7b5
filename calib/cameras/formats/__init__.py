"""Camera files of other tools behind one protocol.

A format is a file of this folder, which holds it as `FORMAT`, and a name in the list here. Files are loaded when used.
"""

from typing import TYPE_CHECKING

from calib.core.registry import Registry

if TYPE_CHECKING:
    from calib.cameras.formats.format import CameraFormat

NAMES = ["json", "basalt", "mrcal", "metashape", "kalibr", "ros", "opencv", "colmap"]
"""In the order in which a file of unknown kind is tried, the more particular first."""
OWN = "json"
"""The program's own, which holds a camera of any model."""

FORMATS: "Registry[CameraFormat]" = Registry(__name__, "FORMAT", NAMES)
