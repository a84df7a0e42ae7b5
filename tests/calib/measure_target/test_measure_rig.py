"""A print that several cameras see at once: the equations, and what is gained as the cameras are held together."""

from dataclasses import replace

import numpy as np
import pytest

from calib.core.se3 import invert
from calib.core.types import Observations, RigObservations, keep_sightings
from calib.measure_target.blocks import moved_state, normal_equations
from calib.measure_target.datum import best_motion, gauge_rows, what_is_seen
from calib.measure_target.problem import HeldPoses, State, chains_of, joint_problem
from calib.measure_target.result import AsBuilt
from calib.measure_target.solve import measure, measure_rig
from calib.measure_target.unknowns import AsBuiltOptions, unknowns_of
from calib.observe.observations import known_points
from calib.solver.eliminate import JointStep
from calib.solver.priors import ParameterPrior
from calib.solver.problem import SolveOptions, tie_parameters
from designer.base.arrays import Array, Rows
from designer.base.errors import InputError
from designer.kinds.board import BoardSpec
from designer.kinds.layout import lay_out
from tests.support.as_built_scenes import dense, printed, rig_before_print, solid, truth_of

OPTIONS = AsBuiltOptions()
CAMERAS, FRAMES = 3, 8


@pytest.mark.parametrize("is_rigid", [True, False])
def test_equations_over_frames_are_those_over_photos_by_the_chain_rule(is_rigid: bool) -> None:
    """Normal matrix and gradient are those of the dense problem; and the gradient is half the slope of the cost."""
    found, shape = rig_before_print()
    seen, options = found.observations, replace(OPTIONS, ring_sigma_mm=None if is_rigid else (0.05, 0.02))
    unknowns = unknowns_of(solid(), options)
    ties = [tie_parameters("opencv", SolveOptions(fixed=(("k3", None),)))] * CAMERAS
    parts = what_is_seen(unknowns, [(one, np.ones(len(one.view), dtype=bool)) for one in seen.sightings], seen.frame)
    gauge = gauge_rows(unknowns, parts, 100.0)
    joint = joint_problem(seen.sightings, ties, unknowns, gauge, weighted=True, frame=seen.frame)
    held = HeldPoses(found.cam_from_rig, found.rig_from_target)
    assert joint.held is not None
    state = State(found.cameras, held.seen(joint.held), shape, held)
    apart, frames = normal_equations(replace(joint, held=None), state), 6 * FRAMES
    matrix, gradient = dense(normal_equations(joint, state))
    over_photos, slope = dense(apart)
    photos, rings = 6 * len(apart.pose), 3 * len(apart.ring)
    chain = np.zeros((len(slope), len(gradient)))
    chain[photos:, frames:] = np.eye(len(slope) - photos)
    row = 0
    for one in chains_of(joint.held, held):
        for by_frame, by_camera, frame in zip(one.by_frame, one.by_shared, one.frame, strict=True):
            chain[row : row + 6, 6 * frame : 6 * frame + 6] = by_frame
            if one.column[0] >= 0:
                chain[row : row + 6, frames + rings + one.column] = by_camera
            row += 6
    unit = np.sqrt(np.diagonal(matrix))
    assert np.abs((matrix - chain.T @ over_photos @ chain) / unit / unit[:, None]).max() < 1e-9
    assert np.abs((gradient - chain.T @ slope) / unit).max() < 1e-9 * np.abs(gradient / unit).max()
    direction = np.random.default_rng(1).standard_normal(len(gradient)) / unit
    ahead, behind = (
        normal_equations(joint, moved_state(joint, state, _step(sign * 1e-3 * direction, frames, rings))).cost
        for sign in (1, -1)
    )
    assert (ahead - behind) / 4e-3 == pytest.approx(gradient @ direction, rel=1e-4, abs=1e-2)


def _step(step: Array, frames: int, rings: int) -> JointStep:
    first = frames + rings
    return JointStep(step[:frames].reshape(-1, 6), step[frames:first].reshape(-1, 3), step[first:], 0.0)


def test_a_rig_of_one_camera_measures_what_its_photos_do() -> None:
    """Wherever the rig's frame is."""
    found, _ = rig_before_print()
    seen, rig_from_cam = found.observations, invert(found.cam_from_rig[1])
    frames = found.observations.frame[1]
    alone = replace(
        found,
        observations=RigObservations(seen.camera_names[:1], tuple(seen.frame_names[k] for k in frames.tolist()),
                                     seen.sightings[1:2], (np.arange(len(frames)),)),
        cameras=found.cameras[1:2], cam_from_rig=invert(rig_from_cam)[None], reference=0,
        rig_from_target=found.rig_from_target[frames], residual_px=found.residual_px[1:2],
        is_outlier=found.is_outlier[1:2], scale=found.scale[1:2], fixed=((),), priors=((),),
        covariance=np.zeros((15, 15)), frame_covariance=found.frame_covariance[frames],
        pose_covariance=found.pose_covariance[1:2],
    )  # fmt: skip
    by_photos = measure(seen.sightings[1:2], solid(), "opencv", OPTIONS)
    by_rig = measure_rig(alone, solid(), OPTIONS)
    assert by_rig.target.center_mm == pytest.approx(by_photos.target.center_mm, abs=1e-4)
    assert by_rig.target.face_covariance == pytest.approx(by_photos.target.face_covariance, rel=1e-2, abs=1e-9)
    assert by_rig.scale == pytest.approx(by_photos.scale, rel=1e-4)


def _place_sigma_mm(found: AsBuilt) -> float:
    """Of a coordinate of a face's place, root mean square."""
    return float(np.sqrt(np.diagonal(found.target.face_covariance, axis1=1, axis2=2)[:, 3:].mean()))


def test_a_rig_tells_more_of_a_print_and_states_it_truly() -> None:
    """From the same photos faces are known better; places are off by as much as is stated.

    What was known of a lens beforehand is not used, and said so.
    """
    found, shape = rig_before_print()
    priors = ((), (ParameterPrior("fx_px", 1250.0, 10.0),), ())
    by_rig = measure_rig(replace(found, priors=priors), solid(), OPTIONS)
    name = found.observations.camera_names[1]
    assert [line for line in by_rig.remarks if "not used" in line] == [
        f"{name}: what the rig knew of its lens beforehand is not used here (fx_px)"
    ]
    by_photos = measure(found.observations.sightings, solid(), "opencv", OPTIONS)
    assert _place_sigma_mm(by_photos) > 1.1 * _place_sigma_mm(by_rig)
    assert by_rig.scale == pytest.approx(1.0, abs=0.05)
    truth = truth_of(by_rig, shape, OPTIONS).target.target_from_face
    off = (invert(truth) @ by_rig.target.target_from_face)[:, :3, 3]
    variance = np.diagonal(by_rig.target.face_covariance, axis1=1, axis2=2)[:, 3:]
    assert 0.8 < np.sqrt((off**2 / variance).mean()) < 1.25


def test_faces_that_no_photo_shows_together_are_joined_by_frames() -> None:
    """Of photos that show one face each, single cameras tell of no face where another is; a rig does."""
    found, shape = rig_before_print(0, cameras=4, frames=20)
    one_face = tuple(map(_largest_face, found.observations.sightings))
    rows = [
        np.isin(_keys(all_), _keys(some)) for all_, some in zip(found.observations.sightings, one_face, strict=True)
    ]
    poor = replace(
        found,
        observations=replace(found.observations, sightings=one_face),
        residual_px=tuple(one[row] for one, row in zip(found.residual_px, rows, strict=True)),
        is_outlier=tuple(one[row] for one, row in zip(found.is_outlier, rows, strict=True)),
    )
    by_rig = measure_rig(poor, solid(), OPTIONS)
    assert by_rig.is_determined.sum() >= 10
    known = by_rig.is_determined[solid().ring_face]
    true_mm, found_mm = printed(solid(), shape).center_mm[known], by_rig.target.center_mm[known]
    scale, rotation, shift = best_motion(true_mm, found_mm, with_scale=True)
    assert np.sqrt(((scale * true_mm @ rotation.T + shift - found_mm) ** 2).mean()) < 0.06
    pairs = [(one, np.ones(len(one.view), dtype=bool)) for one in one_face]
    apart = what_is_seen(unknowns_of(solid(), OPTIONS), pairs)
    assert len(np.unique(apart.group[apart.face])) == apart.face.sum()


def _keys(seen: Observations) -> Rows:
    return seen.view * solid().ring_count + seen.point


def _largest_face(seen: Observations) -> Observations:
    """The sightings of the face that each photo shows most rings of."""
    face = solid().ring_face[seen.point]
    count = np.zeros((seen.view_count, solid().face_count))
    np.add.at(count, (seen.view, face), 1)
    return keep_sightings(seen, face == count.argmax(axis=1)[seen.view])


def test_what_a_rig_does_not_measure_is_refused() -> None:
    """Photos taken one after another, and a board whose two sides are seen at once."""
    found, _ = rig_before_print()
    with pytest.raises(InputError, match="one after another"):
        measure_rig(replace(found, delay_s=np.zeros(CAMERAS)), solid())
    sides = lay_out(
        BoardSpec((240.0, 200.0), 3.0, 11, 9, "square", 14.0, 0.45, 20.0, 0.0, 1.0, dots=True, two_sided=True)
    )
    points = known_points(sides)
    seen = tuple(replace(one, points=points) for one in found.observations.sightings)
    with pytest.raises(InputError, match="front and back"):
        measure_rig(replace(found, observations=replace(found.observations, sightings=seen)), sides)
    with pytest.raises(ValueError, match="rings"):
        measure_rig(found, sides)
