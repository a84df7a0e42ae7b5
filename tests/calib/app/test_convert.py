"""The command `calib convert`."""

import re
from pathlib import Path

import numpy as np
import pytest

import calib
from calib.cameras import project
from calib.cameras.camera import Camera, camera_to_json, load_camera
from calib.cameras.formats import READ_FORMATS, WRITTEN_FORMATS
from calib.cameras.formats.reading import open_camera
from designer.base.answer import Summary
from designer.base.errors import InputError
from tests.support.foreign_cameras import CAMERAS, SIZE, lens_camera, whole_image


def run(camera: str, *, to: str, out: Path, **options: object) -> Summary:
    """The command, whose options are given as a shell gives them."""
    answer: Summary = calib.convert.as_command()(camera=camera, to=to, out=out, **options)  # type: ignore[attr-defined]
    return answer


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder to work in, with camera files."""
    monkeypatch.chdir(tmp_path)
    for name, camera in CAMERAS.items():
        Path(f"{name}.json").write_text(camera_to_json(camera))
    return tmp_path


def test_the_residual_is_told_and_true(capsys: pytest.CaptureFixture[str]) -> None:
    """The stated RMS and max are the difference between the two files; a large one is refused, or warned of."""
    with pytest.raises(InputError, match=r"pinhole-radtan, which has no k3, is off .* --accept 13.73px; pinhole-equi"):
        run("barrel.json", to="kalibr", out=Path("camchain.yaml"))
    with pytest.raises(InputError, match=r"more than 13\.7 px"):
        run("barrel.json", to="kalibr", out=Path("camchain.yaml"), accept_px="13.7px")
    run("barrel.json", to="kalibr", out=Path("camchain.yaml"), accept_px="13.73px")
    said = capsys.readouterr().out
    numbers = re.search(r"fitted opencv over the whole image: RMS ([0-9.]+) px, max ([0-9.]+) px", said)
    assert numbers is not None
    pixel, ray = whole_image(CAMERAS["barrel"])
    off = np.linalg.norm(project(open_camera("camchain.yaml").read.camera, ray) - pixel, axis=1)
    assert float(numbers[1]) == pytest.approx(np.sqrt(np.mean(off**2)), abs=1e-4)
    assert float(numbers[2]) == pytest.approx(off.max(), abs=1e-4)
    assert "Lost: k3, for which Kalibr camchain has no place" in said
    assert "Far: the two cameras differ by more than 0.05 px" in said
    assert "open     kalibr_calibrate_imu_camera --cams camchain.yaml" in said


def test_the_family_can_be_changed(capsys: pytest.CaptureFixture[str]) -> None:
    """`--to json --model` fits another model; other formats hold one family and say so."""
    run("backward.json", to="json", out=Path("forward.json"), model="opencv")
    assert load_camera(Path("forward.json")).model == "opencv"
    assert "fitted opencv over the whole image" in capsys.readouterr().out
    run("barrel.json", to="mrcal", out=Path("linear.cameramodel"), model="pinhole")
    assert "Lost: the lens's distortion" in capsys.readouterr().out
    with pytest.raises(
        InputError, match=r"COLMAP cameras\.txt holds models pinhole, opencv, opencv8, .*, not 'luhmann'"
    ):
        run("backward.json", to="colmap", out=Path("x"), model="luhmann")
    with pytest.raises(InputError, match="model 'virtual' cannot be fitted"):
        run("backward.json", to="json", out=Path("x"), model="virtual")
    assert not Path("x").exists()


def test_a_lens_parameter_can_be_left_out() -> None:
    """`--without k3` makes a camera that COLMAP's OPENCV model holds; an unknown name is refused."""
    run("barrel.json", to="colmap", out=Path("cameras.txt"), without=["k3"])
    assert " OPENCV " in Path("cameras.txt").read_text()
    with pytest.raises(InputError, match=r"--without 'k9': no lens parameter; there are .*k1, k2, k3.*p1, p2"):
        run("barrel.json", to="colmap", out=Path("cameras.txt"), without=["k9"])


def test_what_a_foreign_lens_cost_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    """A lens that is no model of ours is fitted when it is read, with its residual.

    It is refused where it is off by more than a lens may be that is written, by every command that takes a camera.
    """
    run("barrel.json", to="metashape", out=Path("c.xml"))
    Path("c.xml").write_text(Path("c.xml").read_text().replace("</calibration>", "<p3>.2</p3></calibration>"))
    capsys.readouterr()
    for refused in (
        lambda: run("c.xml", to="json", out=Path("c.json")), lambda: calib.load_camera("c.xml"),
        lambda: calib.load_rig("c.xml"), lambda: calib.diff("barrel.json", "c.xml"),
    ):  # fmt: skip
        with pytest.raises(
            InputError, match=r"^c\.xml: .* off by up to 1\.29 px, more than 0\.1 px; .* --accept 1\.3px$"
        ):
            refused()
    run("c.xml", to="json", out=Path("c.json"), accept_px=1.3)
    said = capsys.readouterr().out
    assert "its frame lens with p3 was fitted by the model opencv" in said
    assert "fitted opencv over the whole image: RMS 0." in said
    assert "calib diff" not in said  # which would refuse the one file


def test_the_lens_is_chosen_and_can_be_named(capsys: pytest.CaptureFixture[str]) -> None:
    """A camera's own lens is written as it is; another's is the closest, told with those it was taken from; or asked.

    A lens that cannot show what the camera sees is refused with those that can.
    """
    Path("wide.json").write_text(camera_to_json(lens_camera("kalibr", "ds-none")))
    run("wide.json", to="kalibr", out=Path("k.yaml"))
    said = capsys.readouterr().out
    assert "Kalibr camchain, ds-none = ds, 1000 x 800 px" in said
    assert "exact: no fit was needed" in said
    run("wide.json", to="kalibr", out=Path("k.yaml"), lens="EUCM-none")
    assert re.search("fitted eucm over the whole image: RMS 0.1", capsys.readouterr().out)
    answer = run("wide.json", to="colmap", out=Path("c.txt")).answer
    said = capsys.readouterr().out
    assert "chosen   OPENCV_FISHEYE, the closest of (RMS in px) OPENCV_FISHEYE 0.0058, EUCM 0.1" in said
    assert answer["written"]["lens"] == "OPENCV_FISHEYE"  # type: ignore[index, call-overload]
    with pytest.raises(InputError, match=r"more than a half space, which model opencv .*; there are fisheye, "):
        run("wide.json", to="colmap", out=Path("c.txt"), lens="OPENCV")
    with pytest.raises(
        InputError, match=r"COLMAP cameras\.txt has no lens 'OPENCV_FISHEY'; did you mean 'OPENCV_FISHEYE'"
    ):
        run("wide.json", to="colmap", out=Path("c.txt"), lens="OPENCV_FISHEY")


def test_the_input_is_not_overwritten_however_it_was_named() -> None:
    """A folder stands for its camera.json, and FILE#NAME for a file: neither may be the output, too."""
    Path("solved").mkdir()
    Path("solved/camera.json").write_text(camera_to_json(CAMERAS["tiny coefficients"]))
    run("solved", to="kalibr", out=Path("chain.yaml"))
    for source, out in (("solved", "solved/camera.json"), ("chain.yaml#cam0", "chain.yaml")):
        before = Path(out).read_bytes()
        with pytest.raises(InputError, match="is a file to read"):
            run(source, to="opencv", out=Path(out))
        assert Path(out).read_bytes() == before
    run("machine-vision", to="opencv", out=Path("template.yaml"))


def test_a_camera_that_cannot_be_fitted_is_named() -> None:
    """The line that refuses a camera says which file it is of."""
    nothing = Camera("opencv", np.array([900.0, 900, -1e6, 380, -0.3, 0, 0, 0, -0.1]), SIZE)
    Path("nothing.json").write_text(camera_to_json(nothing))
    with pytest.raises(InputError, match=r"^nothing\.json: by these numbers 0\.0 % of the image see"):
        run("nothing.json", to="kalibr", out=Path("c.yaml"))
    assert not Path("c.yaml").exists()


def test_the_kind_can_be_given() -> None:
    """`--from` reads what cannot be told; a wrong one is refused by the format that was named."""
    run("barrel.json", to="ros", out=Path("c.yaml"))
    run("c.yaml", to="json", out=Path("c.json"), source="opencv")
    with pytest.raises(InputError, match=r"c\.yaml: .*not a mrcal camera model"):
        run("c.yaml", to="json", out=Path("d.json"), source="mrcal")
    with pytest.raises(InputError, match="unknown camera format 'kolmap'; did you mean 'colmap'"):
        run("c.yaml", to="kolmap", out=Path("d.json"))


def test_of_several_models_that_of_the_verdict_is_taken(folder: Path) -> None:
    """A folder of `calib run` with all models holds a camera in a folder of each: without a verdict they are named."""
    for model in ("luhmann", "opencv"):
        run("barrel.json", to="json", out=folder / "run" / model / "camera.json")
    with pytest.raises(InputError, match="name the folder of one: run/luhmann, run/opencv"):
        open_camera("run")
    assert open_camera("run/opencv").path == Path("run/opencv/camera.json")
    (folder / "run" / "verdict.json").write_text('{"verdict": {"model": "opencv"}}')
    opened = open_camera("run")
    assert opened.path == Path("run/opencv/camera.json")
    assert "taken, opencv; or name one: run/luhmann" in opened.read.remarks[0]


@pytest.mark.parametrize("kind", [name for name in WRITTEN_FORMATS if name in READ_FORMATS])
def test_what_is_written_under_a_name_that_is_taken_is_read_back(kind: str) -> None:
    """Whatever the ending: an ending that means another kind of file is refused, with the right one."""
    usual = Path(WRITTEN_FORMATS[kind].file_name).suffix
    for ending in (usual, "", f".{kind}", ".txt", ".mat", ".bin", ".toml", ".bag", ".mcap"):
        try:
            out = written("pinhole.json", kind, ending)
        except InputError as error:
            said = str(error)
            assert ending != usual, said
            assert said.endswith(f"name it back{usual}"), said
        else:
            assert open_camera(str(out)).read.camera.image_size == SIZE


def written(camera: str, kind: str, ending: str) -> Path:
    """The file of a camera in another format."""
    out = Path(f"back{ending}")
    run(camera, to=kind, out=out)
    return out
