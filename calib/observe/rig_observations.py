"""What several cameras saw of one target, put together: each camera's views are frames of the rig.

As a file it is a table of known points, `camera,frame,u,v,X,Y,Z`. The columns stand in any order, and there may be
time_s, face, and sigma, suu,suv,svv or a weight, as in a table of one camera (`calib.observe.correspondences`). Lines
`# camera NAME WIDTH x HEIGHT` above them tell the image sizes. With a target file its points are meant: those with the
ids of a column id, or those that are nearest to X, Y, Z.
Of points that nobody knows, only by name, a table is `camera,frame,point,u,v`, and may have sigma_px.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from calib.cameras.camera import Camera
from calib.cameras.rig import Rig
from calib.core.csv_table import (
    COVARIANCE,
    CsvTable,
    column_fault,
    column_names,
    csv_bytes,
    csv_cell,
    read_table,
    read_text,
)
from calib.core.types import Observations, RigObservations, keep_frames, keep_views, sightings_per_view
from calib.observe.correspondences import (
    DIAMETER,
    ID,
    OPTIONAL,
    is_far_outside,
    points_fault,
    require_inside,
    require_kind,
    rows_of_table,
)
from calib.observe.dataset import MAX_SIDE_PX
from calib.observe.mirrored import CLEAR_SHARE, facing
from calib.observe.observations import knows_fronts, prepare
from calib.observe.photos import in_order
from calib.solver.start import solve_poses
from calib.space.propagate import PointSightings, of_rows
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import first_few, shown, suggestion
from designer.target import TargetGeometry

MOST_NAME = 100
SAME_PICTURE_PX = 1e-3
"""Two cameras whose centres differ by less in all that both see are one camera twice."""
MOST_VIEWS = 8
"""Of a camera whose lens is tried on another's photos: those that show most."""
MUCH_LESS = 0.8
"""Both lenses of two cameras leave less than this share of what they leave in the photos they were given for."""


@dataclass(frozen=True, eq=False)
class RigSightings:
    """What one camera of a rig saw."""

    name: str
    seen: Observations  # its views, each named
    frame: Mapping[str, str]  # of each view's name
    time_s: Mapping[str, float] = field(default_factory=dict)  # likewise; {}: no time stamps


def rig_observations(
    cameras: Sequence[RigSightings], frame_names: Sequence[str], remarks: Sequence[str] = (), *, fewest: int = 2
) -> RigObservations:
    """The sightings of all cameras as one; frames that no camera has a view of are left out.

    Args:
        cameras: of the rig, which saw the same points.
        frame_names: of all frames, in their order.
        remarks: on the whole.
        fewest: so many cameras there must be.

    Raises:
        InputError: names that cannot be, or the same pictures from two cameras.
    """
    require_names([one.name for one in cameras], fewest)
    number = {name: row for row, name in enumerate(frame_names)}
    parts, frames, times = [], [], []
    for one in cameras:
        frame = np.array([number[one.frame[view]] for view in one.seen.view_names], dtype=np.int64)
        order = np.argsort(frame, kind="stable")
        names = tuple(one.seen.view_names[view] for view in order.tolist())
        view = np.argsort(order)[one.seen.view]
        rows = np.argsort(view, kind="stable")
        cov_px2 = None if one.seen.cov_px2 is None else one.seen.cov_px2[rows]
        parts.append(
            replace(
                one.seen, view_names=names, view=view[rows], point=one.seen.point[rows],
                center_px=one.seen.center_px[rows], cov_px2=cov_px2, remarks=(),
            )
        )  # fmt: skip
        frames.append(frame[order])
        times.append(np.array([one.time_s.get(name, np.nan) for name in names]))
    owner = "{}: " if len(cameras) > 1 else ""
    said = (*remarks, *(owner.format(one.name) + remark for one in cameras for remark in one.seen.remarks))
    is_timed = all(np.isfinite(stamps).all() for stamps in times)
    every = RigObservations(
        tuple(one.name for one in cameras), tuple(frame_names), tuple(parts), tuple(frames),
        tuple(times) if is_timed else None, tuple(dict.fromkeys(said)),
    )  # fmt: skip
    _require_different_pictures(every)
    every = replace(every, remarks=(*every.remarks, *_mirrored_cameras(every)))
    is_seen = np.zeros(len(frame_names), dtype=bool)
    for rows in every.frame:
        is_seen[rows] = True
    return keep_frames(every, is_seen)


def require_names(names: Sequence[str], fewest: int = 2) -> None:
    """Refuse names that two cameras have, those that no folder can have, and a single one if that is too few.

    Raises:
        InputError: the message shows the name.
    """
    known: dict[str, str] = {}
    for name in names:
        is_fit = name.isprintable() and not set(name) & set('/\\:*?"<>|') and name.strip(" .") == name
        if not is_fit or not 1 <= len(name) <= MOST_NAME:
            raise InputError(
                f"camera {shown(name)}: no name for a camera; take one to {MOST_NAME} letters, digits, - or _"
            )
        other = known.setdefault(name.casefold(), name)
        if other != name or names.count(name) > 1:
            raise InputError(f"two cameras are named {shown(other)} and {shown(name)}; give each its own name")
    if len(names) == 1 < fewest:
        raise InputError(f"one camera, {shown(names[0])}; a rig has two or more (calib run calibrates one)")


def _require_different_pictures(every: RigObservations) -> None:
    """Refuse a camera that is another one once more; InputError: two cameras show the same pictures."""
    for a, b in combinations(range(every.camera_count), 2):
        one, other = every.sightings[a], every.sightings[b]
        if one.image_size != other.image_size:
            continue
        common, in_a, in_b = np.intersect1d(every.frame[a], every.frame[b], return_indices=True)
        if not len(common):
            continue
        for view_a, view_b in zip(in_a.tolist(), in_b.tolist(), strict=True):
            rows_a, rows_b = one.view == view_a, other.view == view_b
            if not np.array_equal(one.point[rows_a], other.point[rows_b]):
                break
            if np.abs(one.center_px[rows_a] - other.center_px[rows_b]).max(initial=0) >= SAME_PICTURE_PX:
                break
        else:
            raise InputError(
                f"cameras {shown(every.camera_names[a])} and {shown(every.camera_names[b])} show the same pictures; "
                "give each camera its own photos"
            )


def _mirrored_cameras(every: RigObservations) -> tuple[str, ...]:
    """A word on cameras that see a flat target from the other side than most: their photos may be flipped."""
    if len(every.points.plane) != 1 or (every.points.face != 0).any():
        return ()
    share = [np.nanmedian(side) if np.isfinite(side := facing(seen)).any() else 0.0 for seen in every.sightings]
    side = np.where(np.abs(share) > CLEAR_SHARE, np.sign(share), 0)
    if side.sum() == 0 or not (side * np.sign(side.sum()) < 0).any():
        return ()
    odd = [name for name, one in zip(every.camera_names, side * np.sign(side.sum()), strict=True) if one < 0]
    return (
        f"{', '.join(odd)} {'see' if len(odd) > 1 else 'sees'} the target mirrored, or from behind, against the other "
        "cameras: flip the photos back if they were flipped",
    )


def some(names: Sequence[str]) -> str:
    """The first names, and how many more there are."""
    return first_few([shown(name) for name in names])


def swapped_cameras(observations: RigObservations, given: Mapping[str, Camera]) -> tuple[str, ...]:
    """A line on each two cameras whose lenses fit each other's photos better than their own."""
    rows = {name: row for row, name in enumerate(observations.camera_names) if name in given}
    few: dict[str, Observations] = {}
    for name, row in rows.items():
        seen = observations.sightings[row]
        most = np.argsort(-sightings_per_view(seen), kind="stable")[:MOST_VIEWS]
        few[name] = keep_views(seen, np.isin(np.arange(seen.view_count), most))
    said = []
    for a, b in combinations(rows, 2):
        if few[a].image_size != few[b].image_size:
            continue
        own_px = _left_px(given[a], few[a]), _left_px(given[b], few[b])
        crossed_px = _left_px(given[b], few[a]), _left_px(given[a], few[b])
        if all(crossed < MUCH_LESS * own for own, crossed in zip(own_px, crossed_px, strict=True)):
            said.append(
                f"the photos of {shown(a)} and {shown(b)} fit each other's lens: {crossed_px[0]:.3g} and "
                f"{crossed_px[1]:.3g} px are left over, against {own_px[0]:.3g} and {own_px[1]:.3g} px; their "
                "folders, or their camera files, may be swapped"
            )
    return tuple(said)


def _left_px(camera: Camera, seen: Observations) -> float:
    """The median view's residual by a lens, its pose free; infinite if no pose is found."""
    residual_px = solve_poses(camera, seen, weighted=False).residual_px
    squares = np.bincount(seen.view, (residual_px**2).sum(axis=1), minlength=seen.view_count)
    rms_px = np.sqrt(squares / np.maximum(sightings_per_view(seen), 1))
    return float(np.median(np.where(np.isfinite(rms_px), rms_px, np.inf)))


def alone_as_rig(name: str, seen: Observations) -> RigObservations:
    """What one camera saw as a rig's: a frame a view."""
    return RigObservations(
        (name,), seen.view_names, (replace(seen, remarks=()),), (np.arange(seen.view_count),), None, seen.remarks
    )


def with_remarks(observations: RigObservations, remarks: Iterable[str]) -> RigObservations:
    """The observations with a few more lines on them."""
    return replace(observations, remarks=tuple(dict.fromkeys((*observations.remarks, *remarks))))


Size = tuple[int, int]

KIND = "ringsolid.sightings"
FIRST_LINE = "# ringsolid sightings, version 1"
SEEN, TIME = ("camera", "frame", "u", "v"), "time_s"
POINT_SEEN, SIGMA = ("camera", "frame", "point", "u", "v"), "sigma_px"
LONGEST_NAME = 200
MAX_TIME_S = 1e12
MAX_FILE_BYTES = 256 * 2**20
"""A million and a half sightings; as text in memory they take about ten times as much."""
_CAMERA = re.compile(r"#\s*camera\s+(\S.*?)\s+(\d{1,7})\s*[x×]\s*(\d{1,7})\s*(?:px)?\s*", re.IGNORECASE)


def read_rig_sightings(
    path: Path,
    target: TargetGeometry | None = None,
    *,
    points: str | None = None,
    diameter_mm: float | None = None,
    fewest: int = 2,
) -> RigObservations:
    """Read a table of sightings.

    Args:
        path: of the table.
        target: whose points were seen; None: the table holds its own.
        points: what the points are, as for `calib.observe.correspondences.read_observations`.
        diameter_mm: of circles, likewise.
        fewest: so many cameras there must be.

    Raises:
        InputError: it cannot be read, a line breaks a rule, or nothing is left of a camera; the message names it.
    """
    require_kind(points, diameter_mm)
    text, sizes = read_text(path, "a table of sightings", MAX_FILE_BYTES), dict[str, Size]()
    of_target = target is not None

    def comment(number: int, line: str) -> None:
        if match := _CAMERA.fullmatch(line):
            name, size = match[1], (int(match[2]), int(match[3]))
            if name in sizes:
                raise InputError(f"{path}: line {number}: camera {shown(name)} a second time; give each its own name")
            if not all(1 <= side <= MAX_SIDE_PX for side in size):
                raise InputError(f"{path}: line {number}: {size[0]} x {size[1]} px; a side has 1 to {MAX_SIDE_PX} px")
            sizes[name] = size

    table = read_table(
        path, text, lambda names: points_fault(names, SEEN, TIME, of_target=of_target), comment=comment,
        holds="sightings; a line is such as left,0001,812.3,455.1,20,40,0",
    )  # fmt: skip
    table.require_filled("camera", "frame")
    table.require(
        np.array([name in sizes for name in table.cells["camera"]]),
        "the image size of its camera is not known; add a line '# camera NAME 1280 x 720' at the top",
    )
    views = [f"{camera}\n{frame}" for camera, frame in zip(table.cells["camera"], table.cells["frame"], strict=True)]
    every = rows_of_table(
        replace(table, cells={**table.cells, "image": tuple(views)}), (1, 1), target, points, diameter_mm
    )
    times = _times(table, views)
    names = sorted(dict.fromkeys(table.cells["frame"]), key=lambda name: in_order(Path(name)))
    earliest: dict[str, float] = {}
    for view, time_s in (times or {}).items():
        frame = view.partition("\n")[2]
        earliest[frame] = min(time_s, earliest.get(frame, np.inf))
    names.sort(key=lambda name: earliest.get(name, 0.0))  # in the order in which they were taken, if that is known
    cameras = [
        _camera(name, size, every, times, origin=f"{path}: camera {name}", has_fronts=knows_fronts(target))
        for name, size in sizes.items()
        if name in table.cells["camera"]
    ]
    used = (*SEEN, *"XYZ", TIME, *OPTIONAL, *([ID] if of_target else []))
    blind = [name for name in sizes if name not in table.cells["camera"]]
    said = (f"cameras without sightings: {', '.join(map(shown, blind[:10]))}",) if blind else ()
    return rig_observations(cameras, names, (*every.remarks, *table.unused(used), *said), fewest=fewest)


def time_stamps(table: CsvTable) -> list[float]:
    """The column of time stamps."""
    stamp = table.reals(TIME)
    table.require(np.abs(stamp) <= MAX_TIME_S, f"{TIME} must be seconds, at most {MAX_TIME_S:g}")
    return [float(one) for one in stamp]


def _times(table: CsvTable, views: list[str]) -> dict[str, float] | None:
    """The time stamp of each view; None without any."""
    if TIME not in table.cells:
        return None
    first: dict[str, float] = {}
    is_same = [first.setdefault(view, time_s) == time_s for view, time_s in zip(views, time_stamps(table), strict=True)]
    table.require(np.array(is_same), f"another {TIME} than on an earlier line of the same photo")
    return first


def _camera(
    name: str, size: Size, every: Observations, times: dict[str, float] | None, *, origin: str, has_fronts: bool
) -> RigSightings:
    """What can be used of one camera's sightings."""
    is_own = np.array([view.partition("\n")[0] == name for view in every.view_names])
    own = keep_views(every, is_own)
    frames = [view.partition("\n")[2] for view in own.view_names]
    stamps = {} if times is None else {frame: times[f"{name}\n{frame}"] for frame in frames}
    own = replace(own, image_size=size, view_names=tuple(frames), remarks=())
    require_inside(own, origin)
    seen = prepare(own, has_fronts=has_fronts, origin=origin)
    return RigSightings(name, seen, {frame: frame for frame in frames}, stamps)


def rig_sightings_to_csv(observations: RigObservations) -> bytes:
    """The text of a table, which reads back as what was written."""
    has_covariance = all(seen.cov_px2 is not None for seen in observations.sightings)
    has_time = observations.time_s is not None
    has_circles = not any(np.isnan(_circles_mm(seen)).any() for seen in observations.sightings)  # all is said
    columns = (
        *SEEN, *"XYZ", "face", *([DIAMETER] if has_circles else []), *(COVARIANCE if has_covariance else ()),
        *([TIME] if has_time else []),
    )  # fmt: skip
    head = [FIRST_LINE, "# u v in px, (0, 0) is the centre of the top-left pixel; X Y Z in mm"]
    rows: list[list[str]] = []
    for camera, (name, seen) in enumerate(zip(observations.camera_names, observations.sightings, strict=True)):
        head.append(f"# camera {name} {seen.image_size[0]} x {seen.image_size[1]}")
        starts = [[csv_cell(name), csv_cell(observations.frame_names[row])] for row in observations.frame[camera]]
        ends = [[repr(x)] for x in observations.time_s[camera].tolist()] if observations.time_s else [[]] * len(starts)
        before = np.hstack([seen.center_px, seen.points.position_mm[seen.point]]).tolist()
        face = [[str(one)] for one in seen.points.face[seen.point].tolist()]
        if has_circles:
            face = [[*one, f"{size:.17g}"] for one, size in zip(face, _circles_mm(seen).tolist(), strict=True)]
        after: list[list[float]] = [[]] * len(before)
        if has_covariance and seen.cov_px2 is not None:
            after = seen.cov_px2.reshape(-1, 4)[:, [0, 1, 3]].tolist()
        for row, view in enumerate(seen.view.tolist()):
            rows.append([*starts[view], *map(repr, before[row]), *face[row], *map(repr, after[row]), *ends[view]])
    return csv_bytes(head, columns, rows)


def _circles_mm(seen: Observations) -> Array:
    """The diameter of the circle whose image's centre each sighting is: 0 of a point, nan where nobody says it.  # (M,)

    What a detector of ours found is the image of a ring's centre itself.
    """
    circle_mm = seen.points.circle_mm
    return np.zeros(len(seen.point)) if circle_mm is None else circle_mm[seen.point]


def read_point_table(path: Path, rig: Rig) -> PointSightings:
    """The sightings in a table: `read_point_table(Path("sightings.csv"), rig)`.

    Raises:
        InputError: it cannot be read, or a line breaks a rule; the message names the line.
    """
    text = read_text(path, "a table of sightings", MAX_FILE_BYTES)
    wanted = f"the columns must be {','.join(POINT_SEEN)}, and may be {SIGMA}"
    holds = "sightings; a line is such as left,shot1,corner7,812.3,455.1"
    table = read_table(path, text, lambda names: column_fault(names, POINT_SEEN, wanted), holds=holds)
    row = {name: number for number, name in enumerate(rig.names)}
    camera = np.array([row.get(name, -1) for name in table.cells["camera"]], dtype=np.int64)
    if (camera < 0).any():
        name = table.cells["camera"][int(np.argmax(camera < 0))]
        hint = suggestion(name, list(rig.names)) or "; there are " + ", ".join(map(shown, rig.names))
        table.require(camera >= 0, f"camera {shown(name)} is not in the rig{hint}")
    center = table.columns("uv")
    size = np.array([one.image_size for one in rig.cameras])[camera]
    table.require(~is_far_outside(center, size), "u, v lie far outside the camera's image; is it another camera's?")
    frames, points = table.cells["frame"], table.cells["point"]
    table.require(np.array([0 < len(name) <= LONGEST_NAME for name in points]), "point needs a name")
    table.require(np.array([len(name) <= LONGEST_NAME for name in frames]), "frame has too long a name")
    seen = of_rows(camera, frames, points, center, table.variances(SIGMA) if SIGMA in table.cells else None)
    table.sorted_once(seen.camera, seen.place, "the same point of the same frame and camera a second time; keep one")
    return seen


def has_known_points(path: Path) -> bool:
    """Whether a table is of a target's points, by their coordinates or ids, and not of unknown points by name."""
    columns = column_names(path, "a table of sightings")
    return "point" not in columns and (columns >= {"X", "Y", "Z"} or "id" in columns)
