"""Anipose's calibration.toml, which aniposelib and programs around it read: a table for each camera.

Lengths are in the unit of the board that it was calibrated with, which the file does not say.
"""

import re
from collections.abc import Mapping
from dataclasses import replace

from calib.cameras.formats import FORMATS
from calib.cameras.formats.format import ReadRig, RigFiles, RigFormat, WrittenRig, assembled
from calib.cameras.formats.poses import unit_said
from calib.cameras.formats.toml_cameras import LENSES, camera_lines, parse_toml, read_camera_table
from designer.base.errors import InputError

METADATA, UNIT = "metadata", "length_unit"


def write_rig(written: WrittenRig) -> Mapping[str, str]:
    """The text for a rig."""
    each = zip(written.words, written.rig.cameras, written.lenses, written.cam_from_rig, strict=True)
    tables = (
        f'[cam_{row}]\nname = "{word}"\n{camera_lines(camera, lens, pose)}\n'
        for row, (word, camera, lens, pose) in enumerate(each)
    )
    return {RIG_FORMAT.file_name: f'{"".join(tables)}[{METADATA}]\n{UNIT} = "{written.unit}"\n'}


def read_rig(files: RigFiles) -> ReadRig:
    """The rig of a text; a camera is called what it says, or else as its table."""
    (text,), origin = files.texts.values(), files.origin
    tables = parse_toml(text, origin)
    cameras = {key: one for key, one in tables.items() if isinstance(one, dict) and "matrix" in one}
    if not cameras:
        raise InputError(f"{origin}: holds no camera")
    metadata = tables.get(METADATA)
    unit = unit_said(metadata.get(UNIT) if isinstance(metadata, dict) else None, origin)
    common = {key: one for key, one in tables.items() if key not in cameras}
    both = [read_camera_table(one, unit or files.unit, f"{origin}: {key}", common) for key, one in cameras.items()]
    names = [str(one.get("name", key)) for key, one in cameras.items()]
    return assembled(files, names, [one for one, _ in both], [pose for _, pose in both], unit)


RIG_FORMAT = RigFormat(
    name="anipose",
    title="Anipose calibration",
    file_name="calibration.toml",
    opens_with='in Python: aniposelib.cameras.CameraGroup.load("{file}")',
    cameras=replace(FORMATS["opencv"], title="Anipose calibration", lenses=LENSES),
    unit="mm",
    write=write_rig,
    read=read_rig,
    recognised=re.compile(r"\A(?=(?s:.*?)^matrix\s*=)(?=(?s:.*?)^rotation\s*=)(?!(?s:.*?)^\[cameras\.)", re.MULTILINE),
)
