"""Vanishing lines for fits, grids taken apart at edges, and cameras that do not fit."""

from dataclasses import replace

import numpy as np
import pytest

from calib.cameras.camera import camera_or_preset
from calib.detector.grid import Grid, planar_parts
from calib.detector.lens import CameraLens, NoLens
from calib.detector.lines import Seen, fit_lines, with_sound_lines
from calib.detector.pipeline import detect
from calib.detector.place import place_faces
from calib.detector.plan import plan_for
from tests.support.ring_views import CAMERA, board, ico, scene_of, true_naming, view_of


def test_lines_are_those_of_the_true_plane() -> None:
    """The line at every feature is the horizon of its face's plane under the true pose, within its covariance."""
    target, scene = ico(), scene_of(ico(), 3, noise_px=0.02)
    naming = true_naming(scene)
    placement = place_faces(plan_for(target), scene.candidates, naming, CAMERA.image_size, NoLens())
    center = scene.candidates.ellipse[naming.candidate, :2]
    seen = Seen(center, np.full(len(center), 0.02), np.ones(len(center), dtype=bool))
    lines = fit_lines(plan_for(target), naming.ring, seen, NoLens(), placement)
    normal = (scene.cam_from_target[:3, :3] @ target.target_from_face[target.ring_face[naming.ring], :3, 2].T).T
    # The horizon holds n . (K^-1 u) = 0, linear in u: m = -grad(n . K^-1 u) / (n . K^-1 center).
    inverse = np.linalg.inv(CAMERA.matrix)
    at = (normal * (np.column_stack([center, np.ones(len(center))]) @ inverse.T)).sum(axis=1)
    slope = normal @ inverse[:, :2]
    off = lines.line + slope / at[:, None]
    squared = np.einsum("ni,nij,nj->n", off, lines.information, off)
    assert lines.known.all()
    assert np.median(squared) < 5.0
    assert np.median(np.linalg.norm(off, axis=1)) < 0.1 * np.median(np.linalg.norm(lines.line, axis=1))


def test_one_row_and_a_stray_have_no_line_of_their_own() -> None:
    """A homography that hangs on one point off a row is not trusted: without other faces the line stays unknown."""
    target = board()
    scene = scene_of(target, 1, noise_px=0.02)
    naming = true_naming(scene)
    placement = place_faces(plan_for(target), scene.candidates, naming, CAMERA.image_size, NoLens())
    index = target.ring_index[naming.ring]
    row = index[:, 1] == np.median(index[:, 1])
    stray = np.flatnonzero(~row)[:1]
    use = row.copy()
    use[stray] = True
    seen = Seen(scene.candidates.ellipse[naming.candidate, :2], np.full(len(use), 0.02), use)
    assert use.sum() >= 6
    assert not fit_lines(plan_for(target), naming.ring, seen, NoLens(), placement).known.any()


def test_a_grid_over_two_faces_falls_into_its_faces() -> None:
    """Two faces joined into one grid come apart along their edge, with nothing of one in the other."""
    target, scene = ico(), scene_of(ico(), 5)
    pitch = plan_for(target).pitch_radii
    faces, count = np.unique(target.ring_face[scene.row], return_counts=True)
    first, second = faces[np.argsort(-count)[:2]]
    rows = [np.flatnonzero(target.ring_face[scene.row] == face) for face in (first, second)]
    index = np.concatenate([target.ring_index[scene.row[part]] + [0, 20 * k] for k, part in enumerate(rows)])
    joined = Grid(np.concatenate(rows), index, np.zeros(len(index)))
    parts = planar_parts(scene.candidates, joined, pitch)
    assert {frozenset(part.row.tolist()) for part in parts} == {frozenset(part.tolist()) for part in rows}


@pytest.mark.parametrize("k1", [-0.9, -5.0, 0.5])
def test_a_camera_that_does_not_fit_is_named(k1: float) -> None:
    """A camera whose lens folds inside the image or bends the grids costs features and is said to, without failing."""
    view = view_of(board(), 4, distance_mm=300)
    bent = CAMERA.params.copy()
    bent[4] = k1
    found = detect(view.image, board(), name="x", camera=replace(CAMERA, params=bent))
    assert any("--camera" in remark for remark in found.remarks)
    fitting = detect(view.image, board(), name="x", camera=CAMERA)
    assert not any("--camera" in remark for remark in fitting.remarks)


def test_a_camera_without_rays_is_refused() -> None:
    """A focal length beyond all measure is no camera: one line, no traceback from the depths."""
    wide = camera_or_preset("wide-webcam")
    params = wide.params.copy()
    params[:2] = 1e300
    with pytest.raises(ValueError, match="no usable rays"):
        CameraLens(replace(wide, params=params))


def test_lines_that_better_centres_contradict_are_theirs() -> None:
    """A face whose line lies five sigmas off, as a ring covered in part may turn it, gets the better one, no other."""
    target, scene = ico(), scene_of(ico(), 3, noise_px=0.02)
    naming, plan = true_naming(scene), plan_for(ico())
    placement = place_faces(plan, scene.candidates, naming, CAMERA.image_size, NoLens())
    center = scene.candidates.ellipse[naming.candidate, :2]
    seen = Seen(center, np.full(len(center), 0.02), np.ones(len(center), dtype=bool))
    fine = fit_lines(plan, naming.ring, seen, NoLens(), placement)
    face = target.ring_face[naming.ring]
    sigma = np.sqrt(np.diagonal(np.linalg.inv(fine.information), axis1=1, axis2=2))
    sigmas_off = np.where(face == face[0], 5.0, 1.0)
    rough = replace(fine, line=fine.line + sigmas_off[:, None] * sigma * [1, -1])
    found = with_sound_lines(rough, fine)
    assert found is not None
    assert np.array_equal(found.line, np.where((face == face[0])[:, None], fine.line, rough.line))
    assert np.array_equal(found.information, rough.information)
    assert with_sound_lines(fine, fine) is None
