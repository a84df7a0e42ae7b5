"""Where the edges lie in one picture, solved together with the tone curve and the blur that they share.

Each edge has levels of white and ink (with a gradient) and a displacement, all have the shape of the profile in common:
what the tone curve leaves open is in the standard deviation of the displacements. Alternating between the two creeps
along a valley (a steeper tone curve, and all ink a little wider) and stops anywhere in it, so they are solved at once:
each edge's own numbers are eliminated from the equations of the shared ones (a Schur complement).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.core.jit import jit, jit_inside
from calib.coupon_reading.edges import (
    COUNT,
    LEAST,
    LEAST_PIXELS,
    MOST,
    MOST_REACH_PX,
    PRIOR,
    PRIOR_SIGMA,
    STEP,
    Edge,
    Pixels,
    Tone,
    pixels_of,
    risen,
)
from calib.coupon_reading.place import Placed
from designer.base.arrays import Array, Flags

LEVELS = 6
"""Of an edge: white and ink, each with a gradient."""
ROUNDS, FIRST_ROUNDS = 40, 12
SETTLED = 0.02
"""Of the sum of squares in units of the noise: a step that gains less is the last. The valley is long and flat."""
MOST_DAMPING = 1e4
LEAST_EDGES = 30
FIRST_BLUR_PX, FIRST_NOISE = 1.3, 0.004
MOST_STEP_PX = 0.7
MOST_NOISE, LEAST_INK = 4.0, 0.1
"""Of an edge, over the usual; and how far below black it may be, of the lightest white."""
LEAST_BLUR_PX2, MOST_BLUR_PX2 = 0.05, 36.0
LEAST_REACH = 3.0
"""In blurs: edges with less room to the next one tell their levels too badly to tell their place."""
GOOD_MISFIT = 0.5
"""False minima of linear photos had 0.67 and more, most right ones 0.2 to 0.4."""
APART = 20
"""How many parts of a profile err by themselves: misfits as near as 4 % leave one minimum 1/3 of the other's weight."""
MUCH_CUT_OFF = 0.02
"""Of the edges' pixels: what is left may look like either."""
LINEAR = Tone(log_gamma=0.0).numbers
FAR_NOISE, LEAST_SEEN = 5.0, 0.5
"""Deviations of noise from where levels are cut off that leave it alone; and the part that is left of what is seen."""
CELL_PX, DIRECTIONS = 0.25, 6
MODEL_SHARE = 0.002
"""Of the contrast, by which an edge's profile may differ from the model anywhere, and unseen. An assumption: half a
grey level of 255."""
BLUR = 5
"""Numbers of the blur among the shared ones; those of the tone follow."""
OPEN = BLUR + COUNT + 1
"""What is open of all edges together: the shared numbers, and which of two minima is the right one."""
SHAPE_STEP = 1e-3
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
        return _blurs(self.numbers, pixels.direction, pixels.place)

    def stepped(self, step: Array) -> "EdgeShape":
        """Moved, within what any picture has."""
        numbers = self.numbers + step
        numbers[:2] = np.clip(numbers[:2], LEAST_BLUR_PX2, MOST_BLUR_PX2)
        numbers[3:5] = np.clip(numbers[3:5], -0.5, 0.5)
        numbers[BLUR:] = np.clip(numbers[BLUR:], LEAST, MOST)
        return EdgeShape(numbers)


@jit
def _blurs(numbers: Array, direction: Array, place: Array) -> Array:
    """Standard deviation of the blur along normals (N, 2), at places (N, 2).  # (N,)"""
    blur = np.empty(len(place))
    for n in range(len(place)):
        u, v = direction[n]
        square = numbers[0] * u**2 + numbers[1] * v**2 + 2 * numbers[2] * u * v
        growth = place[n, 0] * numbers[3] + place[n, 1] * numbers[4]
        blur[n] = math.sqrt(max(square, LEAST_BLUR_PX2)) * math.exp(min(max(growth, -1.0), 1.0))
    return blur


@dataclass(frozen=True, eq=False)
class EdgeFit:
    """Where an edge is."""

    edge: Edge
    moved_mm: Array  # (K,) b_x, b_y and the shift of a circle; b of a line
    covariance: Array  # (K, K) of the pixels' noise
    by_shape: Array  # (K, 11) derivative of these by the shared numbers, and by which of two minima is right


@dataclass(frozen=True, eq=False)
class Reading:
    """What one picture shows of the edges."""

    fits: tuple[EdgeFit, ...]
    shape: EdgeShape
    shape_covariance: Array  # (11, 11)
    px_per_mm: float
    noise: float  # grey levels
    misfit: float  # of the edges' profile, over what noise and `MODEL_SHARE` explain; 1 or less is good
    levels: tuple[float, float]  # of ink and white, over the full scale
    left_out: int  # edges outside the picture, or too near to each other for its blur
    cut_off: float  # share of the edges' pixels that are blacker or whiter than the file holds


_Shapes = tuple[Array, Array]
"""Numbers of shapes (S, 10), and their profiles (S, L)."""


@dataclass(frozen=True)
class _File:
    """What cuts grey levels off."""

    full: float  # the largest
    noise: float  # standard deviation: of what is cut off a part is not, as noise goes either way


@dataclass(frozen=True, eq=False)
class _Guess:
    """An edge's own numbers while they are sought."""

    edge: Edge
    pixels: Pixels
    own: Array  # (6 + K,) levels of white and of ink, displacement in mm

    @cached_property
    def is_astray(self) -> bool:
        """Whether it ended where its pixels do not reach, or at levels that none of them is near to."""
        if not (np.isfinite(self.own).all() and _reach_px(self) > 0):
            return True
        (white, ink), most = _planes(self), self.pixels.lightest
        return not ((ink < white).all() and white.max() < 2 * most and ink.min() > -LEAST_INK * most)


@dataclass(frozen=True, eq=False)
class _EdgeEquations:
    """The linearised model at an edge's pixels."""

    by_own: Array  # (N, 6 + K)
    by_shape: Array  # (N, 10), or (N, 0)
    left: Array  # (N,) measured - model
    distance_px: Array  # (N,) into the white of the edge where it is
    contrast: Array  # (N,)
    is_seen: Flags  # (N,) whether the file can hold the level


def read_edges(image: Array, placed: Placed, edges: Sequence[Edge], full: float = 255.0) -> Reading | None:
    """Where the edges are in a picture; None: too few are to be seen.

    Args:
        image: grey levels (H, W).
        placed: where the design lies in it.
        edges: of the design.
        full: the largest grey level that the file can hold.
    """
    file, shape = (
        _File(full, full * FIRST_NOISE),
        EdgeShape(np.array([FIRST_BLUR_PX**2, FIRST_BLUR_PX**2, 0, 0, 0, *PRIOR])),
    )
    guesses = [_first(edge, p) for edge in edges if (p := pixels_of(image, placed, edge)) is not None]
    if len(guesses) < LEAST_EDGES:
        return None
    guesses = _sound(guesses, shape, file)
    # Step by step: with tone and blur both unknown an edge far from its place is anything.
    for free in (BLUR, BLUR + COUNT):
        shape, guesses = _descended(shape, guesses, file, free)
    file = replace(file, noise=float(np.median(_noises(guesses, shape, file))))
    # Ink that has grown leaves less room to the next edge than was drawn.
    guesses = _again_from_rings(guesses)
    narrowed = [near for one in guesses if not one.is_astray and (near := _narrowed(one)) is not None]
    kept = [one for one in narrowed if _reach_px(one) > LEAST_REACH * float(np.median(shape.blur_at(one.pixels)))]
    if len(kept) < LEAST_EDGES:
        return None
    kept = _sound(kept, shape, file)
    left_out = len(edges) - len(kept)
    told = _told(*_descended(shape, kept, file, BLUR + COUNT), left_out, file)
    if told.misfit < GOOD_MISFIT and told.cut_off < MUCH_CUT_OFF:
        return told
    # A steep curve that fits badly may be the lesser of two minima: a linear file's is on the other side of a ridge.
    for free in (BLUR, BLUR + COUNT):
        start = shape if free > BLUR else EdgeShape(np.array([*shape.numbers[:BLUR], *LINEAR]))
        shape, kept = _descended(start, kept, file, free)
    other = _told(shape, kept, left_out, file)
    return either(*sorted((told, other), key=lambda one: one.misfit))


def either(better: Reading, worse: Reading) -> Reading:
    """Two minima of one picture: between them by what each is worth, and as unsure as they are apart."""
    share = 1 / (1 + (worse.misfit / better.misfit) ** APART)
    fits = []
    for one, other in zip(better.fits, worse.fits, strict=True):
        off_mm, by_shape = other.moved_mm - one.moved_mm, np.array(one.by_shape)
        by_shape[:, -1] = math.sqrt(share * (1 - share)) * off_mm
        fits.append(replace(one, moved_mm=one.moved_mm + share * off_mm, by_shape=by_shape))
    return replace(better, fits=tuple(fits))


def _first(edge: Edge, pixels: Pixels) -> _Guess:
    """The levels of the lightest and darkest pixels, and the edge where it parts the dark ones from the light."""
    own = np.zeros(LEVELS + pixels.moves.shape[1])
    own[3], own[0] = np.quantile(pixels.value, (0.1, 0.9))
    dark = float((pixels.value < (own[0] + own[3]) / 2).mean())
    own[LEVELS : LEVELS + 2] = np.quantile(pixels.distance_px, dark) / pixels.usual_per_mm
    return _Guess(edge, pixels, own)


def _levels(guesses: Sequence[_Guess], file: _File) -> tuple[float, float]:
    """The usual ink and white over the full scale."""
    ink, white = (float(np.median([one.own[k] for one in guesses])) / file.full for k in (3, 0))
    white = min(max(white, 0.02), 1.1)
    return min(max(ink, 0.003), 0.95 * white), white


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


def _sound(guesses: list[_Guess], shape: EdgeShape, file: _File) -> list[_Guess]:
    """The edges, each settled by itself, that look like edges at all: one that does not would hold up all others."""
    for _ in range(FIRST_ROUNDS):
        shapes = _shapes([shape], _levels(guesses, file))
        guesses = [_own_step(one, shapes, file) for one in guesses]
    noise = _noises(guesses, shape, file)
    is_sound = noise < MOST_NOISE * np.median(noise)
    return [one for one, ok in zip(guesses, is_sound.tolist(), strict=True) if ok and not one.is_astray]


def _noises(guesses: Sequence[_Guess], shape: EdgeShape, file: _File) -> Array:
    """Root mean squares of what is left of each edge."""
    shapes = _shapes([shape], _levels(guesses, file))
    return np.array([float(np.sqrt((_equations(one, shapes, file).left ** 2).mean())) for one in guesses])


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


def _equations(one: _Guess, shapes: _Shapes, file: _File) -> _EdgeEquations:
    """The model at a shape, and by differences how it changes with each of the shared numbers.

    Args:
        one: an edge and its numbers.
        shapes: the shape, then those of which one number is a step larger.
        file: what cuts grey levels off.
    """
    pixels = one.pixels
    told = _model(
        pixels.value, pixels.distance_px, pixels.per_mm, pixels.bend_px, pixels.direction, pixels.place, pixels.offset,
        pixels.moves, one.own, *shapes, file.full, file.noise,
    )  # fmt: skip
    return _EdgeEquations(*told)


@jit_inside
def _cut_off(level: float, full: float, noise: float) -> tuple[float, float]:
    """The mean of a noisy grey level in a file that holds 0 to `full`, and its derivative."""
    mean, part = level, 1.0
    if min(level, full - level) < FAR_NOISE * noise:
        mean = part = 0.0
        for sign, over in ((1.0, level), (-1.0, level - full)):
            x = over / noise
            above = 0.5 * (1 + math.erf(x * math.sqrt(0.5)))
            mean += sign * (over * above + noise * math.exp(-0.5 * x * x) / math.sqrt(2 * math.pi))
            part += sign * above
    return mean, part


@jit
def _model(
    value: Array, distance_px: Array, per_mm: Array, bend_px: Array, direction: Array, place: Array, offset: Array,
    moves: Array, own: Array, numbers: Array, levels: Array, full: float, noise: float,
) -> tuple[Array, Array, Array, Array, Array, Flags]:  # fmt: skip
    """The fields of an edge's equations; numbers and levels are those of the shape, and of shapes a step away."""
    count, free, shared = len(value), moves.shape[1], len(numbers) - 1
    by_own, by_shape = np.zeros((count, LEVELS + free)), np.zeros((count, shared))
    left, away_px, contrast, is_seen = np.empty(count), np.empty(count), np.empty(count), np.empty(count, np.bool_)
    blur = np.empty((min(shared, BLUR) + 1, count))
    for k in range(len(blur)):
        blur[k] = _blurs(numbers[k], direction, place)
    for n in range(count):
        u, v = offset[n]
        white, ink = own[0] + own[1] * u + own[2] * v, own[3] + own[4] * u + own[5] * v
        moved = 0.0
        for k in range(free):
            moved += moves[n, k] * own[LEVELS + k]
        away_px[n] = distance_px[n] - moved * per_mm[n]
        # A blurred disc is brighter at its rim than half: see `calib.detector.ring_model`.
        x = away_px[n] / blur[0, n] + 0.5 * blur[0, n] * bend_px[n]
        rise, contrast[n] = risen(levels[0], x), white - ink
        level = ink + contrast[n] * rise
        held, part = _cut_off(level, full, noise)
        left[n], is_seen[n] = value[n] - held, part > LEAST_SEEN
        slope = (risen(levels[0], x + STEP) - risen(levels[0], x - STEP)) / (2 * STEP * blur[0, n])
        for k in range(3):
            by = 1.0 if k == 0 else offset[n, k - 1]
            by_own[n, k], by_own[n, 3 + k] = part * by * rise, part * by * (1 - rise)
        for k in range(free):
            by_own[n, LEVELS + k] = -part * contrast[n] * slope * per_mm[n] * moves[n, k]
        for k in range(shared):
            at = x  # the tone moves no edge
            if k < BLUR:
                at = away_px[n] / blur[k + 1, n] + 0.5 * blur[k + 1, n] * bend_px[n]
            by_shape[n, k] = part * contrast[n] * (risen(levels[k + 1], at) - rise) / SHAPE_STEP
    return by_own, by_shape, left, away_px, contrast, is_seen


def _with_steps(shape: EdgeShape) -> list[EdgeShape]:
    """A shape, and those a step away."""
    return [shape, *(EdgeShape(shape.numbers + step) for step in SHAPE_STEP * np.eye(BLUR + COUNT))]


def _shapes(shapes: Sequence[EdgeShape], levels: tuple[float, float]) -> _Shapes:
    """Shapes, where ink and white have such levels."""
    return np.array([one.numbers for one in shapes]), np.array([one.tone.profile(levels).level for one in shapes])


def _moved(one: _Guess, step: Array) -> _Guess:
    """An edge after a step, no longer than its pixels allow."""
    most_mm = MOST_STEP_PX / one.pixels.usual_per_mm
    clipped = np.concatenate([step[:LEVELS], np.clip(step[LEVELS:], -most_mm, most_mm)])
    return replace(one, own=one.own + clipped)


def _own_step(one: _Guess, shapes: _Shapes, file: _File) -> _Guess:
    """An edge's own numbers, once better, its shape as it is; a step that leads up is halved."""
    found = _equations(one, shapes, file)
    step, cost = _solve(found.by_own, found.left), float((found.left**2).sum())
    for half in range(4):
        trial = _moved(one, step / 2**half)
        if not trial.is_astray and (_equations(trial, shapes, file).left ** 2).sum() < cost:
            return trial
    return one


def _solve(design: Array, left: Array) -> Array:
    """Least squares, with just enough damping for what is not determined."""
    normal = design.T @ design
    scale = np.sqrt(np.diagonal(normal)) + 1e-12
    damped = normal / scale / scale[:, None] + 1e-9 * np.eye(len(scale))
    solution: Array = (np.linalg.solve(damped, (left.T @ design / scale).T).T / scale).T
    return solution


def _descended(shape: EdgeShape, guesses: list[_Guess], file: _File, free: int) -> tuple[EdgeShape, list[_Guess]]:
    """Levenberg-Marquardt of the first of the shared numbers, and all own ones, together."""
    damping = 1e-3
    for _ in range(ROUNDS):
        shapes = _shapes(_with_steps(shape), _levels(guesses, file))
        found = [_equations(one, shapes, file) for one in guesses]
        noise2 = _noise2(found)
        cost, (normal, gradient, own) = _cost(found, shape, noise2), _reduced(found, shape, noise2)
        while True:
            trial_shape = _stepped(shape, normal + damping * np.diag(np.diagonal(normal)), gradient, free)
            step = trial_shape.numbers - shape.numbers
            trial = [_moved(one, by[:, 0] - by[:, 1:] @ step) for one, by in zip(guesses, own, strict=True)]
            trial_shapes = _shapes([trial_shape], _levels(trial, file))
            trial, trial_found = _no_worse(guesses, found, trial, trial_shapes, file)
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
    guesses: Sequence[_Guess], found: Sequence[_EdgeEquations], trial: Sequence[_Guess], shapes: _Shapes, file: _File
) -> tuple[list[_Guess], list[_EdgeEquations]]:
    """Edges after a step, but as they were where that is better: one that leapt would hold up all others."""
    moved = [(one, _equations(one, shapes, file)) for one in trial]
    for k, (before, guess) in enumerate(zip(found, guesses, strict=True)):
        one, after = moved[k]
        if one.is_astray or not _sum2(after) <= _sum2(before):
            stayed = guess, _equations(guess, shapes, file)
            if one.is_astray or not _sum2(after) <= _sum2(stayed[1]):
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
    return float(sum((one.left[one.is_seen] ** 2).sum() for one in found) / sum(one.is_seen.sum() for one in found))


def _cost(found: Sequence[_EdgeEquations], shape: EdgeShape, noise2: float) -> float:
    off_prior = (shape.numbers[BLUR:] - PRIOR) / PRIOR_SIGMA
    return float(sum((one.left**2).sum() for one in found) / noise2 + (off_prior**2).sum())


def _told(shape: EdgeShape, guesses: Sequence[_Guess], left_out: int, file: _File) -> Reading:
    """The solution with its covariances."""
    levels = _levels(guesses, file)
    shapes = _shapes(_with_steps(shape), levels)
    found = [_equations(one, shapes, file) for one in guesses]
    noise2, fits, rests = _noise2(found), [], []
    for guess, one in zip(guesses, found, strict=True):
        own = _solve(one.by_own, one.by_shape)
        rests.append((one.by_shape - one.by_own @ own) / one.contrast[:, None])
        covariance = np.asarray(noise2 * np.linalg.pinv(one.by_own.T @ one.by_own), np.float64)[LEVELS:, LEVELS:]
        by_shape = np.column_stack([-own[LEVELS:], np.zeros(len(own) - LEVELS)])
        fits.append(EdgeFit(guess.edge, guess.own[LEVELS:], covariance, by_shape))
    cut_off = 1 - float(np.mean(np.concatenate([one.is_seen for one in found])))
    information, misfit = _information(guesses, found, rests, shape, noise2)
    shape_covariance = np.eye(OPEN)
    shape_covariance[:-1, :-1] = np.linalg.inv(information + _prior(shape)[0])
    per_mm = float(np.median([np.median(one.pixels.per_mm) for one in guesses]))
    return Reading(tuple(fits), shape, shape_covariance, per_mm, math.sqrt(noise2), misfit, levels, left_out, cut_off)


def _information(
    guesses: Sequence[_Guess], found: Sequence[_EdgeEquations], rests: Sequence[Array], shape: EdgeShape, noise2: float
) -> tuple[Array, float]:
    """What means of alike pixels tell of the shape: noise averages away in them, what is wrong with the model does not.

    Returns:
        The normal matrix (10, 10), for residuals as large as they are; and how large, over what was expected.
    """
    left = np.concatenate([(one.left / one.contrast)[one.is_seen] for one in found])
    variance = np.concatenate([noise2 / one.contrast[one.is_seen] ** 2 for one in found])
    by_shape = np.concatenate([rest[one.is_seen] for rest, one in zip(rests, found, strict=True)])
    distance = np.concatenate([one.distance_px[one.is_seen] for one in found])
    direction = [guess.pixels.direction[one.is_seen] for guess, one in zip(guesses, found, strict=True)]
    u, v = np.concatenate(direction).T
    angle = np.mod(np.arctan2(v, u), np.pi)  # a blur is the same from both sides
    keys = np.stack([np.round(distance / CELL_PX / max(shape.blur_px, 0.5)), np.floor(angle / np.pi * DIRECTIONS)])
    _, cell = np.unique(keys.astype(np.int64), axis=1, return_inverse=True)
    cell = cell.ravel()
    count = np.bincount(cell)
    expected = np.bincount(cell, variance) / count**2 + MODEL_SHARE**2
    misfit = float(((np.bincount(cell, left) / count) ** 2 / expected).sum() / max(len(count) - BLUR - COUNT, 1))
    by = np.stack([np.bincount(cell, one) / count for one in by_shape.T], axis=1)
    return by.T @ (by / expected[:, None]) / max(misfit, 1.0), math.sqrt(misfit)
