"""Photos of other makers' boards with truth: warped pictures of OpenCV's own boards, with clutter and covers."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from designer.marks.aprilgrid import AprilGrid
from designer.marks.charuco import Charuco
from designer.marks.circles import Circles
from designer.marks.face_marks import FaceMarks

Pixels = NDArray[np.uint8]
Array = NDArray[np.float64]
MARGIN = 0.6
"""Of white around the marks, in steps."""
CELL = 8


@dataclass(frozen=True, eq=False)
class BoardPhoto:
    """A photo, where each point of the board is in it, and which of them nothing covers."""

    pixels: Pixels
    point_px: Array  # (R, 2)
    is_visible: NDArray[np.bool_]  # (R,)


def dictionary(name: str) -> cv2.aruco.Dictionary:
    """OpenCV's."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def opencv_board(marks: Charuco) -> cv2.aruco.CharucoBoard:
    """The same board as OpenCV has it."""
    count = marks.squares[0] * marks.squares[1] // 2
    ids = np.arange(marks.first_id, marks.first_id + count, dtype=np.int32)
    sizes = marks.square_mm, marks.marker_mm
    board = cv2.aruco.CharucoBoard(marks.squares, *sizes, dictionary(marks.dictionary), ids)
    board.setLegacyPattern(marks.legacy)
    return board


def tag_picture(marks: AprilGrid, number: int, side: int) -> Pixels:
    """As AprilTag and Kalibr print it: OpenCV has the bits of these families from the last to the first."""
    cells = dictionary(marks.dictionary).markerSize + 2 * marks.border_bits
    tag = cv2.aruco.generateImageMarker(dictionary(marks.dictionary), number, cells, None, marks.border_bits)
    turned = np.rot90(tag, 2) if marks.dictionary.startswith("DICT_APRILTAG") else tag
    return np.asarray(cv2.resize(turned, (side, side), interpolation=cv2.INTER_NEAREST), dtype=np.uint8)


@lru_cache(maxsize=64)
def picture_of(marks: FaceMarks, step_px: int = 80) -> tuple[Pixels, Array]:
    """The board from the front with white around it, and the map from its millimetres to the picture's pixels."""
    if isinstance(marks, Charuco):
        scale = step_px / marks.square_mm
        inside = opencv_board(marks).generateImage((marks.squares[0] * step_px, marks.squares[1] * step_px))
    elif isinstance(marks, AprilGrid):
        inside, scale = _tags(marks, step_px)
    else:
        assert isinstance(marks, Circles)
        scale = step_px / marks.pitch_mm
        size = np.ceil(np.array(marks.size_mm) * scale).astype(int) + 2
        inside = np.full((size[1], size[0]), 0 if marks.light else 255, dtype=np.uint8)
        for x, y in marks.position_mm * scale * [1, -1] + (size - 1) / 2:
            at = round(x * 1024), round(y * 1024)
            cv2.circle(
                inside, at, round(marks.radius_mm * scale * 1024), 255 if marks.light else 0, -1, cv2.LINE_AA, 10
            )
    pad = int(MARGIN * step_px)
    picture = np.pad(inside, pad, constant_values=0 if isinstance(marks, Circles) and marks.light else 255)
    middle = (np.array(picture.shape[::-1]) - 1) / 2
    return picture, np.array([[scale, 0, middle[0]], [0, -scale, middle[1]], [0, 0, 1]])


def _tags(marks: AprilGrid, step_px: int) -> tuple[Pixels, float]:
    side = step_px // 4 * 3
    gap = round(side * marks.spacing)
    assert gap == side * marks.spacing
    step_px, (columns, rows) = side + gap, marks.tags
    inside = np.full((rows * step_px + gap, columns * step_px + gap), 255, dtype=np.uint8)
    for k in range(columns * rows):
        row, column = divmod(k, columns)
        top = row if marks.from_top else rows - 1 - row
        x, y = gap + column * step_px, gap + top * step_px
        inside[y : y + side, x : x + side] = tag_picture(marks, marks.first_id + k, side)
    if marks.corner_squares:
        for y in range(rows + 1):
            for x in range(columns + 1):
                inside[y * step_px : y * step_px + gap, x * step_px : x * step_px + gap] = 0
    return inside, side / marks.tag_mm


@dataclass(frozen=True)
class Pose:
    """How a board is seen: its width in shares of the photo's, tilt, turn, where its middle is, and the lens."""

    share: float = 0.7
    tilt_rad: float = 0.3
    tilt_way_rad: float = 0.0
    turn_rad: float = 0.0
    middle: tuple[float, float] = (0.5, 0.5)
    k1: float = 0.0

    def project(self, marks: FaceMarks, size: tuple[int, int], point_mm: Array) -> Array:
        """Points of the board's plane, by a camera with a focal length of 1.2 widths.  # (N, 2) -> (N, 2)"""
        axis = np.array([np.cos(self.tilt_way_rad), np.sin(self.tilt_way_rad), 0.0])
        turn = cv2.Rodrigues(axis * self.tilt_rad)[0] @ cv2.Rodrigues(np.array([0, 0, self.turn_rad]))[0]
        x = np.column_stack([point_mm * [1, -1], np.zeros(len(point_mm))]) @ turn.T
        focal = 1.2 * size[0]
        depth = focal * max(marks.size_mm) / (self.share * size[0])
        off = (np.array(self.middle) - 0.5) * size * depth / focal
        x += [off[0], off[1], depth]
        slope = x[:, :2] / x[:, 2:]
        return focal * slope * (1 + self.k1 * (slope**2).sum(axis=1, keepdims=True)) + (np.array(size) - 1) / 2

    def plane_at(self, marks: FaceMarks, size: tuple[int, int], pixel: Array) -> Array:
        """Its inverse."""
        four = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]) * max(marks.size_mm) / 4
        plain = Pose(self.share, self.tilt_rad, self.tilt_way_rad, self.turn_rad, self.middle)
        there = plain.project(marks, size, four)
        back = cv2.getPerspectiveTransform(there.astype(np.float32), four.astype(np.float32))
        focal, middle = 1.2 * size[0], (np.array(size) - 1) / 2
        bent = (pixel - middle) / focal
        slope = bent.copy()
        for _ in range(12 if self.k1 else 0):
            slope = bent / (1 + self.k1 * (slope**2).sum(axis=-1, keepdims=True))
        at = np.concatenate([slope * focal + middle, np.ones((*pixel.shape[:-1], 1))], axis=-1) @ back.T
        return np.asarray(at[..., :2] / at[..., 2:])


def put(canvas: Pixels, marks: FaceMarks, pose: Pose, finer: int) -> None:
    """The board into a picture that is `finer` times as fine as the photo."""
    picture, from_mm = picture_of(marks)
    size = canvas.shape[1] // finer, canvas.shape[0] // finer
    # A smooth map: worked out for each eighth pixel, one cell beyond the edges.
    rows, columns = (-(-side // CELL) + 2 for side in canvas.shape)
    v, u = np.mgrid[:rows, :columns] * float(CELL) - CELL / 2 - 0.5
    at = pose.plane_at(marks, size, (np.stack([u, v], axis=-1) + 0.5) / finer - 0.5)
    level = int(np.floor(np.log2(max(1.0, max(picture.shape) / (pose.share * max(canvas.shape))))))
    for _ in range(level):
        picture = cv2.resize(picture, (picture.shape[1] // 2, picture.shape[0] // 2), interpolation=cv2.INTER_AREA)
    coarse = (((at @ from_mm[:2, :2].T + from_mm[:2, 2]) + 0.5) / 2**level - 0.5).astype(np.float32)
    source = cv2.resize(coarse, (CELL * columns, CELL * rows), interpolation=cv2.INTER_LINEAR)
    source = source[CELL : CELL + canvas.shape[0], CELL : CELL + canvas.shape[1]]
    got = cv2.remap(picture, source[..., 0], source[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    height, width = picture.shape
    inside = (
        (source[..., 0] > -0.5)
        & (source[..., 1] > -0.5)
        & (source[..., 0] < width - 0.5)
        & (source[..., 1] < height - 0.5)
    )
    canvas[inside] = got[inside]


def photo_of(
    marks: FaceMarks,
    pose: Pose,
    rng: np.random.Generator,
    *,
    size: tuple[int, int] = (800, 600),
    clutter: tuple[FaceMarks, ...] = (),
    covers: int = 0,
    blur_px: float = 0.7,
    noise: float = 2.0,
    finer: int = 2,
    is_there: bool = True,
) -> BoardPhoto:
    """A photo of a board before textures, other boards and stray markers, with covers on it."""
    canvas = (
        _background(rng, size, finer)
        if clutter or covers
        else np.full((size[1] * finer, size[0] * finer), 110, np.uint8)
    )
    for other in clutter:
        put(canvas, other, random_pose(rng, share=(0.15, 0.5)), finer)
    if is_there:
        put(canvas, marks, pose, finer)
    point = pose.project(marks, size, marks.position_mm)
    hidden = np.zeros(canvas.shape, dtype=np.uint8)
    for _ in range(covers):
        _cover(canvas, hidden, rng, finer, point)
    smooth = cv2.resize(canvas, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    smooth = cv2.GaussianBlur(smooth, (0, 0), blur_px) if blur_px > 0 else smooth
    v, u = np.mgrid[: size[1], : size[0]]
    way = rng.uniform(-0.25, 0.25, 2)
    light = 0.8 + way[0] * (u / size[0] - 0.5) + way[1] * (v / size[1] - 0.5)
    grey = (smooth * 0.85 + 18) * light + rng.normal(0, noise, smooth.shape)
    near = cv2.dilate(hidden, np.ones((6 * finer + 1, 6 * finer + 1), np.uint8))
    at = np.round((point + 0.5) * finer - 0.5).astype(int)
    edge = 4 * finer
    inside = ((at >= edge) & (at < np.array(canvas.shape[::-1]) - edge)).all(axis=1)
    visible = inside.copy()
    visible[inside] = near[at[inside, 1], at[inside, 0]] == 0
    return BoardPhoto(np.clip(grey, 0, 255).astype(np.uint8), point, visible & is_there)


def random_pose(rng: np.random.Generator, share: tuple[float, float] = (0.3, 1.3)) -> Pose:
    """Any."""
    return Pose(
        share=float(rng.uniform(*share)),
        tilt_rad=float(np.radians(rng.uniform(0, 62))),
        tilt_way_rad=float(rng.uniform(0, 2 * np.pi)),
        turn_rad=float(rng.normal(0, 0.5)) if rng.random() < 0.7 else float(rng.uniform(0, 2 * np.pi)),
        middle=(float(rng.uniform(0.2, 0.8)), float(rng.uniform(0.2, 0.8))),
        k1=float(rng.uniform(-0.35, 0.1)) if rng.random() < 0.5 else 0.0,
    )


def _background(rng: np.random.Generator, size: tuple[int, int], finer: int) -> Pixels:
    """Stripes, checks, blots or letters."""
    width, height = size[0] * finer, size[1] * finer
    v, u = np.mgrid[:height, :width]
    kind = int(rng.integers(4))
    if kind == 0:
        return np.full((height, width), int(rng.integers(30, 230)), np.uint8)
    if kind == 1:
        step = int(rng.integers(16, 90))
        return np.where((u // step + v // step) % 2 == 0, 60, 200).astype(np.uint8)
    if kind == 2:
        rough = rng.uniform(0, 255, (int(rng.integers(10, 80)), int(rng.integers(10, 80)))).astype(np.uint8)
        return np.asarray(cv2.resize(rough, (width, height), interpolation=cv2.INTER_CUBIC), dtype=np.uint8)
    page = np.full((height, width), 220, np.uint8)
    for _ in range(60):
        at = int(rng.integers(width)), int(rng.integers(height))
        cv2.putText(page, "ring solid", at, 1, float(rng.uniform(1, 5)), int(rng.integers(90)), int(rng.integers(1, 5)))
        corner = at[0] + int(rng.integers(10, 120)), at[1] + int(rng.integers(10, 120))
        cv2.rectangle(page, at, corner, int(rng.integers(255)), -1 if rng.random() < 0.4 else 2)
    return page


def _cover(canvas: Pixels, hidden: Pixels, rng: np.random.Generator, finer: int, point: Array) -> None:
    """A finger, a blank sticker, or a stray marker on one, somewhere on the board."""
    x, y = ((point[int(rng.integers(len(point)))] + rng.normal(0, 12, 2) + 0.5) * finer).tolist()
    long, short = rng.uniform(15, 60) * finer, rng.uniform(8, 30) * finer
    kind, angle = int(rng.integers(3)), float(rng.uniform(0, 180))
    if kind == 0:
        for image, level in ((canvas, int(rng.integers(60, 190))), (hidden, 255)):
            cv2.ellipse(image, (int(x), int(y)), (int(2 * long), int(short)), angle, 0, 360, level, -1)
        return
    side = long if kind == 2 else short
    box = np.asarray(cv2.boxPoints(((x, y), (2 * long, 2 * side), angle)), dtype=np.float32)
    cv2.fillConvexPoly(canvas, box.astype(np.int32), int(rng.integers(150, 255)))
    cv2.fillConvexPoly(hidden, box.astype(np.int32), 255)
    if kind == 2:
        name = str(rng.choice(["DICT_5X5_100", "DICT_4X4_50", "DICT_APRILTAG_36h11", "DICT_6X6_250"]))
        marker = cv2.aruco.generateImageMarker(dictionary(name), int(rng.integers(30)), 64)
        marker = np.pad(marker, 10, constant_values=255)
        full = np.array([[0, 0], [83, 0], [83, 83], [0, 83]], dtype=np.float32)
        there = cv2.getPerspectiveTransform(full, box)
        size = canvas.shape[1], canvas.shape[0]
        warped = cv2.warpPerspective(marker, there, size, flags=cv2.INTER_AREA)
        inside = cv2.warpPerspective(np.full_like(marker, 255), there, size) > 200
        canvas[inside] = warped[inside]
