"""A solved rig, with what is known of its accuracy: its cameras' own calibrations, and what joins them."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated

import numpy as np

from calib.cameras import parameter_names
from calib.cameras.camera import Camera
from calib.cameras.rig import Rig
from calib.core.types import Observations, RigObservations, freeze, frozen_array
from calib.rigs.problem import FREE_SIZE, CameraChoice
from calib.solver.calibration import Calibration, CircleDoubt, PlaneBend, Solved
from calib.solver.priors import ParameterPrior
from designer.base.arrays import Array, Flags
from designer.base.marks import LEFT_OUT, OR_NULL, PACKED, AtLeast, AtMost, Gap, Shape, Word


@dataclass(frozen=True, eq=False)
class MechanismFit:
    """What moved the target or the rig, as the photos show it: `result.carrier.sigma_mm`."""

    kind: str  # "robot, camera in hand", "robot, target in hand", "turntable"
    carrier_from_target: Annotated[Array, Shape(4, 4)]
    """Camera in hand: base_from_target; else flange_from_target, table_from_target."""
    covariance: Annotated[
        Array, Shape(6, 6), OR_NULL
    ]  # of it: rotation vector (rad), shift (mm), in the carrier's axes
    sigma_rad: Gap  # of the carrier's own errors, a coordinate of the rotation vector
    sigma_mm: Gap  # likewise, a coordinate of the shift
    error: Annotated[Array, Shape("V", 6), OR_NULL]
    """Of each frame: where the photos show the carrier, against what it said; rad, mm."""
    angle_rad: Annotated[Annotated[Array, Shape("V")] | None, LEFT_OUT] = None  # of a turntable: solved, or as given
    undetermined: tuple[str, ...] = ()  # what the motions do not tell, one line each
    size: float = 1.0  # of the target, as a part of what its file says, by the robot's ways; 1: not asked for
    size_sigma: float = 0.0
    size_sigma_before: float = FREE_SIZE  # by how the target was made

    def __post_init__(self) -> None:
        freeze(self, "carrier_from_target", "covariance", "error", "angle_rad")


LARGEST_COVARIANCE, LARGEST_SLACK = 1e100, 1e12
_Joint = Annotated[Array, Shape("N", "N"), PACKED, OR_NULL, AtLeast(-LARGEST_COVARIANCE), AtMost(LARGEST_COVARIANCE)]


@dataclass(frozen=True, eq=False, kw_only=True)
class JointSolution(Solved):
    """What a rig's file says in the words of its calibration."""

    reference: Annotated[int, AtLeast(-1)]  # the camera whose frame the rig's is; -1: a carrier's
    rig_frame: Word  # its name, or "flange", "base", "table"
    covariance: _Joint  # (N, N) by the noise alone, rows as those of `Rig`
    target_covariance: Annotated[_Joint | None, LEFT_OUT] = None
    """Of what the target's own shape may have done; None: not known."""
    circle_doubt: Annotated[CircleDoubt | None, LEFT_OUT] = None  # of all N unknowns; None: what points are is known
    capture_covariance: Annotated[_Joint | None, LEFT_OUT] = None  # of what is alike in all photos; None: nothing
    photo_covariance: Annotated[_Joint | None, LEFT_OUT] = None  # of what the photos of a frame share; None: likewise
    slack: Annotated[Annotated[float, AtLeast(0), AtMost(LARGEST_SLACK)] | None, LEFT_OUT] = None
    """By how much less surely a photo tells its pose than errors of its own would let it (variances); None: at once."""
    carrier: Annotated[MechanismFit | None, LEFT_OUT] = None


@dataclass(frozen=True, eq=False, kw_only=True)
class RigCalibration(JointSolution):
    """A solved rig of C cameras, its V frames and how sure they are: `found.rig.save("rig.json")`."""

    observations: RigObservations  # of the frames that were solved
    cameras: tuple[Camera, ...]  # (C,)
    cam_from_rig: Array  # (C, 4, 4)
    rig_from_target: Array  # (V, 4, 4)
    residual_px: tuple[Array, ...]  # (C,) of (M_c, 2): predicted - measured, of outliers too
    is_outlier: tuple[Flags, ...]  # (C,) of (M_c,): left out of the solution
    scale: Array  # (C,) posterior standard deviation of an observation: px, or in units of the stated covariance
    frame_covariance: Array  # (V, 6, 6) of rig_from_target, in the rig's axes: rotation vector (rad), shift (mm)
    pose_covariance: tuple[Array, ...]  # (C,) of (V_c, 6, 6) of each camera's cam_from_target, likewise in its own axes
    fixed: tuple[tuple[str, ...], ...]  # (C,) parameters of each camera that were not estimated
    delay_s: Array | None = None  # (C,) see `Rig`; None: not estimated
    delay_sigma_s: Array | None = None  # (C,)
    alone_scale: Array | None = None  # (C,) as `scale`, of each camera by itself: more in the rig is told by no lens
    target_bend: PlaneBend | None = None  # by which the points were moved; None: it was no unknown
    priors: tuple[tuple[ParameterPrior, ...], ...]  # (C,) what was known of each camera's parameters beforehand

    def __post_init__(self) -> None:
        freeze(
            self, "cam_from_rig", "rig_from_target", "scale", "covariance", "frame_covariance", "delay_s",
            "delay_sigma_s", "alone_scale", "target_covariance", "capture_covariance", "photo_covariance",
        )  # fmt: skip
        for name in ("residual_px", "pose_covariance"):
            object.__setattr__(self, name, tuple(frozen_array(one) for one in getattr(self, name)))
        object.__setattr__(self, "is_outlier", tuple(frozen_array(one, np.bool_) for one in self.is_outlier))

    @property
    def stated_covariance(self) -> Array:
        """The joint covariance as it is to be told: by noise, target, doubts and what photos share."""
        doubt = None if self.circle_doubt is None else self.circle_doubt.param_covariance
        parts = (self.target_covariance, doubt, self.capture_covariance, self.photo_covariance)
        stated: Array = sum((one for one in parts if one is not None), start=np.asarray(self.covariance))
        return 0.5 * (stated + stated.T)  # rounding differs on both sides of the diagonal, and readers refuse that

    @property
    def noise_px(self) -> Array:
        """Root mean square of a coordinate of each camera's residuals, redundancy regarded.  # (C,)"""
        if not self.weighted:
            return self.scale
        mean = [
            float(np.sqrt(0.5 * np.trace(seen.cov_px2, axis1=1, axis2=2).mean())) if seen.cov_px2 is not None else 1.0
            for seen in self.observations.sightings
        ]
        return np.asarray(self.scale * np.array(mean))

    @property
    def rig(self) -> Rig:
        """What a program needs of it, and `rig.json` keeps."""
        stated = self.stated_covariance
        return Rig(
            self.observations.camera_names, self.cameras, self.cam_from_rig,
            stated if np.isfinite(stated).all() else None, self.noise_px,
            self.delay_s, self.rig_frame, self.observations.points.geometry_id,
        )  # fmt: skip

    @property
    def is_refined(self) -> tuple[bool, ...]:
        """Whether each camera's own parameters were solved.  # (C,)"""
        each = zip(self.fixed, self.cameras, strict=True)
        return tuple(set(fixed) != set(parameter_names(camera.model)) for fixed, camera in each)

    @property
    def choices(self) -> tuple[CameraChoice, ...]:
        """How each camera was solved, from where it ended.  # (C,)"""
        return tuple(
            CameraChoice(
                one.model, one, is_refined, tuple((name, one.parameters[name]) for name in fixed) if is_refined else (),
                priors if is_refined else (),
            )
            for one, is_refined, fixed, priors in zip(
                self.cameras, self.is_refined, self.fixed, self.priors, strict=True
            )
        )  # fmt: skip

    @cached_property
    def alone(self) -> tuple[Calibration, ...]:
        """Each camera with its views, for what is asked of one camera: `calib.evaluate(found.alone[0])`.  # (C,)

        Its poses are those of the joint solution, and as sure; its target is as large as they tell.
        """
        rig, seen, stated = self.rig, self.observations, self.stated_covariance
        size = 1.0 if self.carrier is None else self.carrier.size
        said = f"the target is {100 * size:.5g} % of what its file says, as the robot's ways told when this was solved"
        return tuple(
            Calibration(
                camera=camera,
                observations=self._as_large(seen.sightings[row], size),
                cam_from_target=self.cam_from_rig[row] @ self.rig_from_target[seen.frame[row]],
                residual_px=self.residual_px[row],
                is_outlier=self.is_outlier[row],
                scale=float(self.scale[row]),
                param_covariance=stated[rig.params_rows(row), rig.params_rows(row)],
                pose_covariance=self.pose_covariance[row],
                fixed=self.fixed[row],
                weighted=self.weighted,
                status=self.status,
                remarks=() if size == 1 else (said,),
                iterations=self.iterations,
                seconds=self.seconds,
                target_bend=self.target_bend,
                priors=self.priors[row],
            )
            for row, camera in enumerate(self.cameras)
        )

    def _as_large(self, seen: Observations, size: float) -> Observations:
        """What a camera saw of a target of that part of the size that its file says; a bend is no part of it."""
        if size == 1:
            return seen
        points, flat = seen.points, (seen if self.target_bend is None else self.target_bend.flattened(seen)).points
        position_mm, plane = points.position_mm + (size - 1) * flat.position_mm, points.plane * (1, 1, 1, size)
        circle_mm = None if points.circle_mm is None else size * points.circle_mm
        return replace(seen, points=replace(points, position_mm=position_mm, plane=plane, circle_mm=circle_mm))


def as_given(found: RigCalibration) -> RigObservations:
    """What a rig was solved from, the points where the target's file has them."""
    seen, bend = found.observations, found.target_bend
    return seen if bend is None else replace(seen, sightings=tuple(bend.flattened(one) for one in seen.sightings))
