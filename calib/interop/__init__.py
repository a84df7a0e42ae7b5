"""Camera files of other tools, one format a file; a new format is one file and one line here."""

from collections.abc import Mapping
from types import MappingProxyType

from calib.interop.colmap import COLMAP
from calib.interop.format import CameraFormat, ReadCamera
from calib.interop.kalibr import KALIBR
from calib.interop.metashape import METASHAPE
from calib.interop.mrcal import MRCAL
from calib.interop.opencv_yaml import OPENCV
from calib.interop.own_json import JSON
from calib.interop.ros import ROS

__all__ = ["FORMATS", "CameraFormat", "ReadCamera"]

FORMATS: Mapping[str, CameraFormat] = MappingProxyType(
    {one.name: one for one in (JSON, MRCAL, METASHAPE, KALIBR, ROS, OPENCV, COLMAP)}
)
"""By name; in the order in which a file of unknown kind is tried, the more particular first."""
