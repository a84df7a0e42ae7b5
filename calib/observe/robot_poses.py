"""Poses of a robot's flange, photo by photo: CSV, YAML or JSON as controllers, ROS and scripts write them.

A row, or an entry, is a photo: `image`, a position whose unit its columns name (`x_mm`, `x_m`), and a rotation as
`qx qy qz qw` in any order, `q1 q2 q3 q4` (w first), a rotation vector `rx_rad ry_rad rz_rad`, Euler angles, or a matrix
`m00 ... m23`. In YAML and JSON `position`, `orientation` and `matrix` may stand as they do in ROS. A stream has times
instead of photos, `time_s`, or is a trajectory of TUM's form: `time x y z qx qy qz qw` in m, no names.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PureWindowsPath

import numpy as np

from calib.cameras.formats.parsing import number, parse_yaml, shown_plain
from calib.core.csv_table import column_fault, csv_bytes, csv_cell, read_table, read_text, stamps_s
from calib.core.se3 import MAX_DISTANCE_MM, interpolated, invert, make_pose, steps_between
from calib.core.types import freeze
from calib.observe.rotations import RotationColumns, RowError, of_quaternion, rotation_columns, to_quaternion
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError
from designer.base.files import parse_json
from designer.base.words import figure, shown, suggestion

Entry = Mapping[str, object]

KIND = "ringsolid.robot-poses"
FIRST_LINE = "# ringsolid robot-poses, version 1"
IMAGE = ("image", "photo", "file", "name", "frame")
TIME = ("time", "t", "timestamp", "stamp")
SECONDS = {"_s": 1.0, "_ms": 1e-3, "_us": 1e-6, "_ns": 1e-9, "": 1.0}
TUM = ("time_s", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
TUM_SUFFIXES = (".tum", ".txt")
CAMERA_PLACE = ("x_mm", "y_mm", "z_mm")
TARGET_POSES = "# ringsolid poses"
"""How the table begins that `calib pose` writes."""
LENGTHS = {"mm": 1.0, "m": 1e3, "cm": 10.0, "in": 25.4}
ANGLES = {"rad": 1.0, "deg": float(np.pi / 180)}
MOST_POSES, MAX_FILE_BYTES = 100_000, 16 * 2**20
MOST_TURNS_RAD = 4 * np.pi
"""No robot writes larger angles; degrees that are taken for radians are."""
LONGEST_STEP_S, GAP_STEPS, MORE_POSES = 0.25, 5.0, 2
"""A stream has poses at least so often, and so many a photo; so many steps without one are a gap."""
AROUND_S, STILL_MM = 0.1, 0.1
"""A robot that moves no farther in this time around a photo stands still: an offset of clocks matters nothing."""
LEVER_MM = 500.0
"""From a flange to what its camera sees."""
_LISTS = {
    "position": ("x", "y", "z"),
    "translation": ("x", "y", "z"),
    "rotation_vector": ("rx", "ry", "rz"),
    "euler": ("e1", "e2", "e3"),
}
_POSITION, _QUATERNION = {"x": "x", "y": "y", "z": "z"}, {"x": "qx", "y": "qy", "z": "qz", "w": "qw"}
_MAPS = {
    "position": _POSITION,
    "translation": _POSITION,
    "orientation": _QUATERNION,
    "rotation": _QUATERNION,
    "quaternion": _QUATERNION,
}
MOST_YAML_VALUES = 9_000
_VALUE = re.compile(r"[^\s,:\[\]{}]+")
_UNIT = re.compile(rf"_({'|'.join((*LENGTHS, *ANGLES))})$")


@dataclass(frozen=True, eq=False)
class RobotPoses:
    """Where a robot's flange was at each photo: `poses.base_from_flange`."""

    images: tuple[str, ...]  # (V,) each another
    base_from_flange: Array  # (V, 4, 4)
    origin: str  # what messages name
    is_inverted: bool = False  # the file held flange_from_base
    length_unit: str = "mm"  # what its positions were taken for
    is_unit_named: bool = False  # by its columns
    angles_rad: Array | None = None  # (V, 3) of columns that hold angles, as they stand there
    angle_names: tuple[str, ...] = ()
    angle_unit: str = "rad"
    has_quaternions: bool = False
    time_s: Array | None = None  # (V,) if the file has them
    covariance: Array | None = None  # (V, 6, 6) of a table of `calib pose`: rad and mm, in the camera's axes

    def __post_init__(self) -> None:
        freeze(self, "base_from_flange", "angles_rad", "time_s", "covariance")

    def sorted_by_time(self) -> "RobotPoses":
        """The same in the order of time; InputError: two poses are of one time."""
        if self.time_s is None:
            return self
        order = np.argsort(self.time_s, kind="stable")
        if (np.diff(self.time_s[order]) <= 0).any():
            row = int(np.flatnonzero(np.diff(self.time_s[order]) <= 0)[0])
            raise InputError(f"{self.origin}: two poses at {self.time_s[order[row]]:.9g} s; a time has one")
        arrays = {
            name: value[order]
            for name in ("base_from_flange", "angles_rad", "time_s", "covariance")
            if (value := getattr(self, name)) is not None
        }
        return replace(self, images=tuple(self.images[row] for row in order), **arrays)

    @property
    def step_s(self) -> float:
        """The usual time from pose to pose of a stream, such as its poses may be interpolated over; 0: it is none."""
        if self.time_s is None or len(self.time_s) < 2:
            return 0.0
        step_s = float(np.median(np.diff(np.sort(self.time_s))))
        return step_s if step_s <= LONGEST_STEP_S else 0.0

    def at(self, time_s: Array) -> Array:
        """A stream's poses at times (T,): turned steadily and moved straight between its own.  # (T, 4, 4)"""
        return interpolated(self._stamps_s, self.base_from_flange, time_s)

    def sampled(self, names: Sequence[str], time_s: Array) -> "RobotPoses":
        """A stream's poses at times (T,), under names; what else its rows hold is that of the nearest."""
        before, after = self._around(time_s)
        own = self._stamps_s
        nearest = np.where(time_s - own[before] < own[after] - time_s, before, after)
        angles, pose = None if self.angles_rad is None else self.angles_rad[nearest], self.at(time_s)
        named = replace(self, images=tuple(names), base_from_flange=pose, time_s=time_s)
        return replace(named, angles_rad=angles, covariance=None)

    def is_known(self, time_s: Array) -> Flags:
        """Whether a stream tells the pose at times (T,): none before its first, after its last, or in a gap."""
        if self.step_s == 0:
            return np.zeros(len(time_s), dtype=bool)
        begin, end = (self._stamps_s[rows] for rows in self._around(time_s))
        is_gap = end - begin > max(GAP_STEPS * self.step_s, LONGEST_STEP_S / 2)
        known: Flags = ((begin <= time_s) & (time_s <= end) & ~is_gap) | (time_s == end)
        return known

    @property
    def _stamps_s(self) -> Array:
        return np.zeros(0) if self.time_s is None else self.time_s

    def _around(self, time_s: Array) -> tuple[Rows, Rows]:
        """The poses before and after times (T,)."""
        after = np.clip(np.searchsorted(self._stamps_s, time_s), 1, len(self._stamps_s) - 1)
        return after - 1, after

    def moves_mm(self, time_s: Array) -> Array:
        """How far it moves in 0.1 s before and after times (T,), a turn as it moves what its camera sees.  # (T,)"""
        here, before, after = (self.at(time_s + shift) for shift in (0.0, -AROUND_S, AROUND_S))
        return np.maximum(way_mm(before, here), way_mm(here, after))


def way_mm(first: Array, second: Array) -> Array:
    """How far poses (N, 4, 4) lie apart, a turn as it moves what a camera on the flange sees.  # (N,)"""
    step = steps_between(first, second)
    way: Array = np.hypot(LEVER_MM * np.linalg.norm(step[:, :3], axis=1), np.linalg.norm(step[:, 3:], axis=1))
    return way


def read_robot_poses(
    path: Path, *, unit: str | None = None, euler: str | None = None, is_inverted: bool = False
) -> RobotPoses:
    """The robot's poses in a file: `read_robot_poses(Path("poses.csv"), unit="m")`.

    Args:
        path: a .csv, .yaml or .json file.
        unit: of columns that do not name it: `mm`, `m`, `deg`, `rad`, or two of them, as in `mm,deg`.
        euler: convention of Euler angles, such as `xyz-extrinsic` or `kuka`; None: rx, ry, rz are a rotation vector.
        is_inverted: the file holds flange_from_base.

    Raises:
        InputError: the file cannot be read, or an entry breaks a rule; the message names it.
    """
    table = _table(path, unit)
    columns, name = table.columns, next((name for name in IMAGE if name in table.columns), None)
    time = _times(table)
    if name is None and time is None:
        raise InputError(
            f"{path}: column 'image' is missing{suggestion('image', list(columns))}; it names the photo of each pose; "
            "a stream has time_s"
        )
    stamped = [] if time is None else [f"{one:.9f}" for one in time.tolist()]
    images = tuple(str(cell).strip() for cell in (columns[name].cells if name else stamped))
    first: dict[str, str] = {}
    for row, image in enumerate(images):
        if image in first:
            raise table.fault(row, f"{shown(image)} was named before, in {first[image]}; a photo has a pose")
        first[image] = table.places[row]
    way, angle, value, rotation = _rotations(table, rotation_columns(euler))
    length, shift = _shifts(table)
    if euler is not None and not way.are_angles:
        raise InputError(f"{path}: --euler {shown(euler)}: its rotations are {way.what}; leave it out")
    for kind, word in table.given.items():
        if kind == "angle" and not way.are_angles:
            raise InputError(f"{path}: --unit {word}: its rotations are {way.what}, which have no unit; leave it out")
        said = angle if kind == "angle" else length
        if word != said.name:
            raise InputError(f"{path}: --unit {word}: its columns say {said.name}; rename them, or leave --unit out")
    pose = make_pose(rotation, shift)
    return RobotPoses(
        images, invert(pose) if is_inverted else pose, str(path), is_inverted, length.name, length.is_named,
        value if way.are_angles else None, way.names if way.are_angles else (), angle.name,
        has_quaternions=way.rotations is of_quaternion, time_s=time, covariance=_covariances(table),
    )  # fmt: skip


def _times(table: "_Table") -> Array | None:
    """The times of the rows, if a column has them."""
    units = [(name, unit) for name in TIME for unit in SECONDS if f"{name}{unit}" in table.columns]
    if not units:
        return None
    name, unit = units[0]
    return SECONDS[unit] * table.reals([f"{name}{unit}"])[:, 0]


def _covariances(table: "_Table") -> Array | None:
    """Of a table of `calib pose`."""
    upper = [f"c{row}{column}" for row in range(6) for column in range(row, 6)]
    if not table.has(upper):
        return None
    rows, columns = np.triu_indices(6)
    covariance = np.zeros((len(table.places), 6, 6))
    covariance[:, rows, columns] = covariance[:, columns, rows] = table.reals(upper)
    return covariance


def robot_poses_to_csv(images: Sequence[str], base_from_flange: Array) -> bytes:
    """The text of a table, which `read_robot_poses` reads: photos and poses (V, 4, 4)."""
    return poses_to_csv((FIRST_LINE, "# base_from_flange of each photo"), images, base_from_flange)


def poses_to_csv(head: Sequence[str], images: Sequence[str], pose: Array) -> bytes:
    """The text of a table of poses (V, 4, 4) below some lines, in mm and as quaternions."""
    numbers = np.concatenate([pose[:, :3, 3], to_quaternion(pose[:, :3, :3])], axis=1)
    rows = ([csv_cell(image), *(f"{x:.9g}" for x in row)] for image, row in zip(images, numbers.tolist(), strict=True))
    return csv_bytes(head, ["image", "x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw"], rows)


def _entries(path: Path) -> list[tuple[str, Entry]]:
    """The rows of a file, each with the place that messages name."""
    text = read_text(path, "a file of robot poses", MAX_FILE_BYTES)
    if path.suffix.lower() == ".json":
        return list(_tree_entries(parse_json(text, path, "a file of robot poses"), str(path)))
    if path.suffix.lower() in (".yaml", ".yml"):
        if len(_VALUE.findall(text)) > MOST_YAML_VALUES:
            raise InputError(f"{path}: more than {MOST_YAML_VALUES} values in YAML, which is slow; write CSV or JSON")
        return list(_tree_entries(parse_yaml(text, str(path)), str(path)))
    if path.suffix.lower() in TUM_SUFFIXES:
        return list(_trajectory_entries(path, text))
    table = read_table(path, text, lambda names: column_fault(names, (), ""))
    if text.startswith(TARGET_POSES):  # x, y, z are the camera's place in the target's frame there
        table = replace(table, cells={name: cells for name, cells in table.cells.items() if name not in CAMERA_PLACE})
    rows = (dict(zip(table.cells, row, strict=True)) for row in zip(*table.cells.values(), strict=True))
    return [(f"line {line}", row) for line, row in zip(table.lines, rows, strict=True)]


def _trajectory_entries(path: Path, text: str) -> Iterator[tuple[str, Entry]]:
    """The lines of a trajectory of TUM's form."""
    for count, line in enumerate(text.splitlines(), start=1):
        cells = line.split()
        if cells and not cells[0].startswith("#"):
            if len(cells) != len(TUM):
                raise InputError(f"{path}: line {count}: {len(cells)} values; a trajectory has {', '.join(TUM)}")
            yield f"line {count}", dict(zip(TUM, cells, strict=True))


def _tree_entries(tree: object, origin: str) -> Iterator[tuple[str, Entry]]:
    """The entries of a list, of a list under `poses`, or of names with poses."""
    if isinstance(tree, dict) and "poses" in tree:
        tree = tree["poses"]
    if isinstance(tree, dict):
        tree = [{"image": name, **(one if isinstance(one, dict) else {"matrix": one})} for name, one in tree.items()]
    if not isinstance(tree, list):
        raise InputError(f"{origin}: must hold a list of poses, each with an image, a position and a rotation")
    for count, one in enumerate(tree, start=1):
        if not isinstance(one, dict):
            raise InputError(f"{origin}: pose {count}: must hold names with values")
        yield f"pose {count}", _flat(one, f"{origin}: pose {count}")


def _flat(entry: Mapping[object, object], origin: str) -> Entry:
    """An entry of a tree as the columns of a table."""
    flat: dict[str, object] = {}
    for key, value in entry.items():
        name = str(key)
        base, unit = _without_unit(name)
        if isinstance(value, dict) and base in _MAPS:
            flat |= {f"{_MAPS[base].get(str(one), str(one))}{unit}": cell for one, cell in value.items()}
        elif isinstance(value, list) and base in _LISTS and len(value) == 3:
            flat |= {f"{column}{unit}": cell for column, cell in zip(_LISTS[base], value, strict=True)}
        elif isinstance(value, list) and base in ("matrix", "rotation", "pose"):
            flat |= _matrix_cells(value, "r" if base == "rotation" else "m", unit, origin)
        elif isinstance(value, list) and base in ("orientation", "rotation", "quaternion"):
            raise InputError(f"{origin}: {name}: four numbers may be x y z w or w x y z; name them qx, qy, qz, qw")
        else:
            flat[name] = value
    return flat


def _matrix_cells(value: Sequence[object], letter: str, unit: str, origin: str) -> dict[str, object]:
    """A matrix as cells: 3 x 3, 3 x 4 or 4 x 4, in rows or flat."""
    rows = [one if isinstance(one, list) else [one] for one in value]
    flat = [cell for row in rows for cell in row]
    width = {9: 3, 12: 4, 16: 4}.get(len(flat), 0)
    if not width or (letter == "r" and width != 3) or len({len(row) for row in rows}) > 1:
        raise InputError(f"{origin}: a matrix of {len(flat)} numbers; give 3 x 4 or 4 x 4 of them, row by row")
    return {
        f"{letter}{k // width}{k % width}{unit if k % width == 3 and k < 12 else ''}": cell
        for k, cell in enumerate(flat)
    }


def _without_unit(name: str) -> tuple[str, str]:
    """A name in small letters, and the unit at its end with its underscore, "" for none."""
    small = name.strip().lower()
    match = _UNIT.search(small)
    return (small, "") if match is None else (small[: match.start()], match[0])


@dataclass(frozen=True)
class _Column:
    """Cells of one name, and the unit that the name says; "": it says none."""

    name: str
    unit: str
    cells: tuple[object, ...]


@dataclass(frozen=True)
class _Unit:
    name: str
    is_named: bool  # by the columns; else by an option


@dataclass(frozen=True)
class _Table:
    """The columns of a file by their names without unit."""

    path: Path
    places: Sequence[str]  # of the rows, as messages name them
    columns: Mapping[str, _Column]
    given: Mapping[str, str]  # units of lengths and angles whose columns name none

    def has(self, names: Sequence[str]) -> bool:
        """Whether all these columns are there."""
        return all(name in self.columns for name in names)

    def fault(self, row: int, rule: str) -> InputError:
        """A row that breaks a rule."""
        return InputError(f"{self.path}: {self.places[row]}: {rule}")

    def reals(self, names: Sequence[str]) -> Array:
        """Columns of finite numbers.  # (V, N)"""
        columns = []
        for column in (self.columns[name] for name in names):
            cells = [cell.strip() if isinstance(cell, str) else cell for cell in column.cells]
            placed = zip(self.places, cells, strict=True)
            columns.append([number(cell, column.name, f"{self.path}: {place}") for place, cell in placed])
        return np.array(columns).T

    def unit(self, names: Sequence[str], kind: str, units: Sequence[str]) -> _Unit:
        """The unit of numbers: as their columns say, which must be alike, or else as is given."""
        columns = [self.columns[name] for name in names]
        said = {column.unit for column in columns}
        told = ", ".join(column.name for column in columns)
        if len(said) > 1 or not said <= {"", *units}:
            raise InputError(f"{self.path}: {told}: name one unit for all, {' or '.join(units)}")
        (unit,) = said
        if not unit and kind not in self.given:
            both = " or ".join(f"{columns[0].name}_{name}" for name in units)
            raise InputError(
                f"{self.path}: {told} do not say their unit; name the columns {both} and so on, or give --unit "
                + " or ".join(units)
            )
        return _Unit(unit or self.given[kind], is_named=bool(unit))


def _table(path: Path, unit: str | None) -> _Table:
    """What a file holds; all rows have the same columns."""
    entries = _entries(path)
    if not entries:
        raise InputError(f"{path}: holds no robot poses; a row is such as a.png,0.4,0.1,0.7,0,1,0,0")
    if len(entries) > MOST_POSES:
        raise InputError(f"{path}: {len(entries)} poses; at most {MOST_POSES} are read")
    places, rows = zip(*entries, strict=True)
    names = list(rows[0])
    for place, row in entries:
        if set(row) != set(names):
            other = next(iter(set(row) ^ set(names)))
            raise InputError(f"{path}: {place}: {shown(other)} is not in every pose; give each pose the same values")
    columns: dict[str, _Column] = {}
    for name in names:
        base, own = _without_unit(name)
        base = base.removeprefix("t") if base in ("tx", "ty", "tz") else base
        if base in columns:
            raise InputError(f"{path}: {shown(name)} says what {shown(columns[base].name)} says; leave one out")
        columns[base] = _Column(name, own.removeprefix("_"), tuple(row[name] for row in rows))
    given: dict[str, str] = {}
    for word in [] if unit is None else [one.strip().lower() for one in unit.split(",")]:
        known, kind = (LENGTHS, "length") if word in LENGTHS else (ANGLES, "angle")
        if word not in known or kind in given:
            raise InputError(
                f"--unit {shown(unit)}: give {' or '.join(LENGTHS)}, {' or '.join(ANGLES)}, or one of each: mm,deg"
            )
        given[kind] = word
    return _Table(path, places, columns, given)


def _rotations(table: _Table, ways: Sequence[RotationColumns]) -> tuple[RotationColumns, _Unit, Array, Array]:
    """The one rotation that the columns say: in which way, in which unit, their numbers, and what these mean."""
    said = [way for way in ways if table.has(way.names)]
    if not said:
        raise InputError(
            f"{table.path}: no rotation: give qx,qy,qz,qw, or rx_rad,ry_rad,rz_rad (a rotation vector; Euler angles "
            "with --euler), or a matrix m00 to m23"
        )
    if len(said) > 1:
        names = " and ".join(",".join(way.names) for way in said[:2])
        raise InputError(f"{table.path}: two rotations, {names}; leave one out")
    (way,) = said
    unit = table.unit(way.names, "angle", tuple(ANGLES)) if way.are_angles else _Unit("rad", is_named=True)
    value = ANGLES[unit.name] * table.reals(way.names)
    if way.are_angles and (off := np.flatnonzero(np.abs(value).max(axis=1) > MOST_TURNS_RAD)).size:
        raise table.fault(
            int(off[0]),
            f"an angle of {np.abs(value[off[0]]).max():.4g} rad is more than two turns; are these degrees? name the "
            "columns _deg, or give --unit deg",
        )
    try:
        return way, unit, value, way.rotations(value)
    except RowError as error:
        raise table.fault(error.row, error.rule) from None


def _shifts(table: _Table) -> tuple[_Unit, Array]:
    """The unit of the positions, and these in mm."""
    names = next((names for names in (("x", "y", "z"), ("m03", "m13", "m23")) if table.has(names)), None)
    if names is None:
        raise InputError(f"{table.path}: no position: give x_mm,y_mm,z_mm, or x_m,y_m,z_m")
    unit = table.unit(names, "length", tuple(LENGTHS))
    shift = LENGTHS[unit.name] * table.reals(names)
    if (far := np.flatnonzero(np.abs(shift).max(axis=1) > MAX_DISTANCE_MM)).size:
        raise table.fault(int(far[0]), f"lies more than {MAX_DISTANCE_MM:g} mm away; check the unit")
    for name, wanted in (("m30", 0.0), ("m31", 0.0), ("m32", 0.0), ("m33", 1.0)):
        if name in table.columns and (off := np.flatnonzero(np.abs(table.reals([name])[:, 0] - wanted) > 1e-9)).size:
            cell = shown_plain(table.columns[name].cells[off[0]])
            raise table.fault(int(off[0]), f"{name} {cell}: the last row must be 0 0 0 1")
    return unit, shift


def _file_name(name: str) -> str:
    """What stands after the last slash, or after the last backslash of a path of Windows."""
    return Path(name).name if "/" in name else PureWindowsPath(name).name


@dataclass(frozen=True)
class PosesOfPhotos:
    """Which pose each of V photos has, and what is left over."""

    row: tuple[int | None, ...]  # (V,) of the poses; None: the photo has none
    unused: tuple[str, ...]  # names in the file that no photo has
    remark: str = ""  # if it was not by names


def poses_of(poses: RobotPoses, photos: Sequence[str]) -> PosesOfPhotos:
    """The pose of each photo: by its name, else by its file's name, else by that without its ending, else by time.

    Raises:
        InputError: not one photo has a pose.
    """
    for short in (lambda name: name, _file_name, lambda name: Path(_file_name(name)).stem):
        rows: dict[str, list[int]] = {}
        for row, image in enumerate(poses.images):
            rows.setdefault(short(image), []).append(row)
        found = [rows.get(short(photo), []) for photo in photos]
        if any(found):
            for photo, several in zip(photos, found, strict=True):
                if len(several) > 1:
                    raise InputError(f"{poses.origin}: {shown(photo)} has {len(several)} poses; give it one")
            by_name = _paired(poses, [one[0] if one else None for one in found])
            by_time = None if all(found) else _by_time(poses, photos)
            return by_time if by_time and len(by_time.unused) < len(by_name.unused) else by_name
    if by_time := _by_time(poses, photos):
        return by_time
    raise InputError(
        f"{poses.origin}: names no photo: its first pose is of {shown(poses.images[0])}, the first photo is "
        f"{shown(photos[0])}; name the photos as their files are"
    )


def stream_times(poses: RobotPoses, photos: Sequence[str], time_s: Array | None) -> Array | None:
    """When photos were taken, by the clock of a stream of poses; None: it is no stream, or they have no time stamps.

    Args:
        poses: in the order of time.
        photos: by their names, which may be times.
        time_s: their stamps, if they have some.
    """
    if poses.step_s == 0 or poses.time_s is None or len(poses.images) < MORE_POSES * len(photos):
        return None
    if poses.images[0] != f"{poses.time_s[0]:.9f}":  # which names photos
        return None
    if time_s is not None:
        return time_s
    stamps = stamps_s([f"{one:.9f}" for one in poses.time_s.tolist()], [_file_name(name) for name in photos])
    return None if stamps is None else stamps[1] - stamps[0][0] + poses.time_s[0]


def _paired(poses: RobotPoses, row: Sequence[int | None], remark: str = "") -> PosesOfPhotos:
    """With the poses that no photo has."""
    return PosesOfPhotos(
        tuple(row), tuple(image for number, image in enumerate(poses.images) if number not in set(row)), remark
    )


def _by_time(poses: RobotPoses, photos: Sequence[str]) -> PosesOfPhotos | None:
    """The pose nearest to each photo in time, within half of the least time between two, where names are times."""
    stamps = stamps_s([_file_name(name) for name in poses.images], [_file_name(name) for name in photos])
    if stamps is None:
        return None
    of_pose, of_photo = stamps
    apart_s = min((float(np.diff(np.sort(one)).min()) for one in stamps if len(one) > 1), default=0.0)
    order = np.argsort(of_pose)
    after = np.searchsorted(of_pose[order], of_photo)
    around = order[np.clip([after - 1, after], 0, len(order) - 1)]  # the poses before and after each photo
    off_s = np.abs(of_pose[around] - of_photo)
    nearest, least_s = np.where(off_s[0] <= off_s[1], *around), off_s.min(axis=0)
    is_near = least_s < 0.5 * apart_s
    if not is_near.any():
        return None
    return _paired(
        poses,
        [row if ok else None for row, ok in zip(nearest.tolist(), is_near.tolist(), strict=True)],
        f"photos and robot poses are paired by their times, up to {figure(1e3 * least_s[is_near].max(), 2)} ms apart; "
        f"two photos, or two poses, are {figure(1e3 * apart_s, 2)} ms apart or more",
    )
