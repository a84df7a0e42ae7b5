"""Caliscope's camera_array.toml: a table for each camera, whose name is a number; lengths are in metres."""

import re
from collections.abc import Mapping
from dataclasses import replace

from calib.cameras.formats import FORMATS
from calib.cameras.formats.anipose import LENSES, camera_lines, parse_toml, read_camera_table
from calib.cameras.formats.parsing import mapping
from calib.cameras.formats.rig_format import ReadRig, RigFiles, RigFormat, WrittenRig, assembled
from designer.base.errors import InputError


def numbered(names: tuple[str, ...]) -> tuple[str, ...]:
    """The names where they are numbers, else the cameras' places in the rig."""
    is_number = all(re.fullmatch(r"0|[1-9][0-9]{0,5}", name) for name in names)
    return names if is_number else tuple(map(str, range(len(names))))


def write_rig(written: WrittenRig) -> Mapping[str, str]:
    """The text for a rig; its tables are called by numbers."""
    each = zip(written.words, written.rig.cameras, written.lenses, written.cam_from_rig, strict=True)
    tables = (
        f"[cameras.{number}]\ncam_id = {number}\nrotation_count = 0\nignore = false\n{camera_lines(camera, lens, pose)}"
        for number, camera, lens, pose in each
    )
    return {RIG_FORMAT.file_name: "\n".join(tables)}


def read_rig(files: RigFiles) -> ReadRig:
    """The rig of a text, of the cameras that have a pose and are not to be ignored."""
    (text,), origin = files.texts.values(), files.origin
    document = parse_toml(text, origin)
    tables = mapping(document.get("cameras", {}), "cameras", origin)
    common = {key: one for key, one in document.items() if key != "cameras"}
    used, remarks = {}, []
    for key, one in tables.items():
        values = mapping(one, "a camera", f"{origin}: cameras.{key}")
        if values.get("ignore") is True or "rotation" not in values or "translation" not in values:
            why = "is to be ignored" if values.get("ignore") is True else "has no pose"
            remarks.append(f"camera {key} {why}, so it is left out")
        else:
            used[key] = values
    if not used:
        raise InputError(f"{origin}: holds no camera with a pose")
    both = [read_camera_table(one, files.unit, f"{origin}: cameras.{key}", common) for key, one in used.items()]
    return assembled(files, list(used), [one for one, _ in both], [pose for _, pose in both], "m", None, remarks)


RIG_FORMAT = RigFormat(
    name="caliscope",
    file_name="camera_array.toml",
    opens_with="put it in the folder of a Caliscope project, as camera_array.toml",
    cameras=replace(FORMATS["opencv"], title="Caliscope camera array", lenses=LENSES),
    unit="m",
    write=write_rig,
    read=read_rig,
    recognised=re.compile(r"^\[cameras\.", re.MULTILINE),
    words=numbered,
)
