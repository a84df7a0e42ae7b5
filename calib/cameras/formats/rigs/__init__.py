"""Rig files of other tools behind one protocol.

A format is a file of this folder, which holds it as `FORMAT`, and a name in the list here. Files are loaded when used.
"""

from typing import TYPE_CHECKING

from calib.core.registry import Registry

if TYPE_CHECKING:
    from calib.cameras.formats.rigs.format import RigFormat

NAMES = ["json", "kalibr", "opencv", "colmap", "ros", "mrcal", "anipose", "caliscope"]
OWN_RIG = "json"
"""The program's own, which holds cameras of any model, and how sure they are."""

RIG_FORMATS: "Registry[RigFormat]" = Registry(__name__, "FORMAT", NAMES)
