"""The public functions: what a command does, in one call that returns a value and prints nothing."""

import inspect
from collections.abc import Callable
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

import calib
import designer
from calib.observe.calibration_file import Provenance, write_calibration
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from tests.support.calibrations import board, camera, example

BOARD = board(7, 5, "12mm")
CAMERA = camera("opencv", (160, 120), 95.0)
PAIR = calib.Rig(("l", "r"), (CAMERA,) * 2, np.stack([np.eye(4), np.eye(4) + 9 * np.eye(4, k=3)]))


@pytest.fixture(autouse=True)
def silent(capfd: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> "object":
    """A folder to work in; nothing may be printed."""
    monkeypatch.chdir(tmp_path)
    yield
    assert capfd.readouterr() == ("", "")


def test_evaluate_measures_a_stored_camera(tmp_path: Path) -> None:
    """Errors on the photos and on photos held out come as values, and are written when they are saved."""
    seen = example(BOARD, np.random.default_rng(1), views=6, noise_px=0.1).observations
    options = SolveOptions(fixed=(("k3", 0.0),))
    write_calibration(Path("cal"), solve(seen, "opencv", options), Provenance("test", options=options))
    before = set(tmp_path.rglob("*"))
    found = calib.evaluate("cal", held_out=3, figures=False)
    assert found.held_out is found.asked
    assert found.asked.folds == 3
    assert set(tmp_path.rglob("*")) == before
    assert {path.name for path in found.save("out")} >= {"metrics.json", "metrics_views.csv"}
    with pytest.raises(calib.InputError, match="fall into 2 to 6 parts"):
        calib.evaluate("cal", held_out=7)


@pytest.mark.parametrize("shape", [(120, 160), (120, 160, 3)])
def test_undistort_takes_an_array(shape: tuple[int, ...]) -> None:
    """An image comes back as it was, of the pinhole; one of another size or depth is refused."""
    image = np.random.default_rng(1).integers(0, 255, shape, dtype=np.uint8)
    made = calib.undistort(image, CAMERA, focal_px=80.0)
    assert (made.pixels.shape, made.pixels.dtype) == (shape, np.uint8)
    straight = calib.Undistorter(CAMERA, focal_px=80.0)
    assert straight.new_camera.matrix[0, 0] == 80
    assert np.array_equal(straight.undistort(image).pixels, made.pixels)
    with pytest.raises(calib.InputError, match="the image: has 159 x 120 px"):
        straight.undistort(image[:, 1:])
    for use in (straight.undistort, lambda gap: calib.detect(gap, BOARD)):
        with pytest.raises(calib.InputError, match=r"uint8 or uint16|not finite|nan"):
            use(np.full(shape, np.nan, np.float32))


def test_render_gives_a_view_as_an_array_and_a_set_as_files() -> None:
    """A photo is the same as an array and as a file; poses may be given, and bad ones are refused."""
    options = calib.RenderOptions(contrast_to_noise=40)
    photos = calib.render(BOARD, CAMERA, views=2, distance_mm=120.0, options=options, seed=3)
    image = photos.image(1)
    assert (image.shape, image.dtype) == ((120, 160), np.uint8)
    assert [path.name for path in photos.save("photos")][-2:] == ["truth.json", "target.json"]
    assert np.array_equal(cv2.imread("photos/view_0001.png", cv2.IMREAD_UNCHANGED), image)
    assert [path.name for path in photos.files_in("photos")] == ["view_0000.png", "view_0001.png", "truth.json"]
    again = calib.render(BOARD, CAMERA, views=2, distance_mm=120.0, options=options, seed=3, out="photos", jobs=1)
    assert again.done is not None
    assert (again.done.rendered, again.done.kept) == (0, 2)
    one = calib.render(BOARD, CAMERA, poses=photos.cam_from_target[1])
    assert one.cam_from_target.shape == (1, 4, 4)
    with pytest.raises(calib.InputError, match="must be a rigid motion"):
        calib.render(BOARD, CAMERA, poses=2 * np.eye(4))
    with pytest.raises(calib.InputError, match="stay farther away"):
        calib.render(BOARD, CAMERA, distance_mm=10.0)


@pytest.mark.parametrize(
    "options",
    [
        {"distance_mm": np.nan}, {"distance_mm": np.inf}, {"distance_mm": "400mm"}, {"aim_offset_mm": np.nan},
        {"cap_rad": np.nan}, {"views": 2.5}, {"views": True}, {"seed": -1}, {"poses": "none.json"}, {"poses": "x"},
        {"poses": [["a"]]}, {"options": calib.RenderOptions(blur_px=np.nan)}, {"region": "ball"},
        {"options": calib.RenderOptions(glare=np.inf)}, {"options": calib.RenderOptions(clutter=1.5)},  # type: ignore[arg-type]
    ],
)  # fmt: skip
def test_what_is_no_photo_to_render_is_refused(options: dict[str, object]) -> None:
    """Numbers that are none, beyond their limits or of another type end in one line, before any work."""
    with pytest.raises(calib.InputError):
        calib.render(BOARD, CAMERA, **{"distance_mm": 120.0, **options})  # type: ignore[arg-type]


WRONG = {
    calib.run: ("target", "photos", "model", "fix", "share", "focal_px", "loss", "reject_sigma", "made", "truth",
                "criteria", "jobs", "out"),
    calib.solve: ("observed", "target", "model", "fix", "share", "focal_px", "reject_sigma", "made", "truth",
                  "criteria", "out"),
    calib.evaluate: ("calibration", "truth"),
    calib.measure: ("target", "observed", "lengths", "model", "rings", "made", "reject_sigma", "fix", "share",
                    "shrink_compensation_percent", "skew_compensation_rad", "bed_turn_rad"),
    calib.rescale: ("target", "length", "made"),
    calib.bootstrap: ("detections", "truth", "sizes", "samples", "model", "seed", "jobs", "out"),
    calib.tolerance: ("target", "errors", "changes", "views", "distance_mm", "camera", "model", "draws", "require",
                      "by", "seed", "jobs", "out"),
    calib.render: ("target", "camera", "views", "region", "options", "seed", "file_format"),
    calib.undistort: ("image", "camera", "to", "alpha", "focal_px", "field_rad", "yaw_rad", "pitch_rad"),
    calib.convert: ("camera", "to", "model", "without", "out"),
    calib.detect: ("image", "target", "camera"), calib.pose: ("target", "photos", "overlay", "jobs"),
    calib.load_camera: ("name",), calib.load_observations: ("path",), calib.diff: ("a", "b", "radius_px"),
    calib.triangulate: ("rig", "sightings", "noise_px"), calib.budget: ("rig", "distance_mm", "noise_px", "length_mm"),
    calib.plan: ("target", "camera", "within_px", "noise_px", "distance_mm", "made", "hand_eye", "most"),
    calib.coupon: ("photos", "dpi", "target", "lengths"),
    designer.load: ("spec",), designer.load_target: ("path",), designer.design: ("kind",),
}  # fmt: skip


@cache
def valid() -> dict[str, object]:
    """Values that an option takes."""
    seen = example(BOARD, np.random.default_rng(1), views=6).observations
    return {
        "target": BOARD, "photos": "*.png", **dict.fromkeys(("observed", "detections"), seen),
        "errors": "fdm-dual", "camera": CAMERA, "image": np.zeros((120, 160), np.uint8), "to": "ros",
        "length": "edge:1mm", "calibration": "cal", "a": CAMERA, "b": CAMERA, "rig": PAIR,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("call", "option"),
    [(call, option) for call, options in WRONG.items() for option in options],
    ids=[f"{call.__name__}-{option}" for call, options in WRONG.items() for option in options],
)
def test_a_value_of_another_type_is_refused(call: Callable[..., object], option: str) -> None:
    """Whatever an option is given, the answer is a line and no TypeError from within."""
    needed = inspect.signature(call).parameters
    given = {name: value for name, value in valid().items() if name in needed}
    with pytest.raises(calib.InputError) as refused:
        call(**{**given, option: 5j})
    assert "\n" not in str(refused.value)


def test_a_camera_says_what_it_takes() -> None:
    """Its model and the number of its parameters when it is made, the shape of points and pixels when they come."""
    for call, why in (
        (lambda: calib.Camera("periscope", CAMERA.params, (160, 120)), "unknown camera model 'periscope'"),
        (lambda: calib.Camera("pinhole", CAMERA.params, (160, 120)), "9 parameters: model pinhole takes 4: fx_px"),
        (lambda: CAMERA.project([1.0, 2.0]), r"points of shape \(2,\)"),  # type: ignore[arg-type]
        (lambda: CAMERA.rays("here"), "pixels are numbers"),  # type: ignore[arg-type]
        (lambda: CAMERA.save(""), "is no path"),
    ):
        with pytest.raises(calib.InputError, match=why):
            call()


def test_a_picture_is_of_the_photo_that_was_searched() -> None:
    """Detections of another photo would be drawn where nothing is."""
    image = calib.render(BOARD, CAMERA, views=1, distance_mm=120.0).image(0)
    detector = calib.Detector(BOARD)
    found = detector.detect(image, "a.png")
    assert repr(found).startswith(f"<Detections of a.png: {len(found.ring)} features")
    with pytest.raises(calib.InputError, match="another photo"):
        detector.draw(image[:60], found)
    with pytest.raises(calib.InputError, match="must be from 0 to 0"):
        calib.render(BOARD, CAMERA, views=1, distance_mm=120.0).image(1)
