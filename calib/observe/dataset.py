"""`detections.csv` and the records beside it: what was seen in a set of photos, to keep and to calibrate from.

One line a feature, after comment lines that hold the ids and the size of each image. Which features were expected,
and why some are missing, is in the records: what happened to each photo. Both are plain text.
"""

import io
import json
import math
import re
import tempfile
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np

from calib.core.csv_table import ANY_NAME, CsvTable, csv_cell, is_covariance, read_table, read_text, require_version
from calib.core.types import Detections, FaceRecord
from designer.base.answer import program
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.file_kind import FileKind
from designer.base.files import write_files
from designer.base.marks import AtLeast, Hash
from designer.base.own_files import require_ours
from designer.target import TargetGeometry


@dataclass(frozen=True)
class ImageRecord:
    """What happened to one photo: the target found, not found, or the photo not read."""

    image: str
    image_size: tuple[int, int] | None  # width, height in px; None: it could not be read
    features: int
    rejected: int  # ring-like things that got no name
    faces: tuple[FaceRecord, ...]
    remarks: tuple[str, ...]
    failure: str = ""  # why it could not be read or searched
    motion_px: Annotated[float, AtLeast(0)] = 0.0  # see `Detections`
    time_s: float | None = None  # likewise

    @property
    def named(self) -> tuple[FaceRecord, ...]:
        """The faces that were named."""
        return tuple(face for face in self.faces if face.face is not None)

    @property
    def expected(self) -> int:
        """How many features of these faces could have been measured."""
        return sum(face.measurable for face in self.named)

    @property
    def missing(self) -> Counter[str]:
        """Why features of these faces are missing: how many of each reason."""
        missing = Counter[str]()
        for face in self.named:
            missing.update(dict(face.missing))
        return missing


@dataclass(frozen=True)
class Records:
    """What happened to each photo of a run."""

    detector: str  # program and version
    layout_id: Hash
    geometry_id: Hash
    images: tuple[ImageRecord, ...]
    rendered_id: Hash = ""  # of the geometry that the photos were rendered of; "": real photos


RECORDS = FileKind(Records, "records", "a records file", "detect again", largest_bytes=256 * 2**20)


def image_record(seen: Detections) -> ImageRecord:
    """The record of a photo that was searched."""
    rejected = 0 if seen.rejected_px is None else len(seen.rejected_px)
    return ImageRecord(
        seen.image, seen.image_size, len(seen.ring), rejected, seen.faces, seen.remarks, motion_px=seen.motion_px,
        time_s=seen.time_s,
    )  # fmt: skip


def median_sigma_px(seen: Detections) -> float:
    """Median of the centres' standard deviations, along their worse axis; nan without centres."""
    if not len(seen.ring):
        return math.nan
    return float(np.median(np.sqrt(np.linalg.eigvalsh(seen.cov_px2)[:, 1])))


def common_remarks(remarks: Sequence[Sequence[str]]) -> tuple[str, ...]:
    """What is remarked of each of several photos, to be said once."""
    if len(remarks) < 2:
        return ()
    return tuple(remark for remark in dict.fromkeys(remarks[0]) if all(remark in each for each in remarks))


def records_path(detections: Path) -> Path:
    """Where the records of a `NAME.csv` lie: NAME.records.json."""
    return detections.with_suffix(".records.json")


VERSION = 1
KIND = "ringsolid.detections"
FIRST_LINE = f"# ringsolid detections, version {VERSION}"
COLUMNS = ("image", "face", "ring", "i", "j", "u", "v", "suu", "suv", "svv", "X", "Y", "Z")
EDGE_COLUMNS = ("major", "minor", "angle", "ratio", "blur")
"""Of `Detections.edges`, after these where all are known: semi-axes of the contour (px), angle of the major (rad),
inner over outer radius (0 of a dot), standard deviation of the blur (px)."""
MAX_SIDE_PX = 1_000_000

_COVARIANCE_FORMAT = ".5e"
_IMAGE_LINE = re.compile(r'# image (\d{1,7}) x (\d{1,7}) px (".*")')
_ID_LINE = re.compile(r"# (layout_id|geometry_id|detector) (\S.*)")


def check_output(path: Path) -> None:
    """Refuse a place that cannot be written, or holds something else, before any work is done.

    Raises:
        InputError: not a .csv, a folder, an existing file of another kind, or a folder that takes no files.
    """
    if path.suffix.lower() != ".csv":
        raise InputError(f"{path}: detections are a .csv file; name it so, such as {path.with_suffix('.csv').name}")
    require_ours(path, kind=KIND)
    require_ours(records_path(path), kind=RECORDS.format)
    try:
        folder = next(parent for parent in path.absolute().parents if parent.exists())
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}; choose another place with -o") from None


def write_detections(
    path: Path,
    seen: Sequence[Detections],
    target: TargetGeometry,
    *,
    failed: Iterable[ImageRecord] = (),
    rendered_id: str = "",
) -> Records:
    """Write `NAME.csv` and `NAME.records.json`, both or none. Features that a reader would refuse are left out.

    Returns:
        What the records hold.

    Raises:
        InputError: they cannot be written.
        ValueError: detections of another layout, or two of one image.
    """
    seen = [_storable(one) for one in seen]
    images = (*map(image_record, seen), *failed)
    records = Records(program(), target.layout_id, target.geometry_id, images, rendered_id=rendered_id)
    text = detections_to_csv(seen, target)
    write_files({records_path(path): RECORDS.text(records), path: text.encode("utf-8", ANY_NAME)})
    return records


def detections_to_csv(seen: Sequence[Detections], target: TargetGeometry) -> str:
    """The text of `detections.csv`."""
    stream = io.StringIO(newline="")
    stream.write(f"{FIRST_LINE}\n# layout_id {target.layout_id}\n# geometry_id {target.geometry_id}\n")
    stream.write(f"# detector {program()}\n# u v in px, (0, 0) is the centre of the top-left pixel; X Y Z in mm\n")
    if len({one.image for one in seen}) < len(seen):
        raise ValueError("two images have the same name")
    for one in seen:
        if one.layout_id != target.layout_id:
            raise ValueError(f"{one.image}: named with layout {one.layout_id}, not {target.layout_id}")
        stream.write(f"# image {one.image_size[0]} x {one.image_size[1]} px {json.dumps(one.image)}\n")
    with_edges = all(np.isfinite(one.edges).all() for one in seen)
    stream.write(",".join((*COLUMNS, *EDGE_COLUMNS) if with_edges else COLUMNS) + "\n")
    for one in seen:
        ring = one.ring
        numbers = [
            *((f"{n}" for n in column) for column in (target.ring_face[ring], ring, *target.ring_index[ring].T)),
            *((f"{x:.6f}" for x in column) for column in one.center_px.T),
            *((f"{x:{_COVARIANCE_FORMAT}}" for x in column) for column in one.cov_px2.reshape(-1, 4)[:, [0, 1, 3]].T),
            *((f"{x:.6f}" for x in column) for column in target.center_mm[ring].T),
            *((f"{x:.5f}" for x in column) for column in (one.edges.T if with_edges else ())),
        ]
        name = csv_cell(one.image)
        stream.writelines(f"{name},{','.join(row)}\n" for row in zip(*numbers, strict=True))
    return stream.getvalue()


def _checked_edges(table: CsvTable, center_px: Array) -> tuple[Array, Array]:
    """Ellipses (N, 5), ratio and blur (N, 2); nan where a file has no such columns."""
    if EDGE_COLUMNS[0] not in table.cells:
        return np.full((len(center_px), 5), np.nan), np.full((len(center_px), 2), np.nan)
    major, minor, angle, ratio, blur = (table.reals(name) for name in EDGE_COLUMNS)
    table.require((minor > 0) & (major >= minor) & (major <= MAX_SIDE_PX), "major and minor must be semi-axes in px")
    table.require(np.abs(angle) <= math.tau, "angle must be in radians")
    table.require((ratio >= 0) & (ratio < 1), "ratio must be 0 (a dot) to 1")
    table.require((blur >= 0) & (blur <= MAX_SIDE_PX), "blur must be a standard deviation in px")
    return np.column_stack([center_px, major, minor, angle]), np.column_stack([ratio, blur])


def _storable(one: Detections) -> Detections:
    """The detections without the features that a reader would refuse, and a remark on them.

    The covariances are judged as they are written: rounding may make one singular.
    """
    rounded = [float(f"{x:{_COVARIANCE_FORMAT}}") for x in one.cov_px2.ravel().tolist()]
    _, place, count = np.unique(one.ring, return_inverse=True, return_counts=True)
    ok = is_covariance(np.array(rounded).reshape(-1, 2, 2)) & (count[place] == 1)
    ok &= np.hypot(*one.center_px.T) <= MAX_SIDE_PX  # false if not finite
    if ok.all():
        return one
    remark = f"{(~ok).sum()} left out: centre or covariance is no usable number, or named twice"
    return replace(one.keep(ok), remarks=(*one.remarks, remark))


def read_detections(path: Path, target: TargetGeometry, *, target_path: Path) -> tuple[Detections, ...]:
    """Read `detections.csv` for a target with the same layout: each photo's, with contours if the file has them.

    X, Y, Z come from the target, not from this file; faces and what is remarked of a photo, from the records beside it.

    Raises:
        InputError: not a detections file, of another version or layout, or a line that breaks a rule; it names the
            file and the line, and the target's file where the two do not fit.
    """
    text, ids, sizes = read_text(path, "a detections file"), dict[str, str](), dict[str, tuple[int, int]]()
    require_version(path, text.partition("\n")[0].strip(), FIRST_LINE, "not a detections file")

    def comment(number: int, line: str) -> None:
        if match := _ID_LINE.fullmatch(line):
            ids[match[1]] = match[2].lower()  # hexadecimal; of any case
        elif line.startswith("# image "):
            name, size = _image_line(path, number, line)
            if name in sizes:
                raise InputError(f"{path}: line {number}: the image {name!r} a second time; names must differ")
            sizes[name] = size

    known, wanted = (COLUMNS, (*COLUMNS, *EDGE_COLUMNS)), f"the columns must be {','.join(COLUMNS)}"
    table = read_table(path, text, lambda names: "" if names in known else wanted, comment=comment)
    for name in ("layout_id", "geometry_id"):
        if name not in ids:
            raise InputError(f"{path}: no line '# {name} ...' above the column names; detect again")
    layout_id, geometry_id = ids["layout_id"], ids["geometry_id"]
    if layout_id != target.layout_id:
        raise InputError(
            f"{path}: made with a target of layout {layout_id}, but {target_path} has {target.layout_id}; "
            "give the target that the photos show"
        )
    ring, last = table.whole_numbers("ring"), target.ring_count - 1
    table.require((ring >= 0) & (ring <= last), f"ring is out of range; the target has the rings 0..{last}")
    for name, expected in (("face", target.ring_face), ("i", target.ring_index[:, 0]), ("j", target.ring_index[:, 1])):
        table.require(table.whole_numbers(name) == expected[ring], f"{name} is not that of the ring in the target")
    view_of = {name: k for k, name in enumerate(sizes)}
    view = np.array([view_of.get(name, -1) for name in table.cells["image"]], dtype=np.int64)
    table.require(view >= 0, "its image has no '# image' line above the column names")
    center = table.columns("uv")
    table.require(np.hypot(*center.T) <= MAX_SIDE_PX, f"u or v is beyond {MAX_SIDE_PX} px")
    cov = table.covariances()
    table.columns("XYZ")  # numbers, but those of the target count
    ellipse, edges = _checked_edges(table, center)
    order = table.sorted_once(view, ring, "the same ring of the same image a second time; keep one")
    start = np.searchsorted(view[order], np.arange(len(sizes) + 1))
    record = _records_beside(path, layout_id, geometry_id)
    return tuple(
        Detections(
            name, size, layout_id, geometry_id, ring[rows], target.center_mm[ring[rows]],
            center[rows], cov[rows], ellipse[rows],
            record[name].faces if name in record else (), record[name].remarks if name in record else (),
            ratio=edges[rows, 0], blur_px=edges[rows, 1], motion_px=record[name].motion_px if name in record else 0.0,
            time_s=record[name].time_s if name in record else None,
        )
        for (name, size), rows in zip(sizes.items(), (order[a:b] for a, b in pairwise(start)), strict=True)
    )  # fmt: skip


def _records_beside(path: Path, layout_id: str, geometry_id: str) -> dict[str, ImageRecord]:
    """What the records beside a table tell of each photo; nothing if there are none, or they are of another one."""
    try:
        records = RECORDS.read(records_path(path))
    except InputError:
        return {}
    is_same = (records.layout_id, records.geometry_id) == (layout_id, geometry_id)
    return {image.image: image for image in records.images} if is_same else {}


def _image_line(path: Path, number: int, line: str) -> tuple[str, tuple[int, int]]:
    match = _IMAGE_LINE.fullmatch(line)
    try:
        name = json.loads(match[3]) if match else None
    except ValueError:
        name = None
    if match is None or not isinstance(name, str):
        raise InputError(f'{path}: line {number}: expected: # image WIDTH x HEIGHT px "NAME"')
    size = int(match[1]), int(match[2])
    if not all(1 <= side <= MAX_SIDE_PX for side in size):
        raise InputError(f"{path}: line {number}: size {size[0]} x {size[1]} px; a side has 1 to {MAX_SIDE_PX} px")
    return name, size
