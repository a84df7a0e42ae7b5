"""What a server may say to the live page: a board before a camera, as it is and as it is to be held."""

import math
from dataclasses import replace

import numpy as np

from calib.cameras import project
from calib.capture.messages import GuidanceMessage, LookMessage, SourceKind, SourceState, StateMessage
from calib.core.se3 import transform
from calib.judge.guidance import Bar, CameraGuidance, Ghost, Guidance, Look, SensorMap, Stage, TakenPhoto
from designer.base.arrays import Array
from designer.page.scene import scene_json
from designer.target_scene import target_scene
from tests.support.calibrations import board, camera

SIZE = (1280, 720)
BOARD = board(9, 7, "12mm")
CAMERA = camera("opencv", SIZE, 1150.0)
SHORT = "bottom left, right side back, 0.45 m"


def state(kind: SourceKind = "browser") -> StateMessage:
    """Photos are taken of a board."""
    source = SourceState(kind, "camera 0", "")
    return StateMessage("taking", "board, 120 x 96 mm, 63 rings", "photos-1", (source,), True, True, None, "")


def pose(across_mm: float, down_mm: float, distance_mm: float, tilt_deg: float, roll_deg: float = 0.0) -> Array:
    """The board somewhere before the camera, its right side back by the tilt.  # (4, 4)"""
    a, b = math.radians(tilt_deg), math.radians(roll_deg)
    # The board's y is up in the photo, its front towards the camera.
    flip = np.diag([1.0, -1.0, -1.0])
    turn = np.array([[math.cos(a), 0, -math.sin(a)], [0, 1, 0], [math.sin(a), 0, math.cos(a)]])
    roll = np.array([[math.cos(b), -math.sin(b), 0], [math.sin(b), math.cos(b), 0], [0, 0, 1]])
    placed = np.eye(4)
    placed[:3, :3] = roll @ turn @ flip
    placed[:3, 3] = across_mm, down_mm, distance_mm
    return placed


def outline(cam_from_target: Array) -> tuple[Array, ...]:
    """The board's border in the image."""
    corners = np.c_[BOARD.outline_mm[0], np.zeros(len(BOARD.outline_mm[0]))]
    return (project(CAMERA, transform(cam_from_target @ BOARD.target_from_face[0], corners)),)


GHOST_POSE = pose(-90.0, 50.0, 420.0, 30.0)


def ghost() -> Ghost:
    """At the bottom left."""
    return Ghost(
        GHOST_POSE, "hold the board at the bottom left, tilted 30 deg with its right side away from the camera, "
        "at about 0.45 m: 95 % sigma 0.21 -> 0.13 px", SHORT, 432.0, 30.0, "0.21 → 0.13 px", False,
    )  # fmt: skip


def sensor_map(seed: int = 0) -> SensorMap:
    """Good in the middle, unknown in a corner."""
    v, u = np.mgrid[-1:1:16j, -1:1:24j]
    sigma = 0.03 * np.exp(2.2 * np.hypot(u - 0.2, v + 0.1) ** 2)
    sigma[-3:, :3] = np.nan
    return SensorMap(sigma, np.hypot(u, v) < 0.9, 0.05)


def photo(number: int, *, is_counted: bool = True, remark: str = "") -> TakenPhoto:
    """One that shows the board in another place each time."""
    at = pose(60.0 * math.cos(number), 30.0 * math.sin(number), 420.0 + 20 * number, 10.0 * number)
    return TakenPhoto(f"{number:04d}.png", 63, is_counted, remark, outline(at))


def guidance(photos: int = 4, stage: Stage = "guiding") -> GuidanceMessage:
    """After some photos."""
    bars = (
        Bar("uncertainty", "uncertainty", "0.21 px, 0.05 px wanted", 0.35, "bad"),
        Bar("coverage", "coverage", "58 %, 70 % wanted", 0.83, "usable"),
        Bar("halves", "halves agree", "0.9 sigma", 1.0, "good"),
        Bar("views", "photos", f"{photos} of 6 at least", min(1.0, photos / 6), "unknown"),
    )
    one = CameraGuidance("camera 0", SIZE, sensor_map() if photos else None, outline(GHOST_POSE))
    headline = f"0.21 px in 95 % of the image, 0.05 px wanted; {photos} photos" if photos else "no camera yet"
    taken = tuple(photo(n + 1) for n in range(photos))
    told = Guidance(stage, headline, bars if photos else (), (one,), ghost(), taken, ())
    return GuidanceMessage(told, scene_json(target_scene(BOARD, body_colour="#ffffff", ink_colour="#101010")), ())


def look(
    number: int = 0, cam_from_target: Array | None = None, *, worth: float = 0.3, still: float = 0.0
) -> LookMessage:
    """Of a frame that shows the board; at the ghost, unless told otherwise."""
    at = GHOST_POSE if cam_from_target is None else cam_from_target
    centers = project(CAMERA, transform(at, BOARD.center_mm))
    radius = float(np.mean(BOARD.radius_outer_mm)) * 1150.0 / float(at[2, 3])
    rings = np.c_[centers, np.full(len(centers), radius)]
    is_match = worth >= 0.95
    told = Look(
        at, outline(at), worth, is_match, "" if is_match else "closer, and tilt the right side away", (), is_match
    )
    return LookMessage(0, number, (rings,), ((float(centers[31, 0]), float(centers[31, 1]), "board"),), told, still)


def nothing_seen(number: int = 0) -> LookMessage:
    """Of a frame without a target."""
    shown = look(number)
    none = Look(None, (), 0.0, False, "", (), False)
    return replace(shown, rings_px=(), labels=(), look=none)
