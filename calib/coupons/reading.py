"""Where the edges lie in one picture, solved together with the tone curve and the blur that they share.

Each edge has levels of white and ink (with a gradient) and a displacement, all have the shape of the profile in common:
what the tone curve leaves open is in the standard deviation of the displacements. Alternating between the two creeps
along a valley (a steeper tone curve, and all ink a little wider) and stops anywhere in it, so they are solved at once:
each edge's own numbers are eliminated from the equations of the shared ones (a Schur complement).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.coupons.edges import LEAST_PIXELS, MOST_REACH_PX, Edge, Pixels, pixels_of
from calib.coupons.place import Placed
from calib.coupons.tone import COUNT, LEAST, MOST, PRIOR, PRIOR_SIGMA, Profile, Tone

Array = NDArray[np.float64]

LEVELS = 6
"""Of an edge: white and ink, each with a gradient."""
ROUNDS, FIRST_ROUNDS = 40, 12
SETTLED = 0.02
"""Of the sum of squares in units of the noise: a step that gains less is the last. The valley is long and flat."""
MOST_DAMPING = 1e4
LEAST_EDGES = 30
FIRST_BLUR_PX = 1.3
MOST_STEP_PX = 0.7
MOST_NOISE = 4.0
"""Of an edge, over the usual."""
LEAST_BLUR_PX2, MOST_BLUR_PX2 = 0.05, 36.0
LEAST_REACH = 3.0
"""In blurs: edges with less room to the next one tell their levels too badly to tell their place."""
GOOD_MISFIT = 0.5
"""False minima of linear photos had 0.67 and more, most right ones 0.2 to 0.4."""
LINEAR = Tone(log_gamma=0.0).numbers
CELL_PX, DIRECTIONS = 0.25, 6
MODEL_SHARE = 0.002
"""Of the contrast, by which an edge's profile may differ from the model anywhere, and unseen. An assumption: half a
grey level of 255."""
BLUR = 5
"""Numbers of the blur among the shared ones; those of the tone follow."""
STEPS = np.full(BLUR + COUNT, 1e-3)
"""Of the shared numbers, for derivatives by differences."""


@dataclass(frozen=True, eq=False)
class EdgeShape:
    """What all edges share: variance of the blur along u, v and across (px^2), growth of its logarithm, the tone."""

    numbers: Array  # (10,)

    @property
    def tone(self) -> Tone:
        """Tone curve and sharpening."""
        return Tone(*map(float, self.numbers[BLUR:]))

    @property
    def blur_px(self) -> float:
        """The usual standard deviation."""
        return math.sqrt(float(self.numbers[:2].mean()))

    def blur_at(self, pixels: Pixels) -> Array:
        """Standard deviation of the blur along the normals.  # (N,)"""
        u, v = pixels.direction.T
        square = self.numbers[0] * u**2 + self.numbers[1] * v**2 + 2 * self.numbers[2] * u * v
        growth = np.exp(np.clip(pixels.place @ self.numbers[3:5], -1, 1))
        blur: Array = np.sqrt(np.maximum(square, LEAST_BLUR_PX2)) * growth
        return blur

    def stepped(self, step: Array) -> "EdgeShape":
        """Moved, within what any picture has."""
        numbers = self.numbers + step
        numbers[:2] = np.clip(numbers[:2], LEAST_BLUR_PX2, MOST_BLUR_PX2)
        numbers[3:5] = np.clip(numbers[3:5], -0.5, 0.5)
        numbers[BLUR:] = np.clip(numbers[BLUR:], LEAST, MOST)
        return EdgeShape(numbers)


@dataclass(frozen=True, eq=False)
class EdgeFit:
    """Where an edge is."""

    edge: Edge
    moved_mm: Array  # (K,) b_x, b_y and the shift of a circle; b of a line
    covariance: Array  # (K, K) of the pixels' noise
    by_shape: Array  # (K, 10) derivative of these by the shared numbers


@dataclass(frozen=True, eq=False)
class Reading:
    """What one picture shows of the edges."""

    fits: tuple[EdgeFit, ...]
    shape: EdgeShape
    shape_covariance: Array  # (10, 10)
    px_per_mm: float
    noise: float  # grey levels
    misfit: float  # of the edges' profile, over what noise and `MODEL_SHARE` explain; 1 or less is good
    levels: tuple[float, float]  # of ink and white, over the full scale
    left_out: int  # edges outside the picture, or too near to each other for its blur


@dataclass(frozen=True, eq=False)
class _Guess:
    """An edge's own numbers while they are sought."""

    edge: Edge
    pixels: Pixels
    own: Array  # (6 + K,) levels of white and of ink, displacement in mm


@dataclass(frozen=True, eq=False)
class _EdgeEquations:
    """The linearised model at an edge's pixels."""

    by_own: Array  # (N, 6 + K)
    by_shape: Array  # (N, 10), or (N, 0)
    left: Array  # (N,) measured - model
    distance_px: Array  # (N,) into the white of the edge where it is
    contrast: Array  # (N,)


def read_edges(image: Array, placed: Placed, edges: Sequence[Edge], full: float = 255.0) -> Reading | None:
    """Where the edges are in a picture; None: too few are to be seen.

    Args:
        image: grey levels (H, W).
        placed: where the design lies in it.
        edges: of the design.
        full: the largest grey level that the file can hold.
    """
    shape = EdgeShape(np.array([FIRST_BLUR_PX**2, FIRST_BLUR_PX**2, 0, 0, 0, *PRIOR]))
    guesses = [_first(edge, p) for edge in edges if (p := pixels_of(image, placed, edge)) is not None]
    if len(guesses) < LEAST_EDGES:
        return None
    for _ in range(FIRST_ROUNDS):
        profile = shape.tone.profile(_levels(guesses, full))
        guesses = [_own_step(one, shape, profile) for one in guesses]
    guesses = _sound(guesses, shape, full)
    # Step by step: with tone and blur both unknown an edge far from its place is anything.
    for free in (BLUR, BLUR + COUNT):
        shape, guesses = _descended(shape, guesses, full, free)
    # Ink that has grown leaves less room to the next edge than was drawn.
    guesses = _again_from_rings(guesses)
    narrowed = [near for one in guesses if not _is_astray(one) and (near := _narrowed(one)) is not None]
    kept = [one for one in narrowed if _reach_px(one) > LEAST_REACH * float(np.median(shape.blur_at(one.pixels)))]
    if len(kept) < LEAST_EDGES:
        return None
    left_out = len(edges) - len(kept)
    told = _told(*_descended(shape, kept, full, BLUR + COUNT), left_out, full)
    if told.misfit < GOOD_MISFIT:
        return told
    # A steep curve that fits badly may be the lesser of two minima: a linear file's is on the other side of a ridge.
    for free in (BLUR, BLUR + COUNT):
        start = shape if free > BLUR else EdgeShape(np.array([*shape.numbers[:BLUR], *LINEAR]))
        shape, kept = _descended(start, kept, full, free)
    other = _told(shape, kept, left_out, full)
    return min(told, other, key=lambda one: one.noise)


def _first(edge: Edge, pixels: Pixels) -> _Guess:
    """The levels of the lightest and darkest pixels, and the edge where it parts the dark ones from the light."""
    own = np.zeros(LEVELS + pixels.moves.shape[1])
    own[3], own[0] = np.quantile(pixels.value, (0.1, 0.9))
    dark = float((pixels.value < (own[0] + own[3]) / 2).mean())
    own[LEVELS : LEVELS + 2] = np.quantile(pixels.distance_px, dark) / np.median(pixels.per_mm)
    return _Guess(edge, pixels, own)


def _levels(guesses: Sequence[_Guess], full: float) -> tuple[float, float]:
    """The usual ink and white over the full scale."""
    ink, white = (float(np.median([one.own[k] for one in guesses])) / full for k in (3, 0))
    white = min(max(white, 0.02), 1.1)
    return min(max(ink, 0.003), 0.95 * white), white


def _is_astray(one: _Guess) -> bool:
    """Whether an edge ended where its pixels do not reach, or at levels that none of them is near to."""
    if not (np.isfinite(one.own).all() and _reach_px(one) > 0):
        return True
    (white, ink), most = _planes(one), float(one.pixels.value.max())
    return not ((ink < white).all() and white.max() < 2 * most and ink.min() > -most)


def _planes(one: _Guess) -> tuple[Array, Array]:
    """White and ink at each of an edge's pixels."""
    offset = one.pixels.offset.T
    return one.own[0] + one.own[1:3] @ offset, one.own[3] + one.own[4:LEVELS] @ offset


def _moved_px(one: _Guess) -> Array:
    """How far into the white the edge has moved at each of its pixels."""
    moved: Array = (one.pixels.moves @ one.own[LEVELS:]) * one.pixels.per_mm
    return moved


def _reach_px(one: _Guess) -> float:
    """On either side of an edge where it is: up to there no other edge is nearer."""
    moved_px, (into_ink, into_white) = _moved_px(one), one.pixels.room_px
    return min(float(moved_px.min()) + into_ink, into_white - float(moved_px.max()), MOST_REACH_PX)


def _sound(guesses: Sequence[_Guess], shape: EdgeShape, full: float) -> list[_Guess]:
    """The edges that look like edges at all: one that does not would hold up all others."""
    profiles = [(shape, shape.tone.profile(_levels(guesses, full)))]
    noise = np.array([float(np.sqrt((_equations(one, profiles).left ** 2).mean())) for one in guesses])
    is_sound = noise < MOST_NOISE * np.median(noise)
    return [one for one, ok in zip(guesses, is_sound.tolist(), strict=True) if ok and not _is_astray(one)]


def _again_from_rings(guesses: Sequence[_Guess]) -> list[_Guess]:
    """Lines begun anew where rings tell: next to a narrow gap a line's edge may have settled on the one across it."""
    rings = [one.own[LEVELS : LEVELS + 2] for one in guesses if one.edge.axis < 0]
    if not rings:
        return list(guesses)
    usual = np.median(rings, axis=0)
    return [
        one
        if one.edge.axis < 0
        else replace(one, own=np.append(_first(one.edge, one.pixels).own[:LEVELS], usual[one.edge.axis]))
        for one in guesses
    ]


def _narrowed(one: _Guess) -> _Guess | None:
    """An edge with the pixels that are nearer to it, where it is, than to any other; None: too few."""
    pixels = one.pixels.within(np.abs(one.pixels.distance_px - _moved_px(one)) < _reach_px(one))
    return None if len(pixels.value) < LEAST_PIXELS else replace(one, pixels=pixels)


def _in_blurs(one: _Guess, shape: EdgeShape) -> tuple[Array, Array]:
    """The distances of an edge's pixels from it in blurs, and the blurs (px)."""
    pixels, blur = one.pixels, shape.blur_at(one.pixels)
    # A blurred disc is brighter at its rim than half: see `calib.detector.ring_model`.
    straight = pixels.distance_px + 0.5 * blur**2 * pixels.bend_px
    return (straight - pixels.moves @ one.own[LEVELS:] * pixels.per_mm) / blur, blur


def _equations(one: _Guess, profiles: Sequence[tuple[EdgeShape, Profile]]) -> _EdgeEquations:
    """The model at a shape, and by differences how it changes with each of the shared numbers.

    Args:
        one: an edge and its numbers.
        profiles: of the shape, then of shapes of which one number is a step larger.
    """
    pixels, (shape, profile) = one.pixels, profiles[0]
    in_blurs, blur = _in_blurs(one, shape)
    rise, slope = profile.at(in_blurs), profile.slope(in_blurs) / blur
    plane = np.column_stack([np.ones(len(rise)), pixels.offset])
    white, ink = _planes(one)
    by_move = -((white - ink) * slope * pixels.per_mm)[:, None] * pixels.moves
    by_own = np.hstack([plane * rise[:, None], plane * (1 - rise)[:, None], by_move])
    by_shape = np.empty((len(rise), len(profiles) - 1))
    for k, (stepped, its_profile) in enumerate(profiles[1:]):
        place = _in_blurs(one, stepped)[0] if k < BLUR else in_blurs  # the tone moves no edge
        by_shape[:, k] = (white - ink) * (its_profile.at(place) - rise) / STEPS[k]
    return _EdgeEquations(by_own, by_shape, pixels.value - ink - (white - ink) * rise, in_blurs * blur, white - ink)


def _profiles(shape: EdgeShape, levels: tuple[float, float]) -> list[tuple[EdgeShape, Profile]]:
    """The profile of a shape, and of those a step away."""
    shapes = [shape, *(EdgeShape(shape.numbers + step) for step in np.diag(STEPS))]
    return [(one, one.tone.profile(levels)) for one in shapes]


def _moved(one: _Guess, step: Array) -> _Guess:
    """An edge after a step, no longer than its pixels allow."""
    most_mm = MOST_STEP_PX / float(np.median(one.pixels.per_mm))
    clipped = np.concatenate([step[:LEVELS], np.clip(step[LEVELS:], -most_mm, most_mm)])
    return replace(one, own=one.own + clipped)


def _own_step(one: _Guess, shape: EdgeShape, profile: Profile) -> _Guess:
    """An edge's own numbers, once better, its shape as it is; a step that leads up is halved."""
    profiles = [(shape, profile)]
    found = _equations(one, profiles)
    step, cost = _solve(found.by_own, found.left), float((found.left**2).sum())
    for half in range(4):
        trial = _moved(one, step / 2**half)
        if not _is_astray(trial) and (_equations(trial, profiles).left ** 2).sum() < cost:
            return trial
    return one


def _solve(design: Array, left: Array) -> Array:
    """Least squares, with just enough damping for what is not determined."""
    normal = design.T @ design
    scale = np.sqrt(np.diagonal(normal)) + 1e-12
    damped = normal / scale / scale[:, None] + 1e-9 * np.eye(len(scale))
    solution: Array = (np.linalg.solve(damped, (left.T @ design / scale).T).T / scale).T
    return solution


def _descended(shape: EdgeShape, guesses: list[_Guess], full: float, free: int) -> tuple[EdgeShape, list[_Guess]]:
    """Levenberg-Marquardt of the first of the shared numbers, and all own ones, together."""
    damping = 1e-3
    for _ in range(ROUNDS):
        profiles = _profiles(shape, _levels(guesses, full))
        found = [_equations(one, profiles) for one in guesses]
        noise2 = _noise2(found)
        cost, (normal, gradient, own) = _cost(found, shape, noise2), _reduced(found, shape, noise2)
        while True:
            trial_shape = _stepped(shape, normal + damping * np.diag(np.diagonal(normal)), gradient, free)
            step = trial_shape.numbers - shape.numbers
            trial = [_moved(one, by[:, 0] - by[:, 1:] @ step) for one, by in zip(guesses, own, strict=True)]
            profile = [(trial_shape, trial_shape.tone.profile(_levels(trial, full)))]
            trial, trial_found = _no_worse(guesses, found, trial, profile)
            trial_cost = _cost(trial_found, trial_shape, noise2)
            if trial_cost < cost or damping > MOST_DAMPING:
                break
            damping *= 8
        if trial_cost < cost:
            shape, guesses, damping = trial_shape, trial, max(damping / 8, 1e-6)
        if trial_cost > cost - SETTLED:
            break
    return shape, guesses


def _no_worse(
    guesses: Sequence[_Guess],
    found: Sequence[_EdgeEquations],
    trial: Sequence[_Guess],
    profile: Sequence[tuple[EdgeShape, Profile]],
) -> tuple[list[_Guess], list[_EdgeEquations]]:
    """Edges after a step, but as they were where that is better: one that leapt would hold up all others."""
    moved = [(one, _equations(one, profile)) for one in trial]
    for k, (before, guess) in enumerate(zip(found, guesses, strict=True)):
        if _is_astray(moved[k][0]) or not _sum2(moved[k][1]) <= _sum2(before):
            stayed = guess, _equations(guess, profile)
            if _is_astray(moved[k][0]) or not _sum2(moved[k][1]) <= _sum2(stayed[1]):
                moved[k] = stayed
    return [one for one, _ in moved], [one for _, one in moved]


def _sum2(found: _EdgeEquations) -> float:
    """Of the residuals."""
    return float(found.left @ found.left)


def _reduced(found: Sequence[_EdgeEquations], shape: EdgeShape, noise2: float) -> tuple[Array, Array, list[Array]]:
    """The equations of the shared numbers once each edge's own are eliminated, and what these are by the shared ones.

    Returns:
        Normal matrix, gradient, and of each edge its own step and its derivatives (6 + K, 1 + 10).
    """
    normal, gradient = _prior(shape)
    own = [_solve(one.by_own, np.column_stack([one.left, one.by_shape])) for one in found]
    for one, by in zip(found, own, strict=True):
        rest = np.column_stack([one.left, one.by_shape]) - one.by_own @ by
        normal += rest[:, 1:].T @ rest[:, 1:] / noise2
        gradient += rest[:, 1:].T @ rest[:, 0] / noise2
    return normal, gradient, own


def _stepped(shape: EdgeShape, normal: Array, gradient: Array, free: int) -> EdgeShape:
    """The shape after a step; a number that would leave its limits stays at them, and the others take that up."""
    is_free = np.arange(len(gradient)) < free
    for _ in range(len(gradient)):
        step = np.zeros(len(gradient))
        step[is_free] = np.linalg.solve(normal[np.ix_(is_free, is_free)], gradient[is_free])
        trial = shape.stepped(step)
        is_held = (np.abs(trial.numbers - shape.numbers) < 1e-3 * np.abs(step)) & is_free
        if not is_held.any():
            break
        is_free &= ~is_held
    return trial


def _prior(shape: EdgeShape) -> tuple[Array, Array]:
    """Normal matrix and gradient of what is known of the tone beforehand."""
    weight = np.concatenate([np.full(BLUR, 1e-6), PRIOR_SIGMA**-2])
    gradient = np.concatenate([np.zeros(BLUR), (PRIOR - shape.numbers[BLUR:]) / PRIOR_SIGMA**2])
    return np.diag(weight), gradient


def _noise2(found: Sequence[_EdgeEquations]) -> float:
    """Variance of the residuals."""
    return float(sum((one.left**2).sum() for one in found) / sum(len(one.left) for one in found))


def _cost(found: Sequence[_EdgeEquations], shape: EdgeShape, noise2: float) -> float:
    off_prior = (shape.numbers[BLUR:] - PRIOR) / PRIOR_SIGMA
    return float(sum((one.left**2).sum() for one in found) / noise2 + (off_prior**2).sum())


def _told(shape: EdgeShape, guesses: Sequence[_Guess], left_out: int, full: float) -> Reading:
    """The solution with its covariances."""
    levels = _levels(guesses, full)
    profiles = _profiles(shape, levels)
    found = [_equations(one, profiles) for one in guesses]
    noise2, fits, rests = _noise2(found), [], []
    for guess, one in zip(guesses, found, strict=True):
        own = _solve(one.by_own, one.by_shape)
        rests.append((one.by_shape - one.by_own @ own) / one.contrast[:, None])
        covariance = np.asarray(noise2 * np.linalg.pinv(one.by_own.T @ one.by_own), np.float64)[LEVELS:, LEVELS:]
        fits.append(EdgeFit(guess.edge, guess.own[LEVELS:], covariance, -own[LEVELS:]))
    information, misfit = _information(guesses, found, rests, shape, noise2)
    shape_covariance = np.asarray(np.linalg.inv(information + _prior(shape)[0]), np.float64)
    per_mm = float(np.median([np.median(one.pixels.per_mm) for one in guesses]))
    return Reading(tuple(fits), shape, shape_covariance, per_mm, math.sqrt(noise2), misfit, levels, left_out)


def _information(
    guesses: Sequence[_Guess], found: Sequence[_EdgeEquations], rests: Sequence[Array], shape: EdgeShape, noise2: float
) -> tuple[Array, float]:
    """What means of alike pixels tell of the shape: noise averages away in them, what is wrong with the model does not.

    Returns:
        The normal matrix (10, 10), for residuals as large as they are; and how large, over what was expected.
    """
    left = np.concatenate([one.left / one.contrast for one in found])
    variance = np.concatenate([noise2 / one.contrast**2 for one in found])
    by_shape, distance = np.concatenate(rests), np.concatenate([one.distance_px for one in found])
    u, v = np.concatenate([one.pixels.direction for one in guesses]).T
    angle = np.mod(np.arctan2(v, u), np.pi)  # a blur is the same from both sides
    keys = np.stack([np.round(distance / CELL_PX / max(shape.blur_px, 0.5)), np.floor(angle / np.pi * DIRECTIONS)])
    _, cell = np.unique(keys.astype(np.int64), axis=1, return_inverse=True)
    cell = cell.ravel()
    count = np.bincount(cell)
    expected = np.bincount(cell, variance) / count**2 + MODEL_SHARE**2
    misfit = float(((np.bincount(cell, left) / count) ** 2 / expected).sum() / max(len(count) - BLUR - COUNT, 1))
    by = np.stack([np.bincount(cell, one) / count for one in by_shape.T], axis=1)
    return by.T @ (by / expected[:, None]) / max(misfit, 1.0), math.sqrt(misfit)
