"""The command `calib undistort`: any photos in, the same photos without distortion out, and a camera file that fits."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.app.undistort import undistort_photos
from calib.cameras.camera import Camera, camera_to_json, load_camera
from calib.cameras.undistortion import change_of, pinhole_of
from calib.cameras.undistortion import undistort as undistort_pixels
from calib.images.photo import read_colour
from designer.base.answer import StoppedError, Summary
from designer.base.errors import InputError

CAMERA = Camera("opencv", np.array([95.0, 95.0, 79.5, 59.5, -0.3, 0.1, 0.001, 0.0, 0.0]), (160, 120))
BESIDE = {"camera.json", "undistorted.json", "page.json", "index.html"}
"""What lies with the photos."""
KINDS: tuple[type[np.generic], ...] = (np.uint8, np.uint16)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with a camera file and a grey photo."""
    monkeypatch.chdir(tmp_path)
    Path("camera.json").write_text(camera_to_json(CAMERA))
    photo(Path("photos/a.png"))
    return tmp_path


def photo(path: Path, channels: int = 1, kind: type[np.generic] = np.uint8, size: tuple[int, int] = (160, 120)) -> None:
    """A photo of random blotches."""
    path.parent.mkdir(parents=True, exist_ok=True)
    noise = np.random.default_rng(1).random((size[1], size[0], channels))
    top = np.iinfo(kind).max  # type: ignore[type-var]
    cv2.imwrite(str(path), (cv2.GaussianBlur(noise, (0, 0), 4).reshape(noise.shape) * top).astype(kind))


def run(*photos: str, out: str = "out", **options: object) -> Summary:
    """The command, whose options are given as a shell gives them."""
    texts = {name: value if isinstance(value, str) else str(value) for name, value in options.items()}
    answer: Summary = undistort_photos.as_command()(camera="camera.json", photos=photos, out=Path(out), **texts)
    return answer


@pytest.mark.parametrize(
    ("suffix", "channels", "kind"),
    [
        *((suffix, channels, kind) for suffix in (".png", ".tif") for channels in (1, 3, 4) for kind in KINDS),
        *((suffix, channels, KINDS[0]) for suffix in (".bmp", ".jpg") for channels in (1, 3)),
        *((suffix, channels, kind) for suffix, channels in ((".pgm", 1), (".ppm", 3)) for kind in KINDS),
    ],
)
def test_depth_and_channels_stay(folder: Path, suffix: str, channels: int, kind: type[np.generic]) -> None:
    """Grey, colour and transparency of 8 or 16 bits come out as they went in, and are what the function makes."""
    path = Path(f"in/p{suffix}")
    photo(path, channels, kind)
    run("in")
    made = cv2.imread("out/p.undistorted.png", cv2.IMREAD_UNCHANGED)
    assert made is not None
    before = read_colour(path).pixels
    assert before.dtype == made.dtype == kind
    assert made.shape == before.shape == ((120, 160) if channels == 1 else (120, 160, channels))
    assert np.array_equal(made, undistort_pixels(before, CAMERA, pinhole_of(CAMERA)).pixels)


def test_the_new_camera_belongs_to_the_new_photos(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The folder has a pinhole camera file with the focal length that was asked for, and the summary says so."""
    run("photos", focal_px=80.0)
    made = load_camera(Path("out/camera.json"))
    assert made.model == "pinhole"
    assert made.params.tolist() == [80.0, 80.0, 79.5, 59.5]
    said = capsys.readouterr().out
    assert said.startswith("undistorted: 1 photo as a pinhole of 80.0000 px focal length would have taken it")
    assert "% of the pixels are black" in said
    run("photos", alpha=0)
    assert "no pixel is black" in capsys.readouterr().out
    assert load_camera(Path("out/camera.json")).params[0] == pytest.approx(pinhole_of(CAMERA, alpha=0).params[0])


def test_pictures_by_angles_and_to_the_side_say_what_they_are(folder: Path) -> None:
    """The new camera's file, equation and direction are in the answer; other photos of it are not mixed in."""
    said = run("photos", to="cylinder").answer
    made = load_camera(Path("out/camera.json"))
    assert made.model == "cylinder"
    assert said["equation"] == "u = fx atan2(X, Z) + cx, v = fy Y / sqrt(X^2 + Z^2) + cy"
    picture = cv2.imread("out/a.undistorted.png", cv2.IMREAD_UNCHANGED)
    assert picture is not None
    assert picture.shape[::-1] == made.image_size
    aside = run("photos", out="side", field_rad="50deg", yaw_rad="20deg").answer
    assert np.array(aside["cam_from_new"])[:, 2] == pytest.approx([np.sin(np.radians(20)), 0, np.cos(np.radians(20))])
    photo(Path("photos/b.png"))
    with pytest.raises(InputError, match="of another camera or direction, and photos of it are in the folder"):
        run("photos/b.png", out="side", field_rad="50deg", yaw_rad="25deg")
    run("photos/b.png", out="side", field_rad="50deg", yaw_rad="20deg")


def test_a_camera_that_sees_nothing_makes_no_black_photos(folder: Path) -> None:
    """A lens that folds over at once knows no light: one line that says so, and no files."""
    nothing = Camera("opencv", np.array([95.0, 95.0, -5e4, 59.5, -0.3, 0.0, 0.0, 0.0, 0.0]), (160, 120))
    Path("camera.json").write_text(camera_to_json(nothing))
    with pytest.raises(InputError, match=r"camera\.json: by these numbers 0\.0 % of the image see"):
        run("photos")
    assert not Path("out").exists()


def test_another_camera_is_not_overwritten(folder: Path) -> None:
    """The calibrated camera's own folder is refused as output."""
    before = Path("camera.json").read_bytes()
    with pytest.raises(InputError, match=r"camera\.json: exists and is no camera of undistorted photos"):
        run("photos", out=".")
    assert Path("camera.json").read_bytes() == before


def test_results_are_not_undistorted_again(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A second run over a folder that holds the results takes the photos only."""
    run("photos", out="photos")
    capsys.readouterr()
    Path("photos/earlier.undistorted.png").write_bytes(Path("photos/a.undistorted.png").read_bytes())
    run("photos/*.png", out="photos")
    said = capsys.readouterr().out
    assert "Of an earlier run: 1 more undistorted photos are in this folder" in said
    assert "Left out: 2 undistorted photos of an earlier run" in said
    assert "1 photo as a pinhole" in said
    assert {path.name for path in Path("photos").iterdir()} == {
        "a.png",
        "a.undistorted.png",
        "earlier.undistorted.png",
        *BESIDE,
    }


def test_names_stay_apart(folder: Path) -> None:
    """Photos of one name in different folders or formats, and very long names, get a file each."""
    for place in ("x/1.png", "y/1.png", "y/2.png", "y/2.bmp", f"y/{'long' * 60}.png"):
        photo(Path(place))
    run("x", "y/1.png", "y/2.png", "y/2.bmp")
    assert {path.name for path in Path("out").iterdir()} == BESIDE | {
        "2.bmp.undistorted.png", "2.png.undistorted.png", "x_1.undistorted.png", "y_1.undistorted.png",
    }  # fmt: skip
    run("y", out="long")
    assert len({path.name for path in Path("long").iterdir()} - BESIDE) == 4


def test_a_stopped_run_keeps_what_is_whole(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Interrupted: the finished photos and their camera are there and named, and nothing is half-made."""
    photo(Path("photos/b.png"))
    original = undistort_pixels

    def stop(*arguments: object, **options: object) -> object:
        if Path("out").exists():
            raise KeyboardInterrupt
        return original(*arguments, **options)  # type: ignore[arg-type]

    monkeypatch.setattr("calib.cameras.undistortion.undistort", stop)
    with pytest.raises(StoppedError, match=r"stopped; finished and kept: out") as end:
        run("photos")
    assert end.value.summary.wrote == (Path("out/a.undistorted.png"), Path("out/camera.json"))
    assert sorted(path.name for path in Path("out").iterdir()) == ["a.undistorted.png", "camera.json"]


@pytest.mark.parametrize(("zoom", "kept", "shift_px"), [(1.0, 1.0, 0.0), (0.5, 1.0, 199.875), (2.0, 0.25, 199.9)])
def test_what_undistortion_cuts_off(zoom: float, kept: float, shift_px: float) -> None:
    """Between pinholes: the share is the inverse square of the zoom, and a corner moves by the zoom less one."""
    plain = Camera("pinhole", np.array([900.0, 900.0, 319.5, 239.5]), (640, 480))
    wider = Camera("pinhole", plain.params * np.array([zoom, zoom, 1, 1]), plain.image_size)
    change = change_of(plain, wider)
    assert change.share_kept == pytest.approx(kept, abs=0.02)
    assert change.shift_px == pytest.approx(shift_px, abs=8)


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        ({"alpha": 0.5, "focal_px": 90.0}, "give one of them"),
        ({"field_rad": "175deg"}, "a pinhole shows less than 180 degrees"),
        ({"field_rad": "90deg", "focal_px": 90.0}, "--focal-px and --field both set"),
        ({"alpha": 0.0, "yaw_rad": "10deg"}, "--alpha 0: is for a pinhole that looks along the axis"),
        ({"to": "cylinder", "focal_px": 1e6}, "is too large or empty; give --focal-px or --field"),
        ({"yaw_rad": "180deg"}, "all of the undistorted photo would be black"),
    ],
)
def test_bad_options_are_refused(folder: Path, options: dict[str, object], rule: str) -> None:
    """Focal lengths that are none are one line."""
    with pytest.raises(InputError, match=rule):
        run("photos", **options)
