"""Two cameras of one image: one expressed in the model of the other, and how far two differ.

The rays of the first camera at a grid of pixels are projected by the second, whose parameters are the least-squares
fit in pixels over the whole image. What no choice of parameters takes away is the residual, which is always reported.

Light that reaches a pixel of camera A comes from a direction; a second calibration of the same camera sees that
direction in another pixel. The frames of two calibrations need not be parallel, so directions are first turned by the
rotation that makes the differences least (as `mrcal.projection_diff` does for far points; mrcal's documentation,
"A method to compare camera models").
"""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from calib.cameras import (
    ABILITIES,
    MODELS,
    WIDE,
    fitted_models,
    is_allowed,
    linearise,
    neutral,
    parameter_names,
    project,
    rays,
)
from calib.cameras.camera import Camera
from calib.core.linear_algebra import least_squares
from calib.core.se3 import angles_between, exp_rotation, log_rotation, nearest_rotation
from calib.core.types import freeze
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError

COLUMNS = 60
FOCAL_AND_CENTRE = 4
MIN_PIXELS = 20
STAGES = 16
FIRST_RADIUS = 0.3
MAX_STEPS = 200
MAX_DAMPING = 1e12
CONVERGED = 1e-12
"""A step that lowers the sum of squares by less than this part is the last."""
NEARLY, NEARLY_PX = 1e-3, 1e-4
"""Likewise on the way out to the whole image, where the next stage goes on; and a distance that will do there."""
FEWEST_PIXELS = 3
TURN_STEPS = 10
SAME_RAYS = 1e-12
"""Between unit directions that are one but for rounding."""


@dataclass(frozen=True, eq=False)
class Refit:
    """A camera fitted to the rays of another."""

    camera: Camera
    new_from_old: Array  # (3, 3) rotation between the cameras' frames; the identity unless it was fitted
    rms_px: float
    max_px: float
    known: float  # part of the image where the first camera has rays, 0 to 1

    def __post_init__(self) -> None:
        freeze(self, "new_from_old")

    @property
    def turn_rad(self) -> float:
        """How far the frame was turned."""
        return float(np.linalg.norm(log_rotation(self.new_from_old)))

    @property
    def is_exact(self) -> bool:
        """Whether the second camera is the first in other words."""
        return self.max_px == 0 and self.known == 1


def image_grid(image_size: tuple[int, int], columns: int = COLUMNS, rows: int | None = None) -> Array:
    """Pixels (rows, columns, 2), evenly spaced from the first pixel's centre to the last's; about square by default."""
    width, height = image_size
    rows = max(2, round(height / width * columns)) if rows is None else rows
    u, v = np.meshgrid(np.linspace(0, width - 1, columns), np.linspace(0, height - 1, rows))
    return np.stack([u, v], axis=-1)


def refit(camera: Camera, model: str, *, zero: Collection[str] = (), turn: bool = False) -> Refit:
    """The camera in another model, or in its own with some parameters at zero.

    Args:
        camera: of any model.
        model: one of `calib.cameras.fitted_models()`.
        zero: lens parameters that must be 0.
        turn: let the frame turn; a learned map's sensor plane need not be parallel to the image.

    Raises:
        InputError: the first camera has no rays, or the second cannot take them.
    """
    same = in_other_words(camera, model, zero=zero)
    if same is not None:
        return Refit(same, np.eye(3), 0.0, 0.0, 1.0)
    pixel = image_grid(camera.image_size).reshape(-1, 2)
    result = fit_rays(pixel, rays(camera, pixel), camera.image_size, model, zero=zero, turn=turn)
    return replace(result, camera=replace(result.camera, field_rad=camera.field_rad))  # the light ends where it did


def in_other_words(camera: Camera, model: str, *, zero: Collection[str] = ()) -> Camera | None:
    """The same camera in another model, where that takes no fit; None where it does.

    So it is where parameters of the same names show every pixel the same light, and what only one of the two models has
    does nothing: a lens of a family that the other goes on from, or no lens. Whether a lens that does nothing is none
    depends on the model: of a fisheye the angle is left, not its tangent.
    """
    if camera.learned is not None:
        return None
    own, at_rest, other = camera.parameters, _at_rest(camera.model), _at_rest(model)
    if any(value != at_rest[name] and (name not in other or name in zero) for name, value in own.items()):
        return None
    if camera.model == model:
        return camera
    same = replace(camera, model=model, params=np.array([own.get(name, value) for name, value in other.items()]))
    return same if is_allowed(same) and _is_same(camera, same) else None


def _is_same(a: Camera, b: Camera) -> bool:
    """Whether two cameras see alike wherever one of them does."""
    pixel = image_grid(a.image_size)
    of_a, of_b = rays(a, pixel), rays(b, pixel)
    return np.allclose(of_a, of_b, rtol=0, atol=SAME_RAYS, equal_nan=True)


def _at_rest(model: str) -> dict[str, float]:
    """The parameters of a lens that does nothing."""
    return dict(zip(parameter_names(model), neutral(model).tolist(), strict=True))


def fit_rays(
    pixel: Array, ray: Array, image_size: tuple[int, int], model: str, *, zero: Collection[str] = (), turn: bool = False
) -> Refit:
    """A camera that sees directions (N, 3) in pixels (N, 2); nan where a direction is not known."""
    known = np.isfinite(ray).all(axis=1)
    if known.sum() < MIN_PIXELS:
        raise InputError(
            f"the camera has rays at {known.sum()} of {len(ray)} pixels looked at; "
            f"a fit over the image needs {MIN_PIXELS}, so check its parameters"
        )
    seen, direction = pixel[known], ray[known]
    rotation = _frame_of_image(seen, direction, image_size) if turn else np.eye(3)
    direction = direction @ rotation.T
    if not ABILITIES[model].is_wide and not (direction[:, 2] > 0).all():
        wide = ", ".join(name for name in fitted_models() if ABILITIES[name].is_wide)
        raise InputError(
            f"the camera sees more than a half space, which model {model} with its focal plane cannot; there are {wide}"
        )
    camera, last = _without_lens(seen, direction, image_size, model), np.eye(3)
    is_free = np.array([name not in zero for name in parameter_names(model)])
    off_centre = _off_centre(seen, image_size)
    # Outwards from the centre: a lens fitted at once to a wide image stops where its polynomial folds over a corner.
    for part in np.linspace(FIRST_RADIUS, 1, STAGES):
        inner = off_centre <= part * off_centre.max()
        camera = _unfolded(camera, seen[inner], direction[inner] @ last.T)
        enough, good = (NEARLY, inner.sum() * NEARLY_PX**2) if part < 1 else (CONVERGED, 0.0)
        camera, last = _adjust(camera, last, is_free, turn, seen[inner], direction[inner], enough, good)
    error = np.linalg.norm(project(camera, direction @ last.T) - seen, axis=1)
    if not np.isfinite(error).all():
        raise InputError(
            f"no lens of model {model} sees as far off the axis as the camera does: {MODELS[model].remedy}"
        )
    return Refit(camera, last @ rotation, float(np.sqrt(np.mean(error**2))), float(error.max()), float(known.mean()))


def _off_centre(pixel: Array, image_size: tuple[int, int]) -> Array:
    """Distances (N,) of pixels from the image's centre."""
    distance: Array = np.linalg.norm(pixel - (np.array(image_size) - 1) / 2, axis=1)
    return distance


def _nearest_to_centre(pixel: Array, image_size: tuple[int, int]) -> Rows:
    """Rows of the quarter of the pixels nearest to the image's centre."""
    return np.argsort(_off_centre(pixel, image_size), kind="stable")[: max(MIN_PIXELS, len(pixel) // 4)]


def _frame_of_image(pixel: Array, ray: Array, image_size: tuple[int, int]) -> Array:
    """The rotation after which the image's centre is seen along z, and its rows along x."""
    rows = _nearest_to_centre(pixel, image_size)
    centre = (np.array(image_size) - 1) / 2
    unit = ray[rows] / np.linalg.norm(ray[rows], axis=1, keepdims=True)
    offset = np.column_stack([np.ones(len(rows)), pixel[rows] - centre])
    forward, right, _ = least_squares(offset, unit)
    forward /= np.linalg.norm(forward)
    right -= forward * (right @ forward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])


def _without_lens(pixel: Array, ray: Array, image_size: tuple[int, int], model: str) -> Camera:
    """The linear camera that fits best near the image's centre."""
    rows = _nearest_to_centre(pixel, image_size)
    slope = ray[rows, :2] / ray[rows, 2:]
    params = neutral(model)
    for axis in range(2):
        columns = np.column_stack([slope[:, axis], np.ones(len(rows))])
        params[[axis, 2 + axis]] = least_squares(columns, pixel[rows, axis])
    if not (params[:2] > 0).all():
        raise InputError("the camera's rays do not follow its pixels (mirrored, or all alike); check its parameters")
    return Camera(model, params, image_size)


def _unfolded(camera: Camera, pixel: Array, ray: Array) -> Camera:
    """The camera with its lens weakened until it takes all rays; without a lens it does."""
    for _ in range(MAX_STEPS):
        if np.isfinite(_cost(camera, np.eye(3), pixel, ray)):
            break
        params, none = camera.params.copy(), neutral(camera.model)
        params[FOCAL_AND_CENTRE:] = 0.8 * params[FOCAL_AND_CENTRE:] + 0.2 * none[FOCAL_AND_CENTRE:]
        camera = replace(camera, params=params)
    return camera


def _adjust(
    camera: Camera, rotation: Array, is_free: Flags, turn: bool, pixel: Array, ray: Array, enough: float, good: float
) -> tuple[Camera, Array]:
    """Levenberg-Marquardt on the free parameters and, if asked for, the rotation.

    It ends with a step that lowers the sum of squares by less than the part that is enough, or at one that is good.
    """
    damping = 1e-6
    cost = _cost(camera, rotation, pixel, ray)
    for _ in range(MAX_STEPS):
        jacobian, residual = _equations(camera, rotation, is_free, turn, pixel, ray)
        scale = np.linalg.norm(jacobian, axis=0)
        scale[scale == 0] = 1.0
        normal = (jacobian / scale).T @ (jacobian / scale)
        gradient = (jacobian / scale).T @ residual
        before = cost
        while damping < MAX_DAMPING:
            step = np.linalg.solve(normal + damping * np.eye(len(normal)), -gradient) / scale
            params = camera.params.copy()
            params[is_free] += step[: is_free.sum()]
            moved = replace(camera, params=params)
            turned = exp_rotation(step[is_free.sum() :]) @ rotation if turn else rotation
            new_cost = _cost(moved, turned, pixel, ray)
            if new_cost < cost:
                camera, rotation, cost, damping = moved, turned, new_cost, max(damping / 10, 1e-14)
                break
            damping *= 10
        if cost <= good or not cost < before * (1 - enough):
            break
    return camera, rotation


def _cost(camera: Camera, rotation: Array, pixel: Array, ray: Array) -> float:
    """Sum of squares in px^2; infinite where no step must lead: beyond bounds, or a ray cannot be projected."""
    if not is_allowed(camera):
        return np.inf
    total = float(np.sum((project(camera, ray @ rotation.T) - pixel) ** 2))
    return total if np.isfinite(total) else np.inf


def _equations(
    camera: Camera, rotation: Array, is_free: Flags, turn: bool, pixel: Array, ray: Array
) -> tuple[Array, Array]:
    """Jacobian (2N, free + 3) by parameters and a small turn, and residuals (2N,)."""
    point = np.ascontiguousarray((ray @ rotation.T).T)
    linear = linearise(camera, point)
    columns = [np.swapaxes(linear.by_params[:, is_free], 1, 2).reshape(-1, int(is_free.sum()))]
    if turn:
        # A turn by w moves a point y by w x y, so a gradient g by y has the gradient y x g by w.
        columns.append(np.vstack([np.cross(point, gradient, axis=0).T for gradient in linear.by_point]))
    return np.hstack(columns), (linear.pixel - pixel.T).reshape(-1)


@dataclass(frozen=True, eq=False)
class CameraDifference:
    """The difference of camera B from camera A, on a grid of A's pixels."""

    image_size: tuple[int, int]
    pixel: Array  # (R, C, 2) in A
    difference_px: Array  # (R, C, 2) where B sees the same direction, less where A does; nan where either does not
    angle_rad: Array  # (R, C) between the directions that both see in the same pixel; nan where either does not
    b_from_a: Array  # (3, 3) the rotation removed
    radius_px: float  # about the image's centre, of the pixels that the rotation was fitted to; 0: none was

    def __post_init__(self) -> None:
        freeze(self, "pixel", "difference_px", "angle_rad", "b_from_a")

    @property
    def length_px(self) -> Array:
        """Lengths (R, C)."""
        length: Array = np.linalg.norm(self.difference_px, axis=-1)
        return length

    @property
    def off_centre_px(self) -> Array:
        """Distances (R, C) of the pixels from the image's centre."""
        off: Array = np.linalg.norm(self.pixel - image_centre(self.image_size), axis=-1)
        return off

    @property
    def largest(self) -> tuple[Array, Array]:
        """The pixel (2,) where the difference is largest, and the difference (2,) there."""
        at = np.unravel_index(np.nanargmax(self.length_px), self.length_px.shape)
        return self.pixel[at], self.difference_px[at]

    @property
    def turn_rad(self) -> float:
        """How far the frames are turned against each other."""
        return float(np.linalg.norm(log_rotation(self.b_from_a)))


def image_centre(image_size: tuple[int, int]) -> Array:
    """The pixel (2,) in the middle."""
    return (np.array(image_size, dtype=np.float64) - 1) / 2


def camera_difference(a: Camera, b: Camera, *, radius_px: float | None = None, columns: int = 60) -> CameraDifference:
    """The difference of two cameras.

    Args:
        a: the camera whose pixels are looked at.
        b: another camera of the same image size.
        radius_px: fit the rotation to pixels this near to the image's centre; 0: fit none; None: to the whole image.
        columns: of the grid.

    Raises:
        InputError: other image sizes, or too few pixels where both cameras have rays.
    """
    if a.image_size != b.image_size:
        sizes = " and ".join(f"{width} x {height}" for width, height in (a.image_size, b.image_size))
        raise InputError(f"cameras of {sizes} pixels cannot be compared; both must belong to images of one size")
    pixel = image_grid(a.image_size, columns)
    flat = pixel.reshape(-1, 2)
    ray_a, ray_b = rays(a, flat), rays(b, flat)
    radius = float(np.hypot(*a.image_size)) if radius_px is None else radius_px
    rotation = np.eye(3)
    if radius > 0:
        near = np.linalg.norm(flat - image_centre(a.image_size), axis=1) <= radius
        near &= np.isfinite(ray_a).all(axis=1) & np.isfinite(ray_b).all(axis=1)
        if near.sum() < FEWEST_PIXELS:
            raise InputError(
                f"both cameras have rays at {near.sum()} of the pixels looked at; a rotation needs {FEWEST_PIXELS}: "
                "use a larger radius, or 0 for no rotation"
            )
        rotation = _least_squares_turn(b, flat[near], ray_a[near], _nearest_turn(ray_a[near], ray_b[near]))
    difference = _near_image(project(b, ray_a @ rotation.T), b) - flat
    if not np.isfinite(difference).all(axis=1).any():
        raise InputError("the cameras share no pixel that both know the light of; check that they are of one lens")
    angle = np.where(np.isfinite(difference[:, 0]), angles_between(ray_a @ rotation.T, ray_b), np.nan)
    angle = angle.reshape(pixel.shape[:2])
    return CameraDifference(a.image_size, pixel, difference.reshape(pixel.shape), angle, rotation, radius)


def _near_image(pixel: Array, camera: Camera) -> Array:
    """Pixels (N, 2), nan of those farther from the image than half its sides: there a formula goes on, and no lens."""
    size = np.array(camera.image_size)
    is_near = (np.abs(pixel - (size - 1) / 2) < size).all(axis=1, keepdims=True)
    return np.where(is_near, pixel, np.nan)


def _nearest_turn(ray_a: Array, ray_b: Array) -> Array:
    """The rotation that brings the unit directions (N, 3) of A nearest to those of B (Kabsch 1976)."""
    unit_a, unit_b = (ray / np.linalg.norm(ray, axis=1, keepdims=True) for ray in (ray_a, ray_b))
    return nearest_rotation(unit_b.T @ unit_a)


def _least_squares_turn(camera: Camera, pixel: Array, ray: Array, rotation: Array) -> Array:
    """The rotation, from one close to it, that makes the squares of the differences in pixels least: Gauss-Newton."""
    for _ in range(TURN_STEPS):
        point = np.ascontiguousarray((ray @ rotation.T).T)
        linear = linearise(camera, point)
        # A turn by w moves a point y by w x y, so a gradient g by y has the gradient y x g by w.
        jacobian = np.vstack([np.cross(point, gradient, axis=0).T for gradient in linear.by_point])
        residual = (_near_image(linear.pixel.T, camera).T - pixel.T).reshape(-1)
        seen = np.isfinite(residual)
        step = least_squares(jacobian[seen], -residual[seen])
        rotation = exp_rotation(step) @ rotation
        if np.linalg.norm(step) < 1e-14:
            break
    return rotation


def plain_camera(model: str, image_size: tuple[int, int], focal_px: float) -> Camera:
    """A camera without distortion, its principal point in the middle of the image."""
    params = neutral(model)
    params[:4] = focal_px, focal_px, 0.5 * (image_size[0] - 1), 0.5 * (image_size[1] - 1)
    return Camera(model, params, image_size)


def even_camera(image_size: tuple[int, int], field_rad: float) -> Camera:
    """The wide camera whose angle off the axis grows evenly from corner to corner of the image."""
    return plain_camera(WIDE, image_size, float(np.hypot(*image_size)) / field_rad)
