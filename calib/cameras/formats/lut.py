"""A table of rays over the image for programs, interpolated by cubic B-splines, with readers in C++ and JavaScript.

The ray at a pixel is `(2a, 2b, 1 - a^2 - b^2) / (1 + a^2 + b^2)`: a and b, the stereographic image of the unit sphere
from behind, are as smooth at and beyond 90 degrees off the axis as in the middle. Each is a uniform bicubic B-spline
over cells that divide the image, from its edge half a pixel before the first pixel's centre; its control points are of
least squares. docs/lut.md has the file byte by byte.
"""

import math
import struct
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array, kron, vstack
from scipy.sparse.linalg import splu

from calib.cameras import project, rays
from calib.cameras.camera import Camera
from calib.cameras.formats.format import CameraFormat, FileLens, ReadCamera
from calib.cameras.formats.rig_format import NEVER
from calib.cameras.refit import Refit, image_grid
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.base.words import NAME

TABLE_PX = 1e-3
"""How far off a table may be, unless another accuracy is asked for."""
CELLS = (16, 24, 32, 48, 64, 96, 128, 192)
"""Along the longer side of the image; the first that is accurate enough is taken, else the last."""
MAGIC = f"{NAME} lut 1\n".encode()
HEAD = struct.Struct("<16s4I2d")
"""Who wrote it and the version, width, height, cells across and down, largest and RMS error; CRC-32 follows."""
FITTED, CHECKED, AT_ONCE = 3, 10, 2**20
"""Places along a side of a cell that are fitted, and others that are looked at; places at a time."""
SMOOTH = 1e-5
"""Weight of second differences, which say what control points are where no pixel tells."""
READERS = (f"{NAME}_lut.h", f"{NAME}_lut.mjs")


@dataclass(frozen=True, eq=False)
class RayTable:
    """Rays over an image: `table.rays(pixel)`."""

    image_size: tuple[int, int]
    control: Array  # (cells down + 3, cells across + 3, 2)
    seen: Rows  # (H, 2) of each row of pixels the first that shows light, and the one after the last
    max_px: float = math.inf  # the largest distance of a pixel from where the camera sees the table's ray
    rms_px: float = math.inf

    def rays(self, across: Array, down: Array) -> Array:
        """Unit directions (V, U, 3) at all pairs of places (U,) and (V,) in px, whether or not light reaches them."""
        weights = [_weights(at, side, count - 3) for at, side, count in
                   zip((down, across), self.image_size[::-1], self.control.shape[:2], strict=True)]  # fmt: skip
        plane = np.stack([weights[0] @ self.control[..., axis] @ weights[1].T for axis in range(2)], axis=-1)
        square = (plane**2).sum(axis=-1, keepdims=True)
        ray: Array = np.concatenate([2 * plane, 1 - square], axis=-1) / (1 + square)
        return ray

    def content(self) -> bytes:
        """The file."""
        down, across = (count - 3 for count in self.control.shape[:2])
        head = HEAD.pack(MAGIC, *self.image_size, across, down, self.max_px, self.rms_px)
        body = self.control.astype("<f8").tobytes() + self.seen.astype("<u4").tobytes()
        return head + struct.pack("<Q", zlib.crc32(body, zlib.crc32(head))) + body


def _weights(place: Array, side: int, cells: int) -> csr_array:
    """Of the control points along an axis, at places (N,) in px.  # (N, cells + 3)"""
    x = (place + 0.5) * cells / side
    cell = np.clip(np.floor(x).astype(np.int64), 0, cells - 1)
    t = x - cell
    weight = np.column_stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]) / 6
    index, starts = (cell[:, None] + np.arange(4)).ravel(), np.arange(len(x) + 1) * 4
    return csr_array((weight.ravel(), index, starts), shape=(len(x), cells + 3))


def _places(side: int, cells: int, each: int, margin: float = 0.0) -> Array:
    """As many places (N,) in px a cell, evenly from the first pixel's centre, or a margin before, to the last one's."""
    return np.linspace(-margin, side - 1 + margin, cells * each + 1)


def _grid(across: Array, down: Array) -> Array:
    return np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)


@lru_cache(maxsize=2)
def ray_table(camera: Camera, accept_px: float) -> RayTable:
    """The table of a camera with the fewest cells that is off by `accept_px` at most, or that of the most cells.

    Raises:
        InputError: the camera shows light in parts of a row of pixels that do not hang together, or none at all.
    """
    seen = _spans(camera)
    for cells in CELLS:
        table = _checked(camera, _fitted(camera, cells, seen))
        if table.max_px <= accept_px:
            break
    return table


def _spans(camera: Camera) -> Rows:
    """Where each row of pixels shows light.  # (H, 2)"""
    width, height = camera.image_size
    u, v = np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64)
    edges = [_grid(u, v[[0, -1]]), _grid(u[[0, -1]], v), image_grid(camera.image_size).reshape(-1, 2)]
    if np.isfinite(rays(camera, np.concatenate(edges))).all():
        return np.tile([0, width], (height, 1))
    found = np.zeros((height, 2), dtype=np.int64)
    step = max(1, AT_ONCE // width)
    for start in range(0, height, step):
        known = np.isfinite(rays(camera, _grid(u, v[start : start + step]))[:, 0]).reshape(-1, width)
        first, count = known.argmax(axis=1), known.sum(axis=1)
        found[start : start + step] = np.column_stack([first, first + count])
        ends = known & ~np.pad(known, ((0, 0), (0, 1)))[:, 1:]
        if (ends.sum(axis=1) > 1).any():
            raise InputError("the camera shows light in several parts of a row of pixels; a table holds one")
    if not (found[:, 1] > found[:, 0]).any():
        raise InputError("the camera shows light in no pixel")
    return found


def _fitted(camera: Camera, most: int, seen: Rows) -> RayTable:
    """Control points of least squares."""
    width, height = camera.image_size
    across, down = (max(1, round(most * side / max(width, height))) for side in (width, height))
    u, v = _places(width, across, FITTED, 0.5), _places(height, down, FITTED, 0.5)
    ray = rays(camera, _grid(u, v))
    known = np.isfinite(ray[:, 0])
    plane = ray[known, :2] / (1 + ray[known, 2:])
    design = csr_array(kron(_weights(v, height, down), _weights(u, width, across)))[known]
    second = [diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(one + 1, one + 3)) for one in (down, across)]
    rough = vstack([kron(second[0], eye_array(across + 3)), kron(eye_array(down + 3), second[1])])
    normal = design.T @ design + SMOOTH**2 * (rough.T @ rough)
    control = splu(normal.tocsc()).solve(design.T @ plane)
    return RayTable(camera.image_size, control.reshape(down + 3, across + 3, 2), seen)


def _checked(camera: Camera, table: RayTable) -> RayTable:
    """The table with what it is off by, at many places of each cell that show light, up to the image's edges."""
    (width, height), (down, across) = camera.image_size, (count - 3 for count in table.control.shape[:2])
    u, v = _places(width, across, CHECKED), _places(height, down, CHECKED)
    most, total, count = 0.0, 0.0, 0
    for rows in np.array_split(v, -(-len(u) * len(v) // AT_ONCE)):
        pixel = _grid(u, rows)
        known = np.isfinite(rays(camera, pixel)[:, 0])
        off = np.linalg.norm(project(camera, table.rays(u, rows).reshape(-1, 3)[known]) - pixel[known], axis=1)
        most = max(most, float(np.max(np.where(np.isfinite(off), off, np.inf), initial=0.0)))
        total, count = total + float((off**2).sum()), count + len(off)
    return replace(table, max_px=most, rms_px=math.sqrt(total / max(count, 1)))


def _with_readers(camera: Camera, accept_px: float) -> Mapping[str, bytes]:
    folder = Path(__file__).parent / "readers"
    return {"camera.lut": ray_table(camera, accept_px).content()} | {
        name: (folder / name).read_bytes() for name in READERS
    }


def accurate_to(accept_px: float | None) -> CameraFormat:
    """The format for tables that are off by so much at most; None: the usual."""
    accept = TABLE_PX if accept_px is None else accept_px

    def nearest(camera: Camera) -> Refit:
        table = ray_table(camera, accept)
        known = float((table.seen[:, 1] - table.seen[:, 0]).sum()) / (camera.image_size[0] * camera.image_size[1])
        return Refit(camera, np.eye(3), table.rms_px, table.max_px, known)

    return replace(
        FORMAT,
        lenses=(FileLens("bicubic", None, approximate=nearest, keeps_edges=True),),
        files=lambda camera: _with_readers(camera, accept),
        accept_px=accept,
    )


def _not_read(*_: object) -> ReadCamera:
    raise InputError("a table of rays is not read; take the camera that it was made of")


FORMAT = CameraFormat(
    name="lut",
    title="table of rays",
    file_name="camera.lut",
    opens_with=f"in C++: #include \"{READERS[0]}\"; in JavaScript: import {{{{readLut}}}} from './{READERS[1]}'",
    recognised=NEVER,
    read=_not_read,
    accurate_to=accurate_to,
)
