"""What errors of a target cost a rig that is solved as if there were none: predicted, and by drawn prints.

Frames of the target before the rig are simulated with the noise of detected rings and solved. About that solution the
error of all lenses and places is linear in the displacements of the rings, so that each source's part needs no draw;
drawn prints are simulated and solved again as a check.
"""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from calib.cameras.rig import Rig
from calib.core.se3 import compose, invert, log_rotation, transform
from calib.core.types import Observations, RigObservations, keep_frames
from calib.observe.observations import known_points
from calib.rigs.problem import CameraChoice, RigOptions
from calib.rigs.relative import middle_error, relative
from calib.rigs.result import RigCalibration
from calib.rigs.solve import solve_rig
from calib.rigs.target_error import unseen_errors
from calib.space.budget import length_errors
from calib.space.propagate import is_in_image, of_rows
from calib.space.triangulate import triangulate_points
from calib.studies.identity import StudyIdentity, identity_of
from calib.studies.rig_bootstrap import pose_values, poses_of
from calib.studies.samples import SampleResult, Samples, failed_sample
from calib.studies.tolerance.draw import error_settings
from calib.studies.tolerance.seen import CONTRAST_TO_NOISE, LEAST_RINGS, seen_in
from calib.studies.workers import ValuePool
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.base.marks import Gap, Word
from designer.target import TargetGeometry, target_to_json
from designer.tolerance.model import ErrorModel, perturb
from designer.tolerance.prior import shape_prior
from designer.tolerance.source import Amount

LENGTH_MM = 100.0
"""Whose error is told, in the middle of where the target was held."""
AS_NOTHING = 1e-9
"""Of mm and rad, what is rounding."""
KIND = "rig tolerance"
NOISE, TOGETHER, DRAWN = "noise", "all errors", "drawn prints"
"""What costs are told of beside sources: drawn prints have noise, too."""


@dataclass(frozen=True)
class RigCost:
    """What something does to a rig, root mean squares; over all pairs of cameras where it is of pairs."""

    name: Word  # of an error source, or of what is no source
    distribution: Word  # of a source, as `Amount` has it; "" of what is none
    size: Gap  # likewise
    baseline_mm: Gap  # of the distance of two cameras
    turn_rad: Gap  # of the rotation of one against another
    point_mm: Gap  # of a point in the middle of where the target was held, in the rig's frame
    length_mm: Gap  # of a length of `LENGTH_MM` there


@dataclass(frozen=True, eq=False)
class SimulatedFrames:
    """A target before a rig, as drawn."""

    rig: Rig  # the truth
    target: TargetGeometry
    rig_from_target: Array  # (V, 4, 4)

    def seen(self, made: TargetGeometry, rng: np.random.Generator) -> RigObservations:
        """What the cameras see of a print with noise, told as the rings of the drawing."""
        sightings, frames = [], []
        for row, name in enumerate(self.rig.names):
            views = [self._view(made, row, frame, rng) for frame in range(len(self.rig_from_target))]
            kept = [frame for frame, (ring, _, _) in enumerate(views) if len(ring) >= LEAST_RINGS]
            if not kept:
                raise InputError(
                    f"camera {name}: sees the target in no frame; add --frames, or hold it elsewhere with --distance"
                )
            ring, pixel, covariance = (np.concatenate(one) for one in zip(*(views[k] for k in kept), strict=True))
            view = np.repeat(np.arange(len(kept)), [len(views[frame][0]) for frame in kept])
            size, told = self.rig.cameras[row].image_size, tuple(f"frame{frame:04d}" for frame in kept)
            sightings.append(Observations(size, told, view, ring, pixel, covariance, known_points(self.target)))
            frames.append(np.array(kept))
        names = tuple(f"frame{frame:04d}" for frame in range(len(self.rig_from_target)))
        seen = RigObservations(self.rig.names, names, tuple(sightings), tuple(frames))
        return keep_frames(seen, np.isin(np.arange(len(names)), np.concatenate(frames)))

    def _view(
        self, made: TargetGeometry, camera: int, frame: int, rng: np.random.Generator
    ) -> tuple[Rows, Array, Array]:
        pose = self.rig.cam_from_rig[camera] @ self.rig_from_target[frame]
        ring, pixel, covariance = seen_in(made, self.rig.cameras[camera], pose, CONTRAST_TO_NOISE)
        noise = np.linalg.cholesky(covariance) @ rng.standard_normal((len(ring), 2, 1))
        return ring, pixel + noise[:, :, 0], covariance

    def solved(self, made: TargetGeometry, rng: np.random.Generator) -> RigCalibration:
        """The rig from these frames, all lenses free."""
        choices = [CameraChoice(camera.model, camera) for camera in self.rig.cameras]
        found = solve_rig(self.seen(made, rng), choices, RigOptions())
        if found.status == "degenerate":
            raise InputError(
                f"{len(self.rig_from_target)} frames do not determine the rig: {found.remarks[0]}; add --frames"
            )
        return found


def predicted_costs(found: RigCalibration, target: TargetGeometry, errors: ErrorModel) -> tuple[RigCost, ...]:
    """Of each source, of all together and of the noise, the largest first and these two last."""
    names = [name for name, amount in errors.amounts if amount.sigma > 0]
    priors = [shape_prior(target, errors.only(name)) for name in names]
    moved = unseen_errors(found, priors) if names else ()
    costs = [
        cost_of(replace(found, covariance=one), name, errors.amount(name))
        for name, one in zip(names, moved, strict=True)
    ]
    total = np.sum(moved, axis=0) if names else np.zeros_like(found.covariance)
    ranked = sorted(costs, key=lambda one: -one.point_mm)
    return (*ranked, cost_of(replace(found, covariance=total), TOGETHER), cost_of(found, NOISE))


def cost_of(found: RigCalibration, name: str, amount: Amount | None = None) -> RigCost:
    """What a joint covariance says of the rig."""
    found = replace(found, target_covariance=None)
    rig = found.rig
    pairs = [relative(rig, a, b) for b in range(len(rig.names)) for a in range(b)]
    middle = middle_error(found)
    length = math.nan
    if middle is not None:
        _, by_rig = length_errors(rig, middle.point_mm[None], np.eye(3), LENGTH_MM, np.ones(len(rig.names)))
        length = _rms(np.sqrt(by_rig).ravel().tolist())
    return RigCost(
        name, "" if amount is None else amount.kind, math.nan if amount is None else amount.size,
        _rms([one.baseline_sigma_mm for one in pairs]),
        _rms([math.sqrt(max(np.trace(one.covariance[:3, :3]), 0.0)) for one in pairs]),
        math.nan if middle is None else middle.rig_mm, length,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class PrintPool(ValuePool):
    """Prints with errors, each seen by a rig with noise of its own, and solved as if it were as drawn.

    The values of a sample are the cameras' poses and, of a point in the middle and three lengths about it that are
    then seen without noise, how far they are off.
    """

    kind: ClassVar[str] = KIND
    frames: SimulatedFrames
    middle_mm: Array | None  # where points are looked at; None: nowhere
    errors: ErrorModel

    @property
    def view_count(self) -> int:
        """Frames."""
        return len(self.frames.rig_from_target)

    @property
    def value_count(self) -> int:
        """Of each camera, the first three rows of `cam_from_rig`; the point and the lengths."""
        return 12 * len(self.frames.rig.names) + 4

    def sample(self, seed: int, number: int) -> SampleResult:
        """The print of a number."""
        rng = np.random.default_rng([seed, number])
        try:
            found = self.frames.solved(perturb(self.frames.target, self.errors, rng), rng)
        except InputError as error:
            return failed_sample(number, self.view_count, self.value_count, str(error))
        off = (math.nan,) * 4 if self.middle_mm is None else _off_in_space(self.frames.rig, found.rig, self.middle_mm)
        values = (*pose_values(found.rig), *off)
        return SampleResult(number, found.status, self.view_count, values, found.iterations)


def print_identity(pool: PrintPool, seed: int) -> StudyIdentity:
    """What makes the draws of prints this study."""
    rig, poses = pool.frames.rig, pool.frames.rig_from_target
    told = repr(([camera.to_json() for camera in rig.cameras], rig.cam_from_rig.tolist(), poses.tolist()))
    texts = {"rig and its frames": told, "target": target_to_json(pool.frames.target)}
    inputs = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in texts.items()}
    return identity_of(seed, {"study": KIND, **error_settings(pool.errors)}, inputs)


def drawn_cost(frames: SimulatedFrames, samples: Samples) -> RigCost:
    """What drawn prints and noise together did to the rig."""
    lost = [message for message, status in zip(samples.message, samples.status, strict=True) if status == "failed"]
    if lost:
        raise InputError(f"{len(lost)} of {len(samples.number)} drawn prints: {lost[0]}")
    found, true = poses_of(samples.params[:, :-4]), frames.rig.cam_from_rig
    baseline, turn = list[Array](), list[Array]()
    for b in range(len(true)):
        for a in range(b):
            here = compose(found[:, b], invert(found[:, a]))
            there = compose(true[b], invert(true[a]))
            baseline.append(np.linalg.norm(here[:, :3, 3], axis=1) - np.linalg.norm(there[:3, 3]))
            turn.append(np.linalg.norm(log_rotation(here[:, :3, :3] @ there[:3, :3].T), axis=1))
    point, length = samples.params[:, -4], samples.params[:, -3:]
    drawn = (np.transpose(baseline).ravel(), np.transpose(turn).ravel(), point, length.ravel())
    return RigCost(DRAWN, "", math.nan, *(_rms(one[np.isfinite(one)].tolist()) for one in drawn))


def _off_in_space(true: Rig, found: Rig, middle_mm: Array) -> tuple[float, ...]:
    """How far a point is off, and lengths about it, that are seen without noise."""
    ends = 0.5 * LENGTH_MM * np.concatenate([np.eye(3), -np.eye(3)])
    points = middle_mm + np.concatenate([np.zeros((1, 3)), ends])
    camera, place, pixel = [], [], []
    for row in range(len(true.names)):
        (seen,) = np.nonzero(is_in_image(true, row, points))
        camera.append(np.full(len(seen), row))
        place.append(seen)
        pixel.append(true.cameras[row].project(transform(true.cam_from_rig[row], points[seen])))
    names = tuple(map(str, np.concatenate(place).tolist()))
    sightings = of_rows(np.concatenate(camera), ("",) * len(names), names, np.concatenate(pixel))
    told = triangulate_points(found, sightings, np.ones(len(true.names)))
    position = np.full((len(points), 3), np.nan)
    position[[int(told.sightings.name(row)) for row in range(told.sightings.count)]] = told.position_mm
    length = np.linalg.norm(position[1:4] - position[4:], axis=1) - LENGTH_MM
    return float(np.linalg.norm(position[0] - middle_mm)), *length.tolist()


def _rms(values: Sequence[float]) -> float:
    size = math.sqrt(float(np.mean(np.square(values)))) if len(values) else math.nan
    return 0.0 if size < AS_NOTHING else size
