"""The command `calib convert` of a rig."""

import re
import runpy
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.app.inputs import load_camera, load_rig
from calib.cameras.camera import Camera
from calib.cameras.rig import Rig, keep_cameras
from calib.core.se3 import transform
from designer.base.answer import Summary
from designer.base.errors import InputError
from tests.support.foreign_cameras import CAMERAS, MODELS, WIDE_SIZE
from tests.support.foreign_rigs import FISHEYE, ring, stereo


def run(camera: str, *, to: str, out: Path, **options: object) -> Summary:
    """The command, whose options are given as a shell gives them."""
    answer: Summary = calib.convert.as_command()(camera=camera, to=to, out=out, **options)  # type: ignore[attr-defined]
    return answer


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with a pair and a ring."""
    monkeypatch.chdir(tmp_path)
    pair = stereo()
    replace(pair, covariance=np.diag(np.arange(1.0, 31)), delay_s=np.array([0, 0.01])).save("pair.json")
    ring().save("ring.json")
    return tmp_path


def test_what_is_lost_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    """The covariance, the delays, a frame that is no camera's, and names that the tool does not take."""
    run("pair.json", to="kalibr", out=Path("c.yaml"))
    said = capsys.readouterr().out
    assert "Lost: how sure it all is" in said
    assert "Lost: the delays" in said
    assert "frame" not in said
    run("ring.json", to="kalibr", out=Path("c.yaml"))
    said = capsys.readouterr().out
    assert "Lost: the rig's frame (world); the files' is that of camera cam a" in said
    assert "Lost: the cameras' names; they are called cam_a, cam_b, cam_c" in said
    run("ring.json", to="caliscope", out=Path("c.toml"))
    assert "they are called 0, 1, 2" in capsys.readouterr().out
    assert list(tomllib.loads(Path("c.toml").read_text())["cameras"]) == ["0", "1", "2"]


def test_the_rigs_frame_may_be_called_as_a_robot_calls_it() -> None:
    """What the transforms of ROS hang on, and what is read again; a camera's name is taken, one camera has no frame."""
    made = calib.convert("ring.json", "ros", frame="tool0", out="ros")
    assert "--frame-id tool0 --child-frame-id cam_a_link" in made.texts["static_transforms.launch.yaml"]
    assert '<parent link="tool0"/>' in made.texts["rig.urdf"]
    assert load_rig("ros").rig_frame == "tool0"
    np.testing.assert_allclose(load_rig("ros").cam_from_rig, load_rig("ring.json").cam_from_rig, atol=1e-9)
    for frame in ("cam a", "a b", ""):
        with pytest.raises(InputError, match=f"frame '{frame}': must be 1 to 100 letters"):
            calib.convert("ring.json", "ros", frame=frame)
    with pytest.raises(InputError, match="frame: is for rigs, and this is one camera"):
        calib.convert(FISHEYE, "opencv", frame="tool0")


def test_a_lens_that_is_fitted_is_told_with_its_camera(capsys: pytest.CaptureFixture[str]) -> None:
    """Of a double sphere in OpenCV's fisheye the residual is told; what was known of its numbers is lost."""
    wide = Camera("ds", np.array(MODELS["ds"]), WIDE_SIZE)
    rig = Rig(("a", "b"), (wide, FISHEYE), stereo(FISHEYE).cam_from_rig, np.eye(26))
    done = calib.convert(rig, "opencv")
    assert 0.001 < done.rms_px < 0.1
    assert [name for name, _, _ in done.named_fits] == ["a"]
    rig.save("wide.json")
    run("wide.json", to="json", out=Path("again.json"), model="fisheye")
    assert re.search("^a +fitted fisheye over the whole image", capsys.readouterr().out, re.MULTILINE)
    assert load_rig("again.json").covariance is None


def test_a_rig_is_written_with_lenses_of_one_kind_or_refused() -> None:
    """A camera of a pair that the format's lens does not hold well is named, and gets no lens of another kind."""
    barrel = CAMERAS["barrel"]
    held = replace(barrel, params=np.array([*barrel.params[:8], 0.0]))
    rig = Rig(("a", "b"), (held, barrel), stereo(FISHEYE).cam_from_rig)
    with pytest.raises(InputError, match="camera 'b': Kalibr camchain's lens pinhole-radtan, which has no k3, is off"):
        calib.convert(rig, "kalibr")
    done = calib.convert(rig, "kalibr", accept_px=14)
    assert [one.lens.name for one in done.held] == ["pinhole-radtan"] * 2
    assert any("of b: up to 13.7 px" in line for line in done.lost)


def test_poses_turn_with_a_lens_whose_frame_is_turned() -> None:
    """A refit may turn a camera's frame: the pose turns along, so that points stay in their pixels."""
    from calib.cameras.refit import refit
    from calib.core.se3 import exp_rotation

    rig = ring((CAMERAS["pinhole"],) * 2)
    plain = calib.convert(rig, "json")
    turn = exp_rotation(np.array([0.01, 0.02, -0.01]))
    fit = replace(refit(rig.cameras[0], "opencv"), new_from_old=turn)
    turned = replace(plain, held=(replace(plain.held[0], camera=fit.camera, refit=fit), plain.held[1])).rig
    point = np.array([[10.0, 20, 30]])
    expected = transform(rig.cam_from_rig[0], point) @ turn.T
    np.testing.assert_allclose(transform(turned.cam_from_rig[0], point), expected, atol=1e-9)
    assert (turned.cam_from_rig[1] == rig.cam_from_rig[1]).all()


def test_some_cameras_in_an_order() -> None:
    """A pair is named out of a ring; too many for the format, or none of the rig, are answered with what to say."""
    with pytest.raises(
        InputError, match=r"ring\.json: OpenCV stereo YAML holds 2 cameras, the rig has 3; name them, as in"
    ):
        run("ring.json", to="opencv", out=Path("s.yaml"))
    run("ring.json", to="opencv", out=Path("s.yaml"), cameras=["cam c", "cam a"])
    found = load_rig("s.yaml")
    assert found.names == ("cam_c", "cam_a")
    distance = np.linalg.norm(ring().center_mm[2] - ring().center_mm[0])
    assert np.linalg.norm(found.center_mm[1]) == pytest.approx(distance)
    with pytest.raises(InputError, match="camera 'cam d': not in the rig; did you mean"):
        run("ring.json", to="opencv", out=Path("s.yaml"), cameras=["cam d"])


def test_units_are_told_and_asked(capsys: pytest.CaptureFixture[str]) -> None:
    """A file that does not say its unit is taken as usual, which is told; implausible lengths are named."""
    run("pair.json", to="opencv", out=Path("s.yaml"), unit="m")
    text = "".join(line for line in Path("s.yaml").read_text().splitlines(keepends=True) if "length_unit" not in line)
    Path("s.yaml").write_text(text)
    capsys.readouterr()
    run("s.yaml", to="json", out=Path("s.json"))
    said = capsys.readouterr().out
    assert "lengths are taken as millimetres, as OpenCV stereo YAML usually has it; another with --from-unit" in said
    assert "the cameras are 0.12 mm apart at most" in said
    run("s.yaml", to="json", out=Path("s.json"), source_unit="m")
    assert "apart at most" not in capsys.readouterr().out
    np.testing.assert_allclose(load_rig("s.json").cam_from_rig, stereo().cam_from_rig, atol=1e-9)
    for options, rule in (
        ({"unit": "inch"}, "unit 'inch'; there are m, cm, mm"),
        ({"to": "kalibr", "unit": "mm"}, "--unit mm: Kalibr camchain is in metres; leave out --unit"),
        ({"source_unit": "m"}, "--from-unit m: rig.json is in millimetres"),
    ):
        with pytest.raises(InputError, match=rule):
            run("pair.json", **{"to": "opencv", "out": Path("x"), **options})  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"unit: is for rigs"):
        calib.convert(CAMERAS["barrel"], "opencv", unit="m")


def test_a_file_that_says_another_unit_than_asked_is_refused() -> None:
    """One of the two is wrong."""
    run("pair.json", to="opencv", out=Path("s.yaml"), unit="m")
    with pytest.raises(InputError, match=r"s\.yaml: says that its lengths are in 'm'; leave out --from-unit mm"):
        load_rig("s.yaml", unit="mm")
    Path("s.yaml").write_text(Path("s.yaml").read_text().replace("length_unit: m", "length_unit: furlong"))
    with pytest.raises(InputError, match=r"s\.yaml: length_unit 'furlong': must be one of m, cm, mm"):
        load_rig("s.yaml")


def test_one_camera_of_a_rig_is_a_camera() -> None:
    """`FILE#NAME` of a rig's file, wherever a camera is asked for; without a name the names are told."""
    run("ring.json", to="anipose", out=Path("a.toml"))
    Path("solved").mkdir()
    ring().save("solved/rig.json")
    for name in ("ring.json#cam b", "a.toml#cam_b", "solved#cam b", "solved/rig.json#cam b"):
        np.testing.assert_array_equal(load_camera(name).params, ring().cameras[1].params)
    with pytest.raises(InputError, match=r"ring.json: holds 3 cameras \(cam a, cam b, cam c\); name one"):
        load_camera("ring.json")
    run("ring.json#cam b", to="opencv", out=Path("b.yaml"))
    assert load_camera("b.yaml").model == "fisheye"


def test_a_rig_of_one_is_its_camera_where_a_file_holds_pairs() -> None:
    """And of several, one is named alone."""
    keep_cameras(stereo(), [0]).save("one.json")
    run("one.json", to="opencv", out=Path("one.yaml"))
    np.testing.assert_array_equal(load_camera("one.yaml").params, stereo().cameras[0].params)
    with pytest.raises(InputError, match="name it alone, as in FILE#left"):
        run("pair.json", to="opencv", out=Path("left.yaml"), cameras=["left"])


@pytest.mark.parametrize("source", ["pair.json", "pair.json#left"])
def test_the_line_that_opens_a_file_in_opencv_does(source: str, capsys: pytest.CaptureFixture[str]) -> None:
    """What is told to type in Python runs: OpenCV forgets a file of which only a node is kept."""
    run(source, to="opencv", out=Path("s.yaml"))
    line = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("open "))
    Path("typed.py").write_text("import cv2\n" + line.partition("in Python: ")[2].partition("; where")[0] + "\n")
    assert set(runpy.run_path("typed.py")) >= {"cv2", "file"}


def test_files_of_a_folder_that_are_read_are_not_written(folder: Path) -> None:
    """A folder of models holds them."""
    run("pair.json", to="mrcal", out=Path("models"))
    with pytest.raises(InputError, match=r"left.cameramodel: is a file to read"):
        run("models", to="mrcal", out=Path("models"))
    Path("file").write_text("")
    with pytest.raises(InputError, match="file: is a file, not a folder"):
        run("pair.json", to="mrcal", out=Path("file"))


def test_one_camera_is_a_rig_of_one_in_files(tmp_path: Path) -> None:
    """A camera's file, its folder, and a camera of a rig are read as rigs; a rig of one, or its folder, as a camera."""
    alone = stereo().cameras[0]
    (tmp_path / "run").mkdir()
    alone.save(tmp_path / "run" / "camera.json")
    for place in ("run/camera.json", "run"):
        rig = load_rig(place)
        assert (rig.names, rig.rig_frame, rig.covariance) == (("camera",), "", None)
        assert np.array_equal(rig.cameras[0].params, alone.params)
        assert np.array_equal(rig.cam_from_rig[0], np.eye(4))
    assert load_rig("pair.json#right").names == ("right",)
    with pytest.raises(InputError, match=r"^nothing.json#right: cannot be read"):
        load_rig("nothing.json#right")
    with pytest.raises(InputError, match=r"--from-unit m: is of lengths, and run is one camera; leave it out"):
        load_rig("run", unit="m")
    (tmp_path / "rig").mkdir()
    keep_cameras(load_rig("pair.json"), [1]).save(tmp_path / "rig" / "rig.json")
    other = stereo().cameras[1]
    for place in ("rig/rig.json", "rig", "pair.json#right"):
        assert np.array_equal(load_camera(place).params, other.params)
    (tmp_path / "two").mkdir()
    stereo().save(tmp_path / "two" / "rig.json")
    with pytest.raises(InputError, match=r"rig.json: holds 2 cameras \(left, right\); name one, as in FILE#left"):
        load_camera("two")
    assert calib.diff("rig", "pair.json#right").cameras is not None
    assert calib.diff("rig", "rig/rig.json").cameras is not None


def test_a_format_of_rigs_or_of_cameras_alone_takes_one_camera(tmp_path: Path) -> None:
    """Caliscope's file is of rigs, Metashape's of one camera: a camera, and a rig of one, are written to either."""
    pinhole = CAMERAS["pinhole"]
    pinhole.save("camera.json")
    Rig(("only",), (pinhole,), np.eye(4)[None]).save("one.json")
    for source in ("camera.json", "one.json", pinhole, load_rig("one.json")):
        assert len(calib.convert(source, "caliscope").held) == 1
        assert calib.convert(source, "metashape").unit == ""
    with pytest.raises(InputError, match="unknown rig format 'metashape'"):
        calib.convert("pair.json", "metashape")
