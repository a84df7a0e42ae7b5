"""What was detected, as control points of programs that find cameras themselves: an entry here for each.

Such a program wants each point's place in each photo, and where it is in space. A pixel whose centre is (0, 0) here is
(0.5, 0.5) for those that count from the corner of an image. Help reads the names here, so NumPy is not loaded.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import PurePath, PureWindowsPath
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

from designer.base.errors import InputError
from designer.base.words import shown

if TYPE_CHECKING:
    from calib.core.types import Detections
    from designer.target import TargetGeometry

M_PER_MM = 0.001
CORNER = 0.5
"""A position counted from the image's corner, of a pixel whose centre is 0."""
LOCAL = "+proj=tmerc +lat_0=0 +lon_0=0 +k=1 +x_0=0 +y_0=0 +ellps=WGS84 +units=m +no_defs"
"""A projection that keeps lengths about the origin, for a program that wants points on the earth."""
DESCRIPTOR = 128
"""Numbers of a feature that say what it looks like; nobody asks where matches are given."""


@dataclass(frozen=True)
class MarkerFormat:
    """Files of one program."""

    title: str  # whose
    write: "Callable[[Sequence[Detections], TargetGeometry], dict[str, str]]"  # by name
    use: str  # what to do with them


def _places(target: "TargetGeometry") -> list[str]:
    """X, Y and Z of all points in metres."""
    return [f"{x!r} {y!r} {z!r}" for x, y, z in (M_PER_MM * target.center_mm).round(12).tolist()]


def _rows(seen: "Detections", offset: float) -> list[tuple[int, str, str]]:
    """Point, u and v."""
    u, v = (seen.center_px + offset).T.tolist()
    return [(ring, f"{x:.4f}", f"{y:.4f}") for ring, x, y in zip(seen.ring.tolist(), u, v, strict=True)]


def _metashape(found: "Sequence[Detections]", target: "TargetGeometry") -> dict[str, str]:
    """Its XML of markers; a photo is known by its label, which is its name without suffix."""
    labels = [PurePath(one.image).stem for one in found]
    (label, count), *_ = Counter(labels).most_common(1)
    if count > 1:
        raise InputError(f"{count} photos are labelled {shown(label)} there: names differ by the suffix alone; rename")
    names, places = target.point_names, _places(target)
    used = sorted({ring for one in found for ring in one.ring.tolist()})
    where: dict[int, list[str]] = {ring: [] for ring in used}
    for number, one in enumerate(found):
        for ring, u, v in _rows(one, CORNER):
            where[ring].append(f'<location camera_id="{number}" pinned="true" x="{u}" y="{v}"/>')
    cameras = "\n".join(f'      <camera id="{n}" label={quoteattr(label)}/>' for n, label in enumerate(labels))
    markers, locations = list[str](), list[str]()
    for number, ring in enumerate(used):
        x, y, z = places[ring].split()
        reference = f'<reference x="{x}" y="{y}" z="{z}" enabled="true"/>'
        markers.append(f'      <marker id="{number}" label="{names[ring]}">{reference}</marker>')
        inner = "\n            ".join(where[ring])
        locations.append(f'          <marker marker_id="{number}">\n            {inner}\n          </marker>')
    text = f"""<?xml version="1.0" encoding="UTF-8"?>
<document version="1.2.0">
  <chunk label={quoteattr(target.geometry_id)} enabled="true">
    <cameras next_id="{len(found)}" next_group_id="0">
{cameras}
    </cameras>
    <markers next_id="{len(used)}" next_group_id="0">
{chr(10).join(markers)}
    </markers>
    <frames next_id="1">
      <frame id="0">
        <markers>
{chr(10).join(locations)}
        </markers>
      </frame>
    </frames>
  </chunk>
</document>
"""
    return {"markers.xml": text}


def _realitycapture(found: "Sequence[Detections]", target: "TargetGeometry") -> dict[str, str]:
    """Measurements of control points in photos, and their places."""
    names, comma = target.point_names, [one for one in found if "," in one.image]
    if comma:
        raise InputError(f"{comma[0].image}: a name with a comma, which ends it there; rename the photo")
    lines = [f"{one.image},{names[ring]},{u},{v}" for one in found for ring, u, v in _rows(one, CORNER)]
    places = [f"{name},{place.replace(' ', ',')}" for name, place in zip(names, _places(target), strict=True)]
    return {
        "measurements.csv": "\n".join(["#image,point,x,y", *lines, ""]),
        "control_points.csv": "\n".join(["#name,x,y,alt", *places, ""]),
    }


def _odm(found: "Sequence[Detections]", target: "TargetGeometry") -> dict[str, str]:
    """Ground control points; it counts pixels from the centre of the first, as we do."""
    _require_no_space(found)
    names, places = target.point_names, _places(target)
    lines = [f"{places[ring]} {u} {v} {one.image} {names[ring]}" for one in found for ring, u, v in _rows(one, 0.0)]
    return {"gcp_list.txt": "\n".join([LOCAL, *lines, ""])}


def _colmap(found: "Sequence[Detections]", target: "TargetGeometry") -> dict[str, str]:
    """A file of features a photo, and which of any two photos are one point."""
    _require_no_space(found)
    files, rest = {}, " 1 0" + DESCRIPTOR * " 0"
    for one in found:
        if (path := PureWindowsPath(one.image)).anchor or ".." in path.parts:
            raise InputError(f"{shown(one.image)}: its file would lie outside the folder; rename the photo")
        lines = [f"{u} {v}{rest}" for _, u, v in _rows(one, CORNER)]
        files[f"features/{one.image}.txt"] = "\n".join([f"{len(lines)} {DESCRIPTOR}", *lines, ""])
    matches, row = list[str](), [{ring: k for k, ring in enumerate(one.ring.tolist())} for one in found]
    for (one, here), (other, there) in combinations(zip(found, row, strict=True), 2):
        if pairs := [f"{here[ring]} {there[ring]}" for ring in here if ring in there]:
            matches += [f"{one.image} {other.image}", *pairs, ""]
    return {**files, "matches.txt": "\n".join([*matches, ""])}


def _require_no_space(found: "Sequence[Detections]") -> None:
    """Names of photos are words there."""
    for one in found:
        if len(one.image.split()) != 1 or one.image.startswith("#"):
            raise InputError(f"{shown(one.image)}: a photo's name with a space, which ends it there; rename the photo")


MARKER_FORMATS: Mapping[str, MarkerFormat] = {
    "metashape": MarkerFormat(
        "Metashape: markers with their places in photos, in m", _metashape,
        "add the photos, then File > Import > Import Markers; labels of photos are names without suffix",
    ),
    "realitycapture": MarkerFormat(
        "RealityCapture, RealityScan: measurements and control points, in m", _realitycapture,
        "add the photos, import control_points.csv as Ground Control (Name, X, Y, Alt), then measurements.csv as "
        "Control Points (Image, Point, X, Y)",
    ),
    "odm": MarkerFormat(
        "OpenDroneMap and WebODM: gcp_list.txt, in m", _odm,
        "upload it with the photos; the target's frame stands at latitude and longitude 0",
    ),
    "colmap": MarkerFormat(
        "COLMAP: features and matches, no places in space", _colmap,
        "colmap feature_importer --import_path features, then matches_importer --match_list_path matches.txt "
        "--match_type raw",
    ),
}  # fmt: skip
"""By what `--to` calls them."""
