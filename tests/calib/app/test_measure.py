"""`calib measure`, run as a user runs it, and the words, numbers and files it leaves."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.app.measure import measure as measure_from_python
from calib.cameras.camera import Camera
from calib.core.types import Observations, keep_sightings
from calib.draw import measured_picture
from calib.measure_target.cross_validation import cross_validate, laid_over
from calib.measure_target.deviations import bed_axes, next_skew_rad, whole_print
from calib.measure_target.earlier_lens import EARLIER_LENS
from calib.measure_target.lengths import CALIPER_SIGMA_MM, CaliperLength, asked_length, length_in
from calib.measure_target.solve import measure as measure_print
from calib.measure_target.unknowns import AsBuiltOptions
from calib.observe.dataset import write_detections
from calib.observe.photos import PhotoFile, PhotoResult, Search
from calib.observe.search import PhotoSearch
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.errors import InputError
from designer.kinds.sizing import size_printing
from designer.make.bed import bed_from_target
from designer.spec.kind import KINDS
from designer.spec.options import AskedPrinting
from designer.target import TargetGeometry, load_target, target_to_json
from designer.tolerance.model import ErrorModel, displaced
from tests.support.as_built_scenes import RIGID, photos, plate, printed, random_shape, solid
from tests.support.command_line import BLOCKS, LENIENT, PICTURE, Answer, calib, detections_of, files_in, rows_of_csv
from tests.support.designs import small

DRAW = "calib.draw.measured_picture.picture"
DRAWN = measured_picture.picture
MEASURED = ("measured.target.json", "measured.as_built.json", "measured.as_built.csv", "measured.as_built.png")
INPUTS = {"ico.target.json", "seen.csv", "seen.records.json"}
PLAIN = ("ico.target.json", "seen.csv", "-o", "measured.target.json", "--model", "opencv", "--held-out", "0")


@cache
def print_() -> TargetGeometry:
    """An icosahedron that came out of a printer."""
    return printed(solid(), random_shape(solid(), np.random.default_rng(3), ring_mm=(0.05, 0.02)))


@cache
def seen() -> Observations:
    """Photos of it."""
    return photos(print_(), np.random.default_rng(4), 16)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with a target and detections; pictures are not drawn, which takes long."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(DRAW, lambda *_: PICTURE)
    Path("ico.target.json").write_text(target_to_json(solid()))
    write_seen(seen(), "seen.csv")
    return tmp_path


def write_seen(shown: Observations, name: str, target: TargetGeometry | None = None) -> None:
    """Detections with the nominal target."""
    target = target or solid()
    write_detections(Path(name), detections_of(shown, target), target)


def command(*arguments: object) -> Answer:
    """Run `calib measure`."""
    return calib("measure", *arguments)


def largest_distance_mm(one: TargetGeometry, other: TargetGeometry) -> float:
    """Between the rings of two targets, a similarity aside."""
    rings = np.arange(one.ring_count)
    laid = laid_over(one, other, rings)
    return float(np.linalg.norm(laid.center_mm - other.center_mm, axis=1).max())


def test_a_measurement_is_not_saved_over_its_target() -> None:
    """Deviations would be told against themselves."""
    with pytest.raises(InputError, match="is the target it is measured against"):
        measure_from_python("ico.target.json", "seen.csv", rings="rigid", held_out=0).save("ico.target.json")


def test_the_model_is_that_of_the_run_or_as_run_chooses() -> None:
    """Of a run's detections the run's best model; else the one with the smaller residuals; both are said."""
    calib("solve", "seen.csv", "--target", "ico.target.json", "--model", "luhmann", "-o", ".", *LENIENT)
    measured = measure_from_python("ico.target.json", "seen.csv", rings="rigid", held_out=0)
    assert [one.model for one in measured.found.cameras] == ["luhmann"]
    assert any("luhmann, the model of the run's best camera" in line for line in measured.remarks)
    Path("verdict.json").unlink()
    measured = measure_from_python("ico.target.json", "seen.csv", rings="rigid", held_out=0)
    residuals_px = {
        model: np.hypot(*solve(seen(), model, SolveOptions()).residual_px.T).mean() for model in ("luhmann", "opencv")
    }
    assert measured.found.cameras[0].model == min(residuals_px, key=residuals_px.__getitem__)
    assert any("has the smaller residuals" in line for line in measured.remarks)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"lengths": CaliperLength("edge", float("nan"), 0.02)},
            "nan mm ± 0.02 mm: both must be numbers of more than 0",
        ),
        ({"lengths": [CaliperLength("edge", 100.0, float("inf"))]}, "inf mm: both must be numbers of more than 0"),
        ({"lengths": [100.0]}, "each a text or CaliperLength"),
        ({"shrink_compensation_percent": float("nan")}, "from -50% to 50%"),
        ({"bed_turn_rad": float("nan")}, "from -360deg to 360deg"),
        ({"observed": ()}, "no detections"),
        ({"observed": (one for one in ("seen.csv", 5))}, "5: give files, observations"),
        ({"observed": ["seen.csv", detections_of(seen(), solid())[0]]}, "detections beside files"),
        ({"observed": ["seen.csv", seen()], "one_camera": True}, "observations are of a camera each"),
    ],
)
def test_values_that_are_none_are_refused(arguments: dict[str, Any], message: str) -> None:
    """From Python as from a shell: the value, the rule and the remedy, before any work is done."""
    with pytest.raises(InputError, match=message):
        measure_from_python(**{"target": "ico.target.json", "observed": "seen.csv", **arguments})


@pytest.mark.filterwarnings("error")  # of a picture whose parts have no room
def test_a_print_is_measured_and_all_is_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """The measured target is the print to some micrometres, as large as the caliper says; its report is beside it."""
    monkeypatch.setattr(DRAW, DRAWN)
    length = length_in(print_(), "face-to-face")
    answer = command(*PLAIN, "--length", f"face-to-face:{length}mm+-0.01mm")
    assert answer.code == 0, answer
    found = load_target(Path("measured.target.json"))
    assert found.source == "measured"
    assert found.face_covariance is not None
    assert largest_distance_mm(print_(), found) < 0.03 < largest_distance_mm(print_(), solid())
    assert length_in(found, "face-to-face") == pytest.approx(length, abs=1e-6)
    assert files_in(Path()) == INPUTS | set(MEASURED) | BLOCKS
    report = json.loads(Path("measured.as_built.json").read_text())
    assert report["measured_geometry_id"] == found.geometry_id
    assert report["nominal_geometry_id"] == solid().geometry_id
    assert report["size_is_known"] is True
    assert answer.out.startswith("measured, not judged: ")
    assert "leave --held-out 0 away" in answer.out
    assert "calib solve" not in answer.out
    assert Path("measured.as_built.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_the_table_holds_each_number_with_its_deviation() -> None:
    """Six numbers a face, three a seen ring; a face that no photo shows is marked, and said."""
    without = keep_sightings(seen(), solid().ring_face[seen().point] != 7)
    write_seen(without, "seen.csv")
    answer = command(*PLAIN)
    assert "no view shows face 7" in answer.out
    rows = rows_of_csv(Path("measured.as_built.csv"))
    faces = [row for row in rows if row["part"] == "face"]
    assert [row["quantity"] for row in faces[:6]] == ["shift x", "shift y", "shift z", "tilt x", "tilt y", "turn z"]
    assert len(faces) == 6 * 20
    assert {row["number"] for row in faces if row["is_known"] == "0"} == {"7"}
    rings = [row for row in rows if row["part"] == "ring"]
    assert len(rings) == 3 * len(np.unique(without.point))
    assert "7" not in {row["face"] for row in rings}
    report = json.loads(Path("measured.as_built.json").read_text())
    motion = np.array(report["face_motion"])
    assert float(faces[2]["value"]) == pytest.approx(motion[0, 5])
    assert float(faces[3]["value"]) == pytest.approx(motion[0, 0])
    assert report["face_verdict"][7] == "not known"
    assert not any(row["quantity"] == "size" for row in rows)


def test_gain_is_judged_on_photos_held_out() -> None:
    """With the measured target the errors against the truth are as those with a perfect print, the nominal's larger."""
    found = measure_print([photos(print_(), np.random.default_rng(4), 40)], solid(), "opencv")
    held = cross_validate(found, "opencv", AsBuiltOptions(), 4, truth=print_())
    perfect = measure_print([photos(solid(), np.random.default_rng(4), 40)], solid(), "opencv", RIGID)
    best = cross_validate(perfect, "opencv", RIGID, 4, truth=solid())
    assert [gain.metric for gain in held.gains] == ["reprojection", "intersection", "reconstruction"]
    assert [gain.metric for gain in held.against_truth] == ["intersection", "reconstruction"]
    for gain, reference in zip(held.against_truth, best.against_truth, strict=True):
        assert gain.factor > 5
        assert gain.measured < 2 * reference.nominal
    assert held.gains[0].count == len(found.observations[0].view)


def test_what_was_measured_from_a_photo_is_not_judged_by_it() -> None:
    """A sighting that is far off in a held-out photo changes nothing of the measurement it is judged by."""
    found = measure_print([seen()], solid(), "opencv", RIGID)
    in_sample = float(np.sqrt((found.residual_px[0] ** 2).sum(axis=1).mean()))
    held = cross_validate(found, "opencv", RIGID, 2)
    assert held.gains[0].measured > in_sample


def test_two_files_of_one_camera_are_one() -> None:
    """Split detections measure the same, and their photos of one name are told apart."""
    assert command(*PLAIN, "--rings", "rigid").code == 0
    whole = load_target(Path("measured.target.json"))
    for name, part in (("a.csv", seen().view < 8), ("b.csv", seen().view >= 8)):
        some = keep_sightings(seen(), part)
        first = int(some.view[0])
        names = tuple(f"photo {k}" for k in range(8))
        write_seen(replace(some, view=some.view - first, view_names=names), name)
    answer = command("ico.target.json", "a.csv", "b.csv", *PLAIN[2:], "--one-camera", "--rings", "rigid")
    assert answer.code == 0, answer
    assert "16, of 1 camera (opencv); " in answer.out
    assert largest_distance_mm(load_target(Path("measured.target.json")), whole) < 1e-3  # written centres are rounded
    answer = command("ico.target.json", "a.csv", "b.csv", *PLAIN[2:], "--rings", "rigid")
    assert "16, of 2 cameras (opencv); " in answer.out


def test_axes_are_those_of_the_plate_that_the_designer_writes() -> None:
    """Of all kinds of targets, the quarter turn of an icosahedron included."""
    for target in (solid(), plate(), *(small(name).target for name in KINDS)):
        printing = size_printing(AskedPrinting(), target)
        np.testing.assert_allclose(bed_axes(target), bed_from_target(target, printing)[:3, :3], atol=1e-12)


@pytest.mark.parametrize("kind", ["ico", "board"])
def test_stretch_and_skew_are_told_along_the_bed(kind: str) -> None:
    """Axes and angles of a distorted print, with their signs; of a board those in its plane."""
    target = solid() if kind == "ico" else plate()
    lay = np.eye(4)
    lay[:3, :3] = bed_axes(target)
    values = {"axis_scale": np.array([[2e-3, -1e-3, 5e-4]]), "skew": np.array([[2e-3, -1e-3, 3e-3]])}
    came_out = displaced(target, values, model=ErrorModel("printer", "", ()), bed_from_target=lay)
    shown = photos(came_out, np.random.default_rng(1), 12, noise_px=1e-3, half_angle_deg=150 if kind == "ico" else 50)
    whole = whole_print(measure_print([shown], target, "opencv", replace(RIGID, bow=False)))
    told = next_skew_rad(whole)
    assert told == pytest.approx((2e-3, -1e-3, 3e-3) if kind == "ico" else (2e-3, 0.0, 0.0), abs=2e-5)
    axes, skews = ({name: one.value for name, one in pairs.items()} for pairs in (whole.axes, whole.skews_rad))
    mean = {"ico": 5e-4, "board": 5e-4}[kind]
    expected = {"x": 2e-3 - mean, "y": -1e-3 - mean, "z": 5e-4 - mean}
    assert axes == pytest.approx({name: expected[name] for name in axes}, abs=2e-5)
    assert skews == pytest.approx({name: {"xy": 2e-3, "xz": -1e-3, "yz": 3e-3}[name] for name in skews}, abs=2e-5)
    assert list(axes) == (["x", "y", "z"] if kind == "ico" else ["x", "y"])
    assert whole.size is None


# Lengths.


@pytest.mark.parametrize(
    ("text", "value_mm", "sigma_mm"),
    [
        ("face-to-face:151.20mm±0.02mm", 151.2, 0.02),
        ("Face-To-Face : 151.2 +- 0.03", 151.2, 0.03),
        ("edge:100.1+/-50um", 100.1e-3, 50e-3),
        ("edge:3.94in+-0.001", 100.076, 0.0254),
        ("edge:100.1mm+-50um", 100.1, 0.05),
        ("ring 0  to ring 20:60", 60.0, CALIPER_SIGMA_MM),
    ],
)
def test_lengths_as_they_are_typed(text: str, value_mm: float, sigma_mm: float) -> None:
    """A unit holds for the number without one; without any it is mm; without a sigma it is a caliper's, and said."""
    target = solid()
    if value_mm < 1:  # micrometres of the sigma hold for the value too, which is then no edge
        with pytest.raises(InputError, match="check what was measured, and the unit"):
            asked_length("--length", text, target)
        return
    if text.startswith("ring"):
        text = text.replace("60", f"{length_in(target, 'ring 0 to ring 20')}")
        value_mm = length_in(target, "ring 0 to ring 20")
    asked = asked_length("--length", text, target)
    assert asked.value_mm == pytest.approx(value_mm, abs=1e-9)
    assert asked.sigma_mm == pytest.approx(sigma_mm)
    assert asked.is_usual_sigma == text.startswith("ring")
    assert asked_length("--length", asked.text, target).value_mm == asked.value_mm


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("face-to-fase:151mm", "did you mean 'face-to-face'"),
        ("rin 3 to ring 4:20mm", "did you mean 'ring N to ring N'"),
        ("diagonal:20mm", '"face-to-face", "edge"'),
        ("face-to-face", "NAME:VALUE"),
        ("face-to-face:151kg", "unknown unit of length 'kg'"),
        ("face-to-face:151mm+-0.1deg", "its sigma: unknown unit"),
        ("face-to-face:151mm+--0.1mm", "151 mm ± -0.1 mm: both must be numbers of more than 0"),
        ("face-to-face:151mm+-0", "151 mm ± 0 mm: both must be numbers of more than 0"),
        ("face-to-face:-151mm", "-151 mm ± 0.02 mm: both must be numbers of more than 0"),
        ("face-to-face:nan", "not a finite number"),
        ("face-to-face:", "expected a length"),
        ("face-to-face:151+-1+-1", "more than one sigma"),
        ("face-to-face:15.1mm", "the target has 151.15 mm there"),
        ("face 0 to face 1:151mm", "not opposite"),
        ("ring 0 to ring 99999:20mm", "from 0 to 299"),
        ("x" * 5000 + ":1", "write NAME:VALUE"),
    ],
)
def test_lengths_that_are_none(text: str, message: str) -> None:
    """Each is one line with the value, the rule and the remedy, for both options."""
    for option, rest in (("--length", ["seen.csv"]), ("--measured-length", [])):
        answer = command("ico.target.json", *rest, option, text, "-o", "measured.target.json")
        assert answer.code == 2
        assert message in answer.err
        assert answer.err.count("\n") == 1
        assert len(answer.err) < 300
    assert files_in(Path()) == INPUTS


# Bad input.


def refused(*arguments: object) -> str:
    """Run a command that must end in one line and leave no file."""
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    answer = command(*arguments)
    assert answer.code == 2, answer
    assert answer.err.count("\n") == 1
    assert before == {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    return answer.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("ico.target.json", "-o", "m.target.json"), "give the detections.csv"),
        (("ico.target.json", "seen.csv", "-o", "m.json"), "call it m.target.json"),
        (("ico.target.json", "seen.csv", "-o", ".target.json"), "call it measured.target.json"),
        (("ico.target.json", "seen.csv", "-o", "ico.target.json"), "is the target it is measured against"),
        (("ico.target.json", "seen.csv", "-o", "./ico.target.json"), "is the target it is measured against"),
        (("ico.target.json", "seen.csv", "seen.csv", "-o", "m.target.json"), "given twice"),
        (("ico.target.json", "ico.target.json", "-o", "m.target.json"), "ico.target.json"),
        (("ico.target.json", "seen.csv", "-o", "m.target.json", "--model", "virtual"), "cannot measure them"),
        (("ico.target.json", "seen.csv", "-o", "m.target.json", "--made", "exact"), "nothing to measure then"),
        (("ico.target.json", "seen.csv", "-o", "m.target.json", "--fix", "k9"), "no such parameter"),
        (("ico.target.json", "seen.csv", "-o", "m.target.json", "--held-out", "1"), "2 to 16 parts"),
        (("ico.target.json", "seen.csv", "-o", "m.target.json", "--held-out", "17"), "2 to 16 parts"),
        (("ico.target.json", "seen.csv", "-o", "m.target.json", "--measured-length", "edge:100mm"), "with --length"),
    ],
)
def test_bad_input_is_one_line(arguments: tuple[str, ...], message: str) -> None:
    """The value, the rule and the remedy; nothing is written, nothing overwritten."""
    assert message in refused(*arguments)


def test_only_designed_targets_are_measured_against() -> None:
    """Deviations of a measured or perturbed target would be told against nothing."""
    for source in ("measured", "perturbed"):
        Path("other.target.json").write_text(target_to_json(replace(solid(), source=source)))
        assert f"a {source} target" in refused("other.target.json", "seen.csv", "-o", "m.target.json")


def test_detections_of_another_target_are_refused() -> None:
    """Both files are named; so is a truth of another target."""
    Path("board.target.json").write_text(target_to_json(plate()))
    message = refused("board.target.json", "seen.csv", "-o", "m.target.json")
    assert "seen.csv" in message
    assert "board.target.json" in message
    assert "--truth board" in refused(*PLAIN, "--truth", "board.target.json")


def test_photos_are_searched_again_with_what_was_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """The lens and the target are those measured, and what is found then is measured against the design."""
    better, asked = seen(), list[tuple[TargetGeometry, Camera]]()
    astray = replace(better, center_px=better.center_px + 1e-3 * (better.center_px - better.center_px.mean(axis=0)))
    write_seen(astray, "seen.csv")
    for name in (*better.view_names, "another.png"):
        Path(name).touch()

    def once(search: PhotoSearch, camera: Camera) -> Search:
        asked.append((search.target, camera))
        assert [path.name for path in search.photos.paths] == list(better.view_names)
        found = [replace(one, geometry_id="0" * 8) for one in detections_of(better, search.target)]
        results = tuple(PhotoResult(PhotoFile(Path(one.image), one.image), one, "") for one in found)
        return Search(search.target, results, (), 0, 0.0)

    monkeypatch.setattr(PhotoSearch, "once", once)
    paths = [*better.view_names, "another.png"]
    way: dict[str, Any] = {"model": "opencv", "held_out": 0}
    plain = measure_from_python("ico.target.json", "seen.csv", **way)
    again = measure_from_python("ico.target.json", "seen.csv", photos=paths, **way)
    write_seen(better, "seen.csv")
    wanted = measure_from_python("ico.target.json", "seen.csv", **way)
    ((target, camera),) = asked
    assert np.array_equal(target.center_mm, plain.target.center_mm)
    assert np.array_equal(camera.params, plain.found.cameras[0].params)
    focal_px = [one.found.cameras[0].params[0] for one in (again, plain)]
    assert focal_px[0] == pytest.approx(wanted.found.cameras[0].params[0], abs=1e-3)  # digits of the file
    assert abs(focal_px[1] - focal_px[0]) > 1.0
    assert EARLIER_LENS in plain.remarks  # a camera of the print as designed is another one
    assert EARLIER_LENS not in again.remarks


def test_photos_that_cannot_be_searched_again_are_refused() -> None:
    """Those of other detections, of several cameras, or beside observations that are of no photos."""
    Path("another.png").touch()
    with pytest.raises(InputError, match=r"--photos: .* is not among them"):
        measure_from_python("ico.target.json", "seen.csv", photos="another.png")
    write_seen(seen(), "second.csv")
    for observed in (["seen.csv", "second.csv"], seen()):
        with pytest.raises(InputError, match=r"--photos: .*one camera"):
            measure_from_python("ico.target.json", observed, photos="another.png")
