"""The camera that undistorted photos are of: a pinhole, or a picture by angles for what no pinhole shows.

A pinhole's picture grows with the tangent of the angle off its axis, and ends before 90 degrees. Pictures by angles, a
cylinder or longitude and latitude, hold all that a wide lens sees in about as many pixels as the photo has.
"""

import math
from dataclasses import replace

import numpy as np

from calib.cameras import LINEAR, pictures, rays
from calib.cameras.camera import MAX_SIDE_PX, Camera, linear_part
from calib.cameras.refit import image_grid
from calib.cameras.undistortion import pinhole_of
from calib.core.se3 import exp_rotation
from designer.base.arrays import Array
from designer.base.errors import InputError

WIDEST_PINHOLE_RAD = math.radians(170)
NEAR_HORIZON_RAD = math.radians(45)
"""Directions nearer to the horizon tell how wide a picture has to be; near a pole one has any longitude."""
COLUMNS = 240
"""Of the grid that tells what the photos show."""
MOST_PIXELS = 2**28


def picture_of(
    camera: Camera,
    to: str = LINEAR,
    *,
    alpha: float | None = None,
    focal_px: float | None = None,
    field_rad: float | None = None,
    cam_from_new: Array | None = None,
) -> Camera:
    """The camera of undistorted photos: `picture_of(camera, field_rad=2.0)`.

    Args:
        camera: of the photos.
        to: one of `calib.cameras.pictures()`.
        alpha: of a pinhole along the camera's axis, see `pinhole_of`.
        focal_px: along u, in px, or of pictures by angles in px per radian. None: as in the middle of the photos.
        field_rad: the horizontal field of view, the axis in its middle. None: of a pinhole as the focal length and the
            photo's size have it; of others what the photos show.
        cam_from_new: where the new camera looks.  # (3, 3) None: along the camera's axis

    Raises:
        InputError: wishes that contradict each other, or a picture that cannot be.
    """
    is_plain = to == LINEAR and cam_from_new is None
    if alpha is not None and not (is_plain and focal_px is None and field_rad is None):
        raise InputError(
            f"--alpha {alpha:g}: is for a {LINEAR} that looks along the axis of the camera and has no other wishes; "
            "give --field, or --alpha alone"
        )
    if is_plain and field_rad is None:
        return pinhole_of(camera, alpha=alpha, focal_px=focal_px)
    if to == LINEAR:
        return _turned_pinhole(camera, focal_px, field_rad)
    return _by_angles(camera, to, focal_px, field_rad, np.eye(3) if cam_from_new is None else cam_from_new)


def looking(yaw_rad: float, pitch_rad: float) -> Array:
    """The rotation `cam_from_new` of a camera that is turned to the right, then up.  # (3, 3)"""
    rotation: Array = exp_rotation(np.array([0.0, yaw_rad, 0.0])) @ exp_rotation(np.array([pitch_rad, 0.0, 0.0]))
    return rotation


def _turned_pinhole(camera: Camera, focal_px: float | None, field_rad: float | None) -> Camera:
    """A pinhole of the photo's size with its axis in the middle."""
    same = linear_part(camera)
    width, height = camera.image_size
    if field_rad is not None:
        if focal_px is not None:
            raise InputError(f"--focal-px and --field both set the focal length of a {LINEAR}; give one of them")
        if not field_rad <= WIDEST_PINHOLE_RAD:
            others = " or ".join(name for name in pictures() if name != LINEAR)
            raise InputError(
                f"--field {math.degrees(field_rad):g}deg: a {LINEAR} shows less than 180 degrees, and little from "
                f"{math.degrees(WIDEST_PINHOLE_RAD):g} on; give less, or --to {others}"
            )
        focal_px = width / 2 / math.tan(field_rad / 2)
    fx, fy = same.params[:2]
    u = fx if focal_px is None else focal_px
    return replace(same, params=np.array([u, u * fy / fx, (width - 1) / 2, (height - 1) / 2]))


def _by_angles(camera: Camera, to: str, focal_px: float | None, field_rad: float | None, cam_from_new: Array) -> Camera:
    """A picture with square pixels that holds what the photos show, or as much of it as was asked for."""
    ray = rays(camera, image_grid(camera.image_size, COLUMNS)).reshape(-1, 3) @ cam_from_new
    x, y, z = ray[np.isfinite(ray[:, 2])].T
    if not len(x):
        raise InputError("the camera knows no light anywhere in its image; check the camera file")
    focal = float(linear_part(camera).params[0]) if focal_px is None else focal_px
    picture = Camera(to, np.array([focal, focal, 0.0, 0.0]), (1, 1))
    latitude, longitude = np.arctan2(y, np.hypot(x, z)), np.arctan2(x, z)
    flat = np.abs(latitude) < NEAR_HORIZON_RAD
    across = longitude[flat] if flat.any() else np.array([-math.pi, math.pi])
    if field_rad is not None:
        across = np.array([-0.5, 0.5]) * field_rad
    highest = math.radians(pictures()[to].highest_deg)
    down = np.clip([latitude.min(), latitude.max()], -highest, highest)
    return _framed(picture, (float(across.min()), float(across.max())), (float(down[0]), float(down[1])))


def _framed(picture: Camera, across_rad: tuple[float, float], down_rad: tuple[float, float]) -> Camera:
    """The picture with a frame around longitudes and latitudes."""
    corner = [
        np.array([math.cos(down) * math.sin(across), math.sin(down), math.cos(down) * math.cos(across)])
        for across, down in zip(across_rad, down_rad, strict=True)
    ]
    (left, upper), (right, lower) = (picture.project(one) for one in corner)
    size = math.ceil(right - left), math.ceil(lower - upper)
    if not 1 <= min(size) <= max(size) <= MAX_SIDE_PX or size[0] * size[1] > MOST_PIXELS:
        raise InputError(f"a picture of {size[0]} x {size[1]} px: is too large or empty; give --focal-px or --field")
    centre = -np.array([left, upper]) - 0.5
    return Camera(picture.model, np.concatenate([picture.params[:2], centre]), size)
