"""What a camera is solved from: nothing usable is lost, nothing unusable is kept, and everything left out is said."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.core.types import Detections, FaceRecord, Observations
from calib.observe.dataset import RECORDS, read_detections, records_path, write_detections
from calib.observe.observations import (
    known_points,
    misplaced_pieces,
    observations_for_poses,
    observations_from_detections,
)
from calib.solver.solve import solve
from designer.base.errors import InputError
from designer.target import TargetGeometry
from tests.support.calibrations import board, camera, icosahedron, poses_around, seen_by
from tests.support.command_line import SIGMA_PX, detections_of

Change = Callable[[Detections], Detections]

BOARD, ICO = board(), icosahedron()


def photos(count: int, target: TargetGeometry = BOARD, seed: int = 0) -> list[Detections]:
    """Detections of a target in different poses, with noise as stated."""
    rng = np.random.default_rng(seed)
    seen = seen_by(camera(), known_points(target), poses_around(count, rng, distance_mm=250.0))
    center = seen.center_px + rng.normal(0, SIGMA_PX, seen.center_px.shape)
    names = tuple(f"{view}.png" for view in range(count))
    return detections_of(replace(seen, view_names=names, center_px=center), target)


def prepared(seen: list[Detections], target: TargetGeometry = BOARD) -> Observations:
    """The observations in detections."""
    return observations_from_detections(seen, target, origin="d.csv")


def again(seen: Detections, name: str, sigma_px: float, rng: np.random.Generator) -> Detections:
    """A photo that shows the same, with further differences."""
    return replace(seen, image=name, center_px=seen.center_px + rng.normal(0, sigma_px, seen.center_px.shape))


@pytest.mark.parametrize("target", [BOARD, ICO], ids=["board", "icosahedron"])
def test_the_points_lie_in_the_planes_of_their_faces(target: TargetGeometry) -> None:
    """`n X = d` holds for every ring, normals are units and point away from the middle of a solid."""
    points = known_points(target)
    plane = points.plane[points.face]
    assert np.abs((plane[:, :3] * points.position_mm).sum(axis=1) - plane[:, 3]).max() < 1e-9
    assert np.linalg.norm(points.plane[:, :3], axis=1) == pytest.approx(1)
    assert points.geometry_id == target.geometry_id
    assert target is BOARD or points.plane[:, 3].min() > 10


def test_good_photos_are_all_kept() -> None:
    """Every sighting arrives with its ring, place and covariance, and nothing is said."""
    seen = photos(8, ICO)
    done = prepared(seen, ICO)
    assert done.remarks == ()
    one = done
    assert one.view_names == tuple(photo.image for photo in seen)
    assert one.image_size == camera().image_size
    assert np.array_equal(one.point, np.concatenate([photo.ring for photo in seen]))
    assert np.array_equal(one.center_px, np.concatenate([photo.center_px for photo in seen]))
    assert one.cov_px2 is not None
    assert np.array_equal(one.cov_px2, np.concatenate([photo.cov_px2 for photo in seen]))
    assert np.array_equal(one.points.position_mm, ICO.center_mm)
    assert np.array_equal(one.points.face, ICO.ring_face)


def on_row(seen: Detections, extra: int) -> Detections:
    """The rings of one row of the board, and some others."""
    row = BOARD.ring_index[seen.ring, 1] == BOARD.ring_index[seen.ring[0], 1]
    others = np.flatnonzero(~row)[:extra]
    return seen.keep(np.sort(np.concatenate([np.flatnonzero(row), others])))


LEFT_OUT: dict[str, tuple[Change, str]] = {
    "none": (lambda seen: seen.keep(slice(0)), "show none of the points: 2.png"),
    "three": (lambda seen: seen.keep(slice(3)), "fewer than 4 points: 2.png"),
    "row": (lambda seen: on_row(seen, 0), "on a line, all or all but one: 2.png"),
    "row and one": (lambda seen: on_row(seen, 1), "on a line, all or all but one: 2.png"),
    "size": (lambda seen: replace(seen, image_size=(640, 480)), "not of 1200 x 900 px as the others: 2.png"),
    "mirrored": (
        lambda seen: replace(seen, center_px=np.array([1199, 0]) - seen.center_px * np.array([1, -1])),
        "the points mirrored: 2.png",
    ),
}


@pytest.mark.parametrize("name", LEFT_OUT)
def test_a_view_that_cannot_be_used_is_left_out_and_said(name: str) -> None:
    """One line names the view and the reason; the others are kept as they are."""
    change, reason = LEFT_OUT[name]
    seen = photos(6)
    kept = prepared([change(one) if one.image == "2.png" else one for one in seen])
    assert len(kept.remarks) == 1
    assert kept.remarks[0].startswith("left out")
    assert reason in kept.remarks[0]
    assert kept.view_names == ("0.png", "1.png", "3.png", "4.png", "5.png")
    expected = prepared([one for one in seen if one.image != "2.png"])
    for field in ("view", "point", "center_px", "cov_px2"):
        assert np.array_equal(getattr(kept, field), getattr(expected, field))


def test_four_points_in_a_row_of_two_are_enough() -> None:
    """A row and two other rings give a homography: the view is kept."""
    seen = photos(3)
    assert prepared([on_row(seen[0], 2), *seen[1:]]).remarks == ()


def test_the_size_of_most_images_counts() -> None:
    """As many of two sizes is an error that names both; views that are left out anyway have no vote."""
    seen = photos(5)
    small = [replace(one, image=f"small{one.image}", image_size=(640, 480)) for one in photos(4, seed=1)]
    assert prepared([*small[:2], *seen[:3]]).image_size == (1200, 900)
    with pytest.raises(InputError, match=r"^d\.csv: as many images of 640 x 480 px and 1200 x 900 px"):
        prepared([*small[:3], *seen[:3]])
    useless = [one.keep(slice(3)) for one in seen[:3]]
    assert prepared([*small[:1], *useless]).image_size == (640, 480)


def test_a_photo_given_twice_counts_once() -> None:
    """Identical photos, and copies saved again, are found whatever lies between them; the first one stays."""
    seen, rng = photos(5), np.random.default_rng(1)
    copy, saved_again = again(seen[1], "copy.png", 0.0, rng), again(seen[3], "saved.jpg", 0.2 * SIGMA_PX, rng)
    partly = again(seen[3], "partly.jpg", 0.2 * SIGMA_PX, rng).keep(slice(2, None))
    done = prepared([*seen, copy, saved_again, partly])
    assert done.view_names == tuple(one.image for one in seen)
    assert done.remarks == (
        "left out views that are another one once more: copy.png (as 1.png), saved.jpg (as 3.png), "
        "partly.jpg (as 3.png)",
    )


def test_photos_from_a_tripod_are_not_copies() -> None:
    """Photos of a standing target differ by their noise, and all count."""
    seen, rng = photos(2), np.random.default_rng(2)
    still = [again(seen[0], f"still{k}.png", SIGMA_PX, rng) for k in range(12)]
    assert len(prepared([*seen[1:], *still]).view_names) == 13
    blind = [replace(one, cov_px2=9 * one.cov_px2) for one in still]  # a detector that states too much
    assert len(prepared([*seen[1:], *blind]).view_names) == 13


def test_nothing_left_is_an_error_with_the_reason() -> None:
    """No usable view ends in one line with the last reason and the remedy."""
    with pytest.raises(InputError, match=r"^d\.csv: no view is left .*fewer than 4 points.*give photos") as refused:
        prepared([one.keep(slice(3)) for one in photos(9)])
    assert "and 5 more" in str(refused.value)
    with pytest.raises(InputError, match="mirrored"):
        prepared([LEFT_OUT["mirrored"][0](one) for one in photos(3)])
    with pytest.raises(InputError, match="no photo was searched"):
        observations_from_detections([], BOARD)
    with pytest.raises(ValueError, match="of layout x"):
        observations_from_detections([photos(1)[0], replace(photos(2)[1], layout_id="x")], BOARD)


def test_what_many_photos_say_is_not_lost_in_files(tmp_path: Path) -> None:
    """The records beside a table hold it; without them, or beside those of another target, nothing is said.

    What one photo alone says stands in its own record.
    """
    doubted = [
        replace(one, remarks=("is it this target?",) if n < 3 else ("mirrored",)) for n, one in enumerate(photos(4))
    ]
    path = tmp_path / "d.csv"
    records = write_detections(path, doubted, BOARD)

    def said() -> tuple[str, ...]:
        return prepared(list(read_detections(path, BOARD, target_path=Path("t")))).remarks

    assert said() == prepared(doubted).remarks == ("3 of 4 photos: is it this target?",)
    records_path(path).write_bytes(RECORDS.text(replace(records, geometry_id="another")))
    assert said() == ()
    records_path(path).unlink()
    assert said() == ()


def test_a_measured_target_takes_the_detections_of_the_nominal_one() -> None:
    """X, Y, Z are those of the target in use, and the remark names both geometries."""
    measured = replace(BOARD, source="measured", center_mm=BOARD.center_mm + 0.01)
    done = prepared(photos(3), measured)
    assert np.array_equal(done.points.position_mm, measured.center_mm)
    (remark,) = done.remarks
    assert BOARD.geometry_id in remark
    assert f"measured geometry {measured.geometry_id}" in remark
    with pytest.raises(ValueError, match="layout"):
        prepared(photos(3), ICO)


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_any_mixture_ends_in_whole_observations_or_one_line(data: st.DataObject) -> None:
    """Whatever is wrong with however many views: what is kept is kept whole, and each view is kept or said."""
    seen = photos(7)
    for k in range(len(seen)):
        change = data.draw(st.sampled_from([None, None, *LEFT_OUT]))
        seen[k] = LEFT_OUT[change][0](seen[k]) if change else seen[k]
    try:
        done = prepared(seen)
    except InputError:
        return
    by_name = {one.image: one for one in seen}
    kept = done
    for view, name in enumerate(kept.view_names):
        rows = kept.view == view
        assert np.array_equal(kept.point[rows], by_name[name].ring)
        assert np.array_equal(kept.center_px[rows], by_name[name].center_px)
    said = " ".join(done.remarks)
    assert all((name in kept.view_names) != (name in said) or "more" in said for name in by_name)


def test_poses_need_no_other_photo() -> None:
    """For poses a photo may come twice or stand alone; only what has too few points is left out."""
    seen = photos(3)
    data = [seen[0], replace(seen[0], image="b.png"), seen[1].keep(slice(3)), seen[2]]
    kept = observations_for_poses(data, BOARD)
    assert kept.view_names == ("0.png", "b.png", "2.png")
    assert observations_for_poses([seen[1].keep(slice(3))], BOARD) is None


@pytest.mark.parametrize("stated_px", [1e-6, 1e-9])
def test_no_ring_owns_the_solution_by_what_it_states(stated_px: float) -> None:
    """A ring half a pixel off that states a millionth moves the camera as one that states a quarter of the others'."""
    seen = photos(6)
    center, covariance = seen[2].center_px.copy(), seen[2].cov_px2.copy()
    center[5] += 0.5
    covariance[5] = stated_px**2 * np.eye(2)
    absurd = [*seen[:2], replace(seen[2], center_px=center, cov_px2=covariance), *seen[3:]]
    found = prepared(absurd)
    total = len(found.view)
    line = f"1 of {total} observations state less than 25% of the median standard deviation; they count as if they"
    assert any(remark.startswith(line) for remark in found.remarks)
    least = np.sqrt(np.linalg.eigvalsh(found.cov_px2)[:, 0].min())
    assert least == pytest.approx(0.25 * SIGMA_PX)
    solved = [solve(one, camera().model) for one in (prepared(seen), found)]
    assert all(one.weighted for one in solved)
    off = np.linalg.norm(solved[1].residual_px[found.view == 2], axis=1)
    assert off[5] > 0.3  # it is not followed
    assert abs(solved[1].camera.params[0] - solved[0].camera.params[0]) < 2.0


def test_stated_covariances_count_and_others_all_alike() -> None:
    """By default a solution is weighted where covariances are stated, and where there are none nothing is said."""
    found = prepared(photos(5))
    assert solve(found, camera().model).weighted
    without = solve(replace(found, cov_px2=None), camera().model)
    assert not without.weighted
    assert without.remarks == ()


def with_codes(face: int, codes: list[int | None]) -> list[Detections]:
    """Photos of a face that shows the codes of others, or None: its own."""
    other = FaceRecord(1, (), 0, 7, 7, ())
    return [
        replace(one, faces=(FaceRecord(face, () if code else ("dot",), 4, 7, 7, (), carries=code), other))
        for one, code in zip(photos(len(codes), ICO), codes, strict=True)
    ]


def test_most_photos_decide() -> None:
    """Another's code in most photos, and in two at the least, is told with the counts; a misreading is not."""
    (line,) = misplaced_pieces(with_codes(7, [12, 12, None, 12]))
    assert line.startswith("face 7 carries the code of face 12 in 3 of 4 photos: ")
    (line,) = misplaced_pieces(with_codes(7, [7, 7]))
    assert line.startswith("face 7 lies turned on its place in 2 of 2 photos: ")
    for codes in ([12], [None, None, 12, 12], [12, 9, 5], [None, None]):
        assert misplaced_pieces(with_codes(7, codes)) == ()


def test_it_is_told_of_photos_and_of_their_file_alike(tmp_path: Path) -> None:
    """What is solved from photos, or from the table of them, carries the line; without the records there is none."""
    found, path = with_codes(7, [12, 12, 12]), tmp_path / "detections.csv"
    (line,) = misplaced_pieces(found)
    assert line in observations_from_detections(found, ICO).remarks
    write_detections(path, found, ICO)
    read = read_detections(path, ICO, target_path=Path("ico.target.json"))
    assert line in observations_from_detections(read, ICO).remarks
    path.with_suffix(".records.json").unlink()
    read = read_detections(path, ICO, target_path=Path("ico.target.json"))
    assert line not in observations_from_detections(read, ICO).remarks
