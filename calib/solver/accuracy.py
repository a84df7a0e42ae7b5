"""How sure a solution is: covariances at the minimum, in the image, and why data do not determine a camera.

A camera that is turned a little shows the same with its poses turned back. So of every change of the parameters the
rotation that best explains it over the image is taken off, as mrcal does ("projection uncertainty"), with the points at
infinity: what remains is the error of the angles between directions.
"""

import math
from dataclasses import dataclass

import numpy as np

from calib.cameras import linearise, neutral, parameter_names, rays, told_parameters
from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.core.linear_algebra import least_squares, moved_covariance, worse_sigma
from calib.core.types import Observations
from calib.solver.levenberg import Minimum
from calib.solver.linear_pose import FLAT
from calib.solver.outliers import MEDIAN_LENGTH
from calib.solver.problem import Tie
from calib.solver.schur import reduced_normal
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import NoAnswerError

GRID = (24, 18)
"""Pixels over which the best rotation is found."""
SHARE_PERCENT = 95
"""Of the image, where one number stands for all of it."""
UNSURE_FOCAL = 0.05
"""Standard deviation of a focal length, as a part of it, that is no measurement."""
NO_FIT = 0.03
"""Median residual, as a part of the image's longer side, that no lens explains."""
SINGULAR = 1e-13
LITTLE_TILT_DEG = 5.0
LONG, PARALLEL = 0.06, 0.01
"""Of the image's longer side to the focal length: lenses so long hardly show their centre and distortion, and if their
focal length is not told either, nothing tells their rays from parallel ones."""


@dataclass(frozen=True, eq=False)
class Accuracy:
    """What is known of the unknowns, with the posterior scale factor in it; nan where they are not determined."""

    scale: float  # sqrt(sum of squares / redundancy)
    param_covariance: Array  # (P, P)
    pose_covariance: Array  # (V, 6, 6)
    weakest: Array  # (P,) the least determined direction, each parameter in units of its own conditional deviation
    weakest_eigenvalue: float  # of the normal matrix with a diagonal of ones; 0: not determined


def accuracy_of(
    products: Array, tie: Rows, used: int, robust: tuple[float, float] | None = None, prior: Array | None = None
) -> Accuracy:
    """The covariances of camera and poses.

    With the normal matrix `[A B; B' C]`, that of the camera is `S^-1` of `S = A - B C^-1 B'`, and that of a pose
    `C^-1 + C^-1 B' S^-1 B C^-1`; both times the scale squared.

    Args:
        products: the views' blocks at the minimum (V, P + 7, P + 7).
        tie: the free parameter that each parameter follows (P,); -1: fixed.
        used: observations that count.
        robust: if weights were lowered, the standard deviation of an observation, which the squares then do not tell,
            and the factor that makes the inverse normal matrix a covariance.
        prior: the equations of what is believed beforehand (P + 7, P + 7), as `Blocks.prior`. What it tells of the
            unknowns the photos need not: with its matrix Q that many unknowns less, `tr (S + Q)^-1 Q`.
    """
    views, parameters = len(products), len(tie)
    free = int(tie.max(initial=-1)) + 1
    squares = float(products[:, -1, -1].sum())

    def scale_factor(told: float = 0.0) -> tuple[float, float]:
        redundancy = 2 * used - free + told - 6 * views
        if redundancy <= 0:
            return float("nan"), float("nan")
        scale = float(np.sqrt(squares / redundancy))
        return (scale, scale**2) if robust is None else (robust[0], robust[1] * 2 * used / redundancy)

    scale, factor = scale_factor()
    spread: Array = (tie[:, None] == np.arange(free)).astype(np.float64)  # (P, Q)
    nothing = Accuracy(
        scale, np.full((parameters, parameters), np.nan), np.full((views, 6, 6), np.nan), np.zeros(parameters), 0.0
    )
    try:
        every = products if prior is None else np.concatenate([products, prior[None]])
        normal, inverse_times = reduced_normal(every, tie)
        pose_inverse = np.linalg.inv(products[:, -7:-1, -7:-1])
    except np.linalg.LinAlgError:
        return nothing
    if free == 0:
        return Accuracy(
            scale, np.zeros((parameters, parameters)), np.asarray(factor * pose_inverse), np.zeros(parameters), 1.0
        )
    diagonal = np.diagonal(normal)
    before = np.einsum("vpp->p", every[:, :parameters, :parameters]) @ spread
    # Against what a parameter had before the poses were let free: a direction that they take up whole is close to 0.
    if not (np.isfinite(normal).all() and (before > 0).all() and (diagonal > 0).all()):
        return nothing
    root = np.sqrt(diagonal)
    values, vectors = np.linalg.eigh(normal / (root[:, None] * root))
    weakest_eigenvalue = float(values[0] * min((diagonal / before).min(), 1.0))
    weakest = spread @ vectors[:, 0]
    if not values[0] > 0:
        return Accuracy(scale, nothing.param_covariance, nothing.pose_covariance, weakest, 0.0)
    inverse = (vectors / values) @ vectors.T / (root[:, None] * root)
    if prior is not None:
        scale, factor = scale_factor(float((inverse * (spread.T @ prior[:parameters, :parameters] @ spread)).sum()))
    pose = pose_inverse + inverse_times[:views] @ inverse @ inverse_times[:views].transpose(0, 2, 1)
    return Accuracy(scale, factor * spread @ inverse @ spread.T, factor * pose, weakest, weakest_eigenvalue)


def projected_change(camera: Camera, pixel: Array, over: Array | None = None) -> Array:
    """How each parameter moves where the camera shows the directions it has at pixels (N, 2, P); nan where it has none.

    With G = du/dparams and R = du/drotation at a pixel, and W the least-squares rotation over the image (or over pixels
    `over`) for each parameter, that is `G + R W`.
    """
    everywhere = image_grid(camera.image_size, *GRID).reshape(-1, 2) if over is None else over
    by_params, by_rotation = _derivatives(camera, everywhere)
    seen: Flags = np.asarray(np.isfinite(by_params).all(axis=(1, 2)))
    turn = least_squares(by_rotation[seen].reshape(-1, 3), -by_params[seen].reshape(-1, by_params.shape[2]))
    here_params, here_rotation = _derivatives(camera, pixel)
    change: Array = here_params + here_rotation @ turn
    return change


def projected_sigma_px(camera: Camera, param_covariance: Array, pixel: Array) -> Array:
    """Standard deviations (N,) of the same along their worse axes."""
    return moved_sigma_px(projected_change(camera, pixel), param_covariance)


def moved_sigma_px(change: Array, param_covariance: Array) -> Array:
    """Standard deviations (N,) of what parameters move (N, 2, P), along the worse axes; nan where that is not known."""
    covariance = moved_covariance(change, param_covariance)
    known: Flags = np.asarray(np.isfinite(covariance).all(axis=(1, 2)))
    return np.where(known, worse_sigma(np.where(known[:, None, None], covariance, 0.0)), np.nan)


def sigma_over_image_px(camera: Camera, param_covariance: Array) -> float:
    """What 95 % of the image stays within; infinite if less of it is known."""
    return share_px(projected_sigma_px(camera, param_covariance, image_grid(camera.image_size).reshape(-1, 2)))


def share_px(sigma: Array, pixels: int = 0) -> float:
    """What 95 % of a map of deviations stays within; infinite if less of it is known, nan without a map.

    Args:
        sigma: of what is known.
        pixels: of the whole map, if those that are not known were left out.
    """
    everywhere = np.full(max(len(sigma), pixels), np.inf)
    everywhere[: len(sigma)] = np.where(np.isfinite(sigma), sigma, np.inf)
    return float(np.percentile(everywhere, SHARE_PERCENT, method="inverted_cdf")) if len(everywhere) else math.nan


def _derivatives(camera: Camera, pixel: Array) -> tuple[Array, Array]:
    """Derivatives of the image of each pixel's direction by the parameters (N, 2, P) and by a rotation (N, 2, 3)."""
    ray = rays(camera, pixel)
    known: Flags = np.asarray(np.isfinite(ray).all(axis=1))
    point = np.where(known[:, None], ray, [0.0, 0.0, 1.0])
    seen = linearise(camera, np.ascontiguousarray(point.T))
    by_params = seen.by_params.transpose(2, 0, 1)
    by_rotation = np.cross(point[:, None, :], seen.by_point.transpose(2, 0, 1))
    lost = ~known[:, None, None]
    return np.where(lost, np.nan, by_params), np.where(lost, np.nan, by_rotation)


class UndeterminedError(NoAnswerError):
    """Too few observations for any camera."""


def why_degenerate(observations: Observations, found: Minimum, sigma_px: float, accuracy: Accuracy, tie: Tie) -> str:
    """One line with the reason and the remedy; empty if the camera is determined."""
    # First, because nonsense may also leave next to nothing that counts.
    typical = MEDIAN_LENGTH * sigma_px
    if not typical < NO_FIT * max(observations.image_size):
        return f"residuals of {typical:.3g} px: the points and the pixels do not belong together; check their names"
    if not np.isfinite(accuracy.scale):
        return "as many unknowns as equations: no accuracy can be stated; take more photos"
    sigma = np.sqrt(np.diagonal(accuracy.param_covariance)[:2])
    focal = found.camera.params[:2]
    sure = np.isfinite(sigma).all() and (sigma < UNSURE_FOCAL * focal).all()
    determined = bool(sure and accuracy.weakest_eigenvalue > SINGULAR)
    if determined and found.converged:
        return ""
    if _is_planar(observations) and (tie.row[:2] >= 0).any():
        views = observations.view_count
        seen = "the one view" if views == 1 else f"all {views} views"
        tilt = _largest_tilt_deg(observations, found.cam_from_target)
        if tilt < LITTLE_TILT_DEG:
            return (
                f"{seen} of a plane seen straight on (tilted {tilt:.1f} deg at most): focal length and distance cannot "
                f"be told apart; tilt the target by 20 to 50 deg, or fix the focal length"
            )
        if not sure and is_parallel(found.camera):
            return _parallel_text(focal, sigma)
        if not sure:
            return (
                f"{seen} of a plane: the focal length is not determined ({_focal_text(focal, sigma)}); take more "
                f"views from different sides, photograph a 3D target, or fix parameters"
            )
    names = parameter_names(found.camera.model)
    part = np.abs(accuracy.weakest)
    weak = [name for name, share in zip(names, part.tolist(), strict=True) if share > 0.3 * max(part.max(), 1e-300)]
    if determined:
        return ""
    if not sure and is_parallel(found.camera):
        return _parallel_text(focal, sigma)
    if sure and (remedy := long_lens_remedy(found.camera, tie)):
        return f"{', '.join(weak)} cannot be told apart: {remedy}"
    if not sure:
        return f"the focal length is not determined ({_focal_text(focal, sigma)}); take more views, or fix parameters"
    return f"{', '.join(weak)} cannot be told apart; take views that fill the image, or fix one of them"


def is_parallel(camera: Camera) -> bool:
    """Whether a focal length is so long that the rays are nearly parallel."""
    return bool(max(camera.image_size) < PARALLEL * camera.params[:2].min())


def long_lens_remedy(camera: Camera, tie: Tie) -> str:
    """What to fix of a lens so long that photos hardly tell it; "" of others, and where nothing is left to fix."""
    names, start = [one.name for one in told_parameters(camera.model)], neutral(camera.model)
    start[2:4] = 0.5 * (np.array(camera.image_size) - 1)
    free = [k for k in range(2, len(names)) if tie.row[k] >= 0]
    if not free or not max(camera.image_size) < LONG * camera.params[:2].min():
        return ""
    field_deg = np.rad2deg(max(camera.image_size) / camera.params[0])
    return (
        f"photos hardly tell the principal point and the distortion of a lens with {field_deg:.2g} deg field of view; "
        f"fix them: --fix {','.join(f'{names[k]}={start[k]:g}' for k in free)}"
    )


def _parallel_text(focal: Array, sigma: Array) -> str:
    return (
        "the photos show no perspective, near parts of the target are as large as far ones (focal length "
        f"{_focal_text(focal, sigma)}), as through a telecentric lens, which no model here holds; with another lens "
        "hold the target nearer, or fix the focal length"
    )


def _focal_text(focal: Array, sigma: Array) -> str:
    if not np.isfinite(sigma).all():
        return "its standard deviation is without bound"
    return f"{focal[0]:.0f} px with a standard deviation of {sigma[0]:.0f} px"


def _is_planar(observations: Observations) -> bool:
    """Whether all points that were seen lie in one plane."""
    seen = observations.points.position_mm[np.unique(observations.point)]
    extent = np.linalg.svd(seen - seen.mean(axis=0), compute_uv=False)
    return bool(extent[-1] < FLAT * extent[0]) if len(extent) == 3 else True


def _largest_tilt_deg(observations: Observations, cam_from_target: Array) -> float:
    """Angle between the plane's normal and the viewing direction, of the most tilted view."""
    seen = observations.points.position_mm[np.unique(observations.point)]
    normal = np.linalg.svd(seen - seen.mean(axis=0))[2][2]
    cosine = np.abs(cam_from_target[:, 2, :3] @ normal)
    return float(np.rad2deg(np.arccos(np.minimum(cosine, 1.0))).max())
