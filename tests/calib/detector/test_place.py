"""Where features must be, from those that have names."""

import numpy as np
import pytest

from calib.cameras import project
from calib.cameras.camera import camera_or_preset
from calib.core.se3 import transform
from calib.detector.candidates import Candidates
from calib.detector.lens import CameraLens, NoLens
from calib.detector.photo_checks import lattice_over_spacing
from calib.detector.place import (
    Naming,
    Placement,
    Places,
    assign,
    complete,
    direct_projection,
    place_faces,
    predict,
    without_strangers,
)
from calib.detector.plan import plan_for
from tests.support.ring_views import CAMERA, board, ellipse_of, ico, scene_of, true_naming

SIZE = CAMERA.image_size


def test_projection_of_exact_points_is_the_camera() -> None:
    """From exact points the direct solution projects all others, with positive depth in front."""
    scene = scene_of(ico(), 1, noise_px=0.0)
    row = scene.row
    matrix = direct_projection(ico().center_mm[row], scene.truth.center_px[row])
    point = np.random.default_rng(1).uniform(-100, 100, (50, 3))
    expected = project(CAMERA, transform(scene.cam_from_target, point))
    mapped = point @ matrix[:, :3].T + matrix[:, 3]
    assert mapped[:, :2] / mapped[:, 2:] == pytest.approx(expected, abs=1e-4)
    assert (mapped[:, 2] > 0).all()
    assert np.linalg.det(matrix[:, :3]) > 0
    flipped = scene.truth.center_px[row] * (-1, 1)
    assert np.linalg.det(direct_projection(ico().center_mm[row], flipped)[:, :3]) < 0


@pytest.mark.parametrize("seed", range(4))
def test_predicted_places_are_where_the_camera_puts_them(seed: int) -> None:
    """Predicted places and shapes are the projected centres and rims, on all faces that show, and no others."""
    scene = scene_of(ico(), seed, noise_px=0.0)
    placement = place_faces(plan_for(ico()), scene.candidates, true_naming(scene), SIZE, NoLens())
    places = predict(plan_for(ico()), placement, SIZE)
    assert not placement.is_mirrored
    assert set(scene.row.tolist()) <= set(places.ring.tolist())
    assert scene.truth.visible[places.ring].all()
    assert places.center_px == pytest.approx(scene.truth.center_px[places.ring], abs=0.02)
    flat = scene.truth.incidence_rad[places.ring] < 1.1
    rims = np.array([ellipse_of(scene.truth.rim_px[ring])[2:] for ring in places.ring[flat]])
    assert places.shape[flat] == pytest.approx(rims, rel=0.03, abs=2e-3)


@pytest.mark.parametrize("is_known", [False, True])
def test_places_follow_a_strong_lens(is_known: bool) -> None:
    """With a wide webcam, its lens known or estimated from the grid, places are right to a pixel or better."""
    camera = camera_or_preset("wide-webcam")
    scene = scene_of(board(), 2, camera=camera, distance_mm=170.0, noise_px=0.02)
    lens = CameraLens(camera) if is_known else None
    placement = place_faces(plan_for(board()), scene.candidates, true_naming(scene), camera.image_size, lens)
    places = predict(plan_for(board()), placement, camera.image_size)
    error = np.linalg.norm(places.center_px - scene.truth.center_px[places.ring], axis=1)
    named = np.isin(places.ring, scene.row)
    assert named.sum() > 20
    assert error[named].max() < (0.1 if is_known else 0.6)


@pytest.mark.parametrize("seed", range(4))
def test_names_spread_from_two_faces_over_all(seed: int) -> None:
    """Two named faces and a stranger or two are enough: every feature gets its name, and nobody a wrong one."""
    scene = scene_of(ico(), seed, clutter=20)
    naming = true_naming(scene)
    face = ico().ring_face[naming.ring]
    faces, count = np.unique(face, return_counts=True)
    first = np.isin(face, faces[np.argsort(-count)[:2]])
    known = Naming(naming.candidate[first], naming.ring[first])
    spread, placement = complete(plan_for(ico()), scene.candidates, known, SIZE, NoLens())
    assert len(spread.ring) > 0.97 * len(naming.ring)
    real = scene.row[spread.candidate] >= 0
    assert np.array_equal(scene.row[spread.candidate[real]], spread.ring[real])
    assert (~real).sum() <= 1
    assert set(faces.tolist()) <= set(placement.seen().tolist())


@pytest.mark.parametrize(("seed", "flat"), [(5, 0), (9, 11), (18, 9), (25, 10)])
def test_a_face_seen_from_its_edge_is_not_named_by_the_others(seed: int, flat: int) -> None:
    """A piece that sits too high there would bear its neighbours' names; what is on the face itself still names it."""
    scene = scene_of(ico(), seed, steepest_rad=1.5)
    naming = true_naming(scene)
    others = ico().ring_face[naming.ring] != flat
    assert (~others).sum() > 15
    for named, shows in ((others, False), (np.full(len(others), True), True)):
        known = Naming(naming.candidate[named], naming.ring[named])
        spread, placement = complete(plan_for(ico()), scene.candidates, known, SIZE, NoLens())
        assert (flat in placement.seen()) == shows
        assert (flat in ico().ring_face[spread.ring]) == shows


def test_a_face_that_shows_a_single_row_costs_that_face_only() -> None:
    """Rings on one line fix no homography: lens and all other faces are as if they had not been seen."""
    scene = scene_of(ico(), 1)
    plan, naming = plan_for(ico()), true_naming(scene)
    face = ico().ring_face[naming.ring]
    faces, count = np.unique(face, return_counts=True)
    poor = face == faces[np.argmax(count)]
    row = poor & (ico().ring_index[naming.ring, 1] == 0)
    assert row.sum() == 6
    with_row, without = (
        place_faces(plan, scene.candidates, Naming(naming.candidate[keep], naming.ring[keep]), SIZE, None)
        for keep in (~poor | row, ~poor)
    )
    others = np.setdiff1d(without.seen(), faces[np.argmax(count)])
    assert len(others) > 1
    assert with_row.lens == without.lens
    well = [f for f in others if (face == f).sum() >= 10]
    assert with_row.homography[well] == pytest.approx(without.homography[well])
    only = place_faces(plan, scene.candidates, Naming(naming.candidate[row], naming.ring[row]), SIZE, None)
    assert not len(only.seen())


def test_assignment_is_one_to_one_and_near() -> None:
    """Two candidates at one place, or one at two: each name is given once, to the nearest; sizes must be alike."""
    plan = plan_for(board())
    scene = scene_of(board(), 5, noise_px=0.0)
    placement = place_faces(plan, scene.candidates, true_naming(scene), SIZE, NoLens())
    places = predict(plan, placement, SIZE)
    ellipse = scene.candidates.ellipse
    twin, giant = ellipse.copy(), ellipse.copy()
    twin[:, 0] += 1.5
    giant[:, 2:] /= 1.6
    crowd = Candidates(
        np.vstack([giant, twin, ellipse]), np.full(3 * len(ellipse), 0.45), np.zeros(3 * len(ellipse), np.int64),
        np.zeros(3 * len(ellipse)),
    )  # fmt: skip
    naming = assign(plan, crowd, places)
    assert len(set(naming.candidate.tolist())) == len(naming.candidate)
    assert len(set(naming.ring.tolist())) == len(naming.ring)
    assert (naming.candidate >= 2 * len(ellipse)).all()
    assert np.array_equal(scene.row[naming.candidate - 2 * len(ellipse)], naming.ring)


def test_two_places_do_not_share_a_candidate() -> None:
    """Where two features should lie at one place, only one of them gets the candidate there."""
    plan = plan_for(board())
    scene = scene_of(board(), 5, noise_px=0.0)
    places = predict(plan, place_faces(plan, scene.candidates, true_naming(scene), SIZE, NoLens()), SIZE)
    doubled = Places(places.ring[:2], places.center_px[[0, 0]] + ((0.0, 0.0), (0.5, 0.0)), places.shape[[0, 0]])
    naming = assign(plan, scene.candidates, doubled)
    assert naming.ring.tolist() == [places.ring[0]]


@pytest.mark.parametrize("seed", range(4))
def test_a_face_by_a_wrong_name_is_dropped(seed: int) -> None:
    """A face that bears another's name contradicts the others: it goes, the others stay."""
    scene = scene_of(ico(), seed)
    naming = true_naming(scene)
    face = ico().ring_face[naming.ring]
    faces, count = np.unique(face, return_counts=True)
    assert len(faces) > 3
    unseen = next(f for f in range(20) if f not in faces)
    wrong = faces[np.argmax(count)]
    index = {
        tuple(i): r
        for r, i in zip(
            np.flatnonzero(ico().ring_face == unseen), ico().ring_index[ico().ring_face == unseen].tolist(), strict=True
        )
    }
    ring = np.array(
        [
            index[tuple(ico().ring_index[r].tolist())] if f == wrong else r
            for r, f in zip(naming.ring, face, strict=True)
        ]
    )
    kept, dropped = without_strangers(plan_for(ico()), scene.candidates, Naming(naming.candidate, ring), SIZE, NoLens())
    assert dropped == (unseen,)
    assert set(ico().ring_face[kept.ring].tolist()) == set(faces.tolist()) - {wrong}
    same, none = without_strangers(plan_for(ico()), scene.candidates, naming, SIZE, NoLens())
    assert none == ()
    assert np.array_equal(same.ring, naming.ring)


def test_mirrored_names_are_known_as_such() -> None:
    """If all names are right but the image is flipped, the placement says mirrored."""
    scene = scene_of(ico(), 2)
    ellipse = scene.candidates.ellipse.copy()
    ellipse[:, 0] = SIZE[0] - 1 - ellipse[:, 0]
    flipped = Candidates(ellipse, scene.candidates.ratio, scene.candidates.region, scene.candidates.misfit_px)
    assert place_faces(plan_for(ico()), flipped, true_naming(scene), SIZE, NoLens()).is_mirrored


@pytest.mark.parametrize("beside", [1, 2, 3])
def test_a_few_points_beside_a_face_tell_no_projection(beside: int) -> None:
    """One face and up to three rings of the next say nothing of the solid: not its spacing, nor where its faces are."""
    scene = scene_of(ico(), 1, noise_px=0.2)
    face = ico().ring_face[scene.row]
    faces, count = np.unique(face, return_counts=True)
    first, second = faces[np.argsort(-count)[:2]]
    rows = np.concatenate([np.flatnonzero(face == first), np.flatnonzero(face == second)[:beside]])
    ring = scene.row[rows]
    rng = np.random.default_rng(2)
    for _ in range(20):
        center = scene.truth.center_px[ring] + rng.normal(0, 0.2, (len(ring), 2))
        assert lattice_over_spacing(plan_for(ico()), NoLens(), ring, center) == 0
    placement = place_faces(plan_for(ico()), scene.candidates, Naming(rows, ring), SIZE, NoLens())
    assert placement.seen().tolist() == [first]


def test_a_face_seen_from_its_edge_has_no_places() -> None:
    """A map that leaves all of a face on a line has no way back: nan, as for a face that does not show."""
    edge_on = np.array([[[1.0, 1, 0], [2, 2, 0], [0, 0, 1]], np.full((3, 3), np.nan)])
    placement = Placement(NoLens(), edge_on, edge_on)
    for face in range(2):
        assert np.isnan(placement.on_face(face, np.ones((4, 2)))).all()
