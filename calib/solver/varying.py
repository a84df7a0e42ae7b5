"""A linear part that is not the same in all photos: a focal length that follows the distance, or sessions.

*Breathing.* A lens that is focused is moved. Of a thin lens with the focal length F, which is focused at the distance
Z, the image is `F Z / (Z - F)` behind it: in pixels `f (1 + b (1 / Z - 1 / Z0))` to first order in F / Z, with f at a
distance Z0 and b = F in mm. Lenses that move groups inside have another b, also below zero. Z is the depth of what a
photo shows of the target, which an autofocus focuses at; a lens that is left alone has b = 0. Before photos tell it, b
is believed to be 0 with a deviation of a fifth of their distance.

*Sessions.* Groups of photos between which the focal length or the principal point changed, as of a phone or a zoom: in
each a deviation, normal about zero; how large they usually are is told, or estimated with them (a variance component;
Foerstner 1979). The camera is the mean of the sessions.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.cameras.camera import Camera, relinear
from calib.core.types import Observations
from calib.solver.accuracy import accuracy_of
from calib.solver.calibration import LINEAR, Calibration, PhotoSession
from calib.solver.descend import Descended, descend_displaced
from calib.solver.problem import Problem, SolveOptions, Tie
from calib.solver.start import Poses, solve_poses
from designer.base.arrays import Array, Flags, Rows
from designer.base.errors import InputError
from designer.base.words import shown

BREATHES = 0.2
"""Deviation of b before photos tell it, as a part of their distance."""
ROUNDS = 2
"""As depths, and the ratio of the focal lengths, follow a little."""
AXES = np.eye(4)
FOCAL = "focal"
"""Both focal lengths by the same share."""
FIRST_SHARE = 0.01
"""Of the focal length, as which deviations begin."""
LEAST_PX = 1e-3
SESSION_ROUNDS, SAME = 12, 0.02
"""Of judging how large deviations are, and solving again."""


def depths_mm(problem: Problem, cam_from_target: Array) -> Array:
    """Mean depth of what each view shows.  # (V,)"""
    pose = cam_from_target[problem.view]
    depth = np.einsum("mj,jm->m", pose[:, 2, :3], problem.position_mm) + pose[:, 2, 3]
    return np.add.reduceat(np.where(problem.is_used, depth, 0.0), problem.view_start[:-1]) / np.maximum(
        np.add.reduceat(problem.is_used.astype(np.float64), problem.view_start[:-1]), 1.0
    )


def breathing_shifts(camera: Camera, depth_mm: Array, at_mm: float) -> tuple[Array, Array]:
    """What b does to views (1, V, 4), and what is believed of it (1,)."""
    shifts = np.zeros((1, len(depth_mm), 4))
    shifts[0, :, :2] = (1 / depth_mm - 1 / at_mm)[:, None] * camera.params[:2]
    return shifts, np.array([BREATHES * float(np.median(depth_mm))])


def with_breathing(
    base: Problem, found: Descended, tie: Tie, options: SolveOptions, at_mm: float, noise_px2: Array | None
) -> tuple[Problem, Descended]:
    """The problem with b behind its amounts, and its minimum, from one without."""
    problem = base
    for _ in range(ROUNDS):
        minimum = found.minimum
        depth_mm = depths_mm(base, minimum.cam_from_target)
        shifts, sigma = breathing_shifts(minimum.camera, depth_mm, at_mm)
        problem = base.with_shifts(shifts, sigma, len(tie.row))
        found = descend_displaced(problem, found, tie, options, noise_px2)
    return problem, found


def with_sessions(
    base: Problem, found: Descended, tie: Tie, options: SolveOptions, view_names: Sequence[str],
    noise_px2: Array | None,
) -> tuple[Problem, Descended]:  # fmt: skip
    """The problem with the sessions' deviations behind its amounts, and its minimum, from one without."""
    names, session = session_rows(view_names, options)
    problem, first, count = base, len(base.amount), len(names) * len(options.vary)
    sigma = np.full(count, options.vary_sigma_px or FIRST_SHARE * float(found.minimum.camera.params[0]))
    for done in range(SESSION_ROUNDS):
        shifts = session_shifts(found.minimum.camera, options, session)
        problem = base.with_shifts(shifts, sigma, len(tie.row))
        found = descend_displaced(problem, found, tie, options, noise_px2)
        blocks, used = found.minimum.blocks, int(found.is_used.sum())
        if (options.vary_sigma_px is not None and done + 1 >= ROUNDS) or found.is_lost.any():
            break
        if options.vary_sigma_px is not None:
            continue
        told = accuracy_of(blocks.products, problem.rows(tie.row), used, found.robust, blocks.prior).param_covariance
        amount, variance, before = found.minimum.amount[first:], np.diagonal(told)[first:], sigma
        sigma = np.concatenate([
            np.full(len(names), component(amount[rows], variance[rows], float(before[rows[0]])))
            for rows in np.arange(count).reshape(-1, len(names))
        ])  # fmt: skip
        if not (np.isfinite(sigma).all() and (np.abs(sigma - before) > SAME * before).any()):
            break
    return problem, found


def session_rows(view_names: Sequence[str], options: SolveOptions) -> tuple[tuple[str, ...], Rows]:
    """The sessions, and that of each view (V,).

    Raises:
        InputError: a photo of none.
    """
    of = dict(options.sessions)
    without = next((name for name in view_names if name not in of), None)
    if without is not None:
        raise InputError(f"--sessions: says no session of {shown(without)}; add a line for it, or leave the photo out")
    names = tuple(dict.fromkeys(of[name] for name in view_names))
    return names, np.array([names.index(of[name]) for name in view_names])


def session_shifts(camera: Camera, options: SolveOptions, session: Rows) -> Array:
    """What deviations do to views: those of each thing that varies, session by session.  # (K G, V, 4)"""
    fx, fy = camera.params[:2].tolist()
    kinds = [(1.0, fy / fx, 0, 0) if name == FOCAL else AXES[LINEAR.index(name)] for name in options.vary]
    is_of = session == np.arange(session.max() + 1)[:, None]
    return np.concatenate([is_of[:, :, None] * np.array(kind) for kind in kinds]).astype(np.float64)


def sessions_of(
    camera: Camera, problem: Problem, options: SolveOptions, view_names: Sequence[str], amount: Array, covariance: Array
) -> tuple[tuple[PhotoSession, ...], Camera, Array]:
    """The sessions of views, and their mean as a camera with its covariance (P, P).

    By deviations (K G,), and the joint covariance of these and of the camera's parameters. The mean is that of these
    sessions, and not of all there may be: it is as sure as they are.
    """
    names, session = session_rows(view_names, options)
    shifts = problem.shifts[-len(amount) :, np.unique(session, return_index=True)[1]]  # of a view of each
    found, mean, count = [], shifts.mean(axis=1), len(camera.params)
    for name, own in zip(names, shifts.transpose(1, 0, 2), strict=True):
        by_all = np.concatenate([own, np.eye(count, 4)])
        variance = np.einsum("ki,kl,li->i", by_all, covariance, by_all)
        photos = tuple(photo for photo, session in options.sessions if session == name)
        found.append(PhotoSession(name, photos, camera.params[:4] + amount @ own, np.sqrt(np.maximum(variance, 0.0))))
    by_all = np.concatenate([np.pad(mean, ((0, 0), (0, count - 4))), np.eye(count)])
    params = camera.params + np.pad(amount @ mean, (0, count - 4))
    return tuple(found), replace(camera, params=params), by_all.T @ covariance @ by_all


def component(amount: Array, variance: Array, sigma: float) -> float:
    """How large deviations are, by what they themselves show (Foerstner 1979)."""
    told = len(amount) - float(variance.sum()) / sigma**2
    return max(float(np.sqrt((amount**2).sum() / max(told, 1e-3))), LEAST_PX)


def has_session(calibration: Calibration, view_names: Sequence[str]) -> Flags:
    """Whether the solution has the session of each photo, by its name; of all where there are none.  # (V,)"""
    photos = {photo for one in calibration.sessions for photo in one.photos}
    return np.array([not photos or name in photos for name in view_names], dtype=bool)


def posed_photos(calibration: Calibration, seen: Observations) -> tuple[Poses, Array | None]:
    """Poses of other photos by a camera that is known, and fx, fy, cx, cy of each (V, 4) where these vary.

    Those of a session that the solution does not have are to be left out before (`has_session`).
    """
    camera, weighted = calibration.camera, calibration.weighted
    found, linear, breathing = solve_poses(camera, seen, weighted=weighted), None, calibration.breathing
    own = {photo: one.linear for one in calibration.sessions for photo in one.photos}
    for _ in range(ROUNDS if breathing is not None else 1 if own else 0):
        linear = np.stack([own.get(name, camera.params[:4]) for name in seen.view_names])
        if breathing is not None:
            pose, point = found.cam_from_target[seen.view], seen.points.position_mm[seen.point]
            depth = (pose[:, 2, :3] * point).sum(axis=1) + pose[:, 2, 3]
            depth_mm = np.bincount(seen.view, depth) / np.bincount(seen.view)
            factor = 1 + breathing.mm * (1 / depth_mm - 1 / breathing.at_mm)
            linear[:, :2] *= np.where(np.isfinite(factor), factor, 1.0)[:, None]  # of views without a pose, too
        there = relinear(seen.center_px, linear[seen.view], camera.params[:4])
        found = solve_poses(camera, replace(seen, center_px=there), weighted=weighted)
    return found, linear
