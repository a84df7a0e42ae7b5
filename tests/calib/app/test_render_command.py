"""`calib render`, run as a user runs it, and sets of photos on disk."""

import json
import re
from contextlib import chdir
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.cameras.camera import Camera, camera_from_mapping
from calib.cli import app
from calib.core.se3 import look_at
from calib.renderer import RenderOptions, render_view
from calib.renderer.job import RenderJob, render_file, run_jobs, truth_text
from designer.base.errors import InputError
from designer.kinds.layout import lay_out
from designer.kinds.sizing import size_job
from designer.target import TargetGeometry, target_to_json
from tests.support import command_line
from tests.support.command_line import Answer
from tests.support.designs import asked_for

CAMERA = Camera("opencv", np.array([300.0, 300, 79.5, 59.5, 0, 0, 0, 0, 0]), (160, 120))


def target() -> TargetGeometry:
    """A small board."""
    values = {"columns": 4, "rows": 4, "ring_diameter": "7mm", "pitch": "9mm"}
    return lay_out(size_job(asked_for("board", values)).job.target)


def job(views: int = 3, **changes: object) -> RenderJob:
    """A few small noisy views."""
    eye = np.array([[0, 5 * n, 120.0] for n in range(views)])
    values: dict[str, object] = {
        "target": target(), "camera": CAMERA, "cam_from_target": look_at(eye, np.zeros(3)),
        "options": RenderOptions(contrast_to_noise=30), "seed": 5,
    }  # fmt: skip
    return RenderJob(**{**values, **changes})  # type: ignore[arg-type]


def run(one: RenderJob, folder: Path, *, overwrite: bool = False) -> tuple[int, int]:
    """Render in this process; how many were written and kept."""
    done = run_jobs({folder: one}, processes=1, overwrite=overwrite, on_view=lambda *_: None)
    return done.rendered, done.kept


def calib(*arguments: str | Path, cwd: Path) -> Answer:
    """Run `calib` in a folder."""
    with chdir(cwd), pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "200")
        return command_line.calib(*arguments)


def test_a_killed_run_goes_on(tmp_path: Path) -> None:
    """With the same truth only missing images are rendered, and the set is the one of a run in one go."""
    assert run(job(), tmp_path / "whole") == (3, 0)
    assert run(job(), tmp_path / "broken") == (3, 0)
    (tmp_path / "broken" / "view_0001.png").unlink()
    (tmp_path / "broken" / ".view_0001.png.part").write_bytes(b"cut off")
    assert run(job(), tmp_path / "broken") == (1, 2)
    for name in ("truth.json", "view_0000.png", "view_0001.png", "view_0002.png"):
        assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "broken" / name).read_bytes()
    assert not list((tmp_path / "broken").glob(".*"))


def test_another_set_is_not_touched(tmp_path: Path) -> None:
    """A folder with another set, or with images without a truth, is refused; --overwrite replaces the whole set."""
    run(job(4), tmp_path)
    for other in (job(3), job(4, seed=6), job(4, options=RenderOptions())):
        with pytest.raises(InputError, match="another set"):
            run(other, tmp_path)
    assert run(job(3), tmp_path, overwrite=True) == (3, 0)
    assert sorted(path.name for path in tmp_path.glob("view*")) == [f"view_000{n}.png" for n in range(3)]
    (tmp_path / "truth.json").unlink()
    with pytest.raises(InputError, match=r"view_0000\.png: is there already"):
        run(job(3), tmp_path)


def test_truth_makes_the_image_again(tmp_path: Path) -> None:
    """Camera, options, pose and seed read from truth.json render the same image."""
    one = job()
    run(one, tmp_path)
    truth = json.loads((tmp_path / "truth.json").read_text())
    assert truth["geometry_id"] == one.target.geometry_id
    assert truth["layout_id"] == one.target.layout_id
    camera = camera_from_mapping(truth["camera"], "truth")
    view = truth["views"][1]
    options = RenderOptions(**truth["options"])
    rng = np.random.default_rng([truth["seed"], 1])
    again = render_view(one.target, camera, np.array(view["cam_from_target"]), options, rng)
    assert np.array_equal(cv2.imread(str(tmp_path / view["file"]), cv2.IMREAD_UNCHANGED), again.image)


@pytest.mark.parametrize(("file_format", "bits"), [("png", 8), ("png", 16), ("tiff", 8), ("tiff", 16), ("jpeg", 8)])
def test_file_formats(file_format: str, bits: int, tmp_path: Path) -> None:
    """PNG and TIFF hold the numbers exactly in 8 and 16 bits, JPEG about."""
    one = job(1, file_format=file_format, options=RenderOptions(bits=bits))  # type: ignore[arg-type]
    run(one, tmp_path)
    image = cv2.imread(str(tmp_path / one.file_names[0]), cv2.IMREAD_UNCHANGED)
    view = render_view(one.target, CAMERA, one.cam_from_target[0], one.options, np.random.default_rng([5, 0]))
    assert image.dtype == view.image.dtype
    tolerance = 0 if file_format != "jpeg" else 12
    assert np.abs(image.astype(int) - view.image.astype(int)).max() <= tolerance


def test_a_view_depends_on_its_number_only(tmp_path: Path) -> None:
    """A view is the same whichever views are rendered before it, and views differ in their noise."""
    render_file(job(), 2, tmp_path)
    alone = (tmp_path / "view_0002.png").read_bytes()
    run(job(), tmp_path / "set")
    assert (tmp_path / "set" / "view_0002.png").read_bytes() == alone
    same_pose = job(2, cam_from_target=np.stack([job().cam_from_target[0]] * 2))
    run(same_pose, tmp_path / "twice")
    assert (tmp_path / "twice" / "view_0000.png").read_bytes() != (tmp_path / "twice" / "view_0001.png").read_bytes()


def test_truth_is_written_line_by_line() -> None:
    """truth.json is valid JSON with one line a view."""
    text = truth_text(job(7))
    assert (
        len([line for line in text.splitlines() if line.startswith('  {"file"')]) == len(json.loads(text)["views"]) == 7
    )


@pytest.fixture(scope="module")
def target_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The board's file, and a camera's beside it."""
    path = tmp_path_factory.mktemp("target") / "board.target.json"
    path.write_text(target_to_json(target()), encoding="utf-8")
    camera = {"fx_px": 300.0, "fy_px": 300.0, "cx_px": 79.5, "cy_px": 59.5}
    document = {
        "format": "ringsolid.camera", "version": 1, "model": "pinhole", "image_size": [160, 120], "parameters": camera
    }  # fmt: skip
    path.with_name("small.json").write_text(json.dumps(document))
    return path


def test_the_command_renders_and_says_what_comes_next(target_file: Path, tmp_path: Path) -> None:
    """`calib render` with two processes writes the set, prints a summary, and names the next command."""
    arguments = ["render", target_file, "-o", "set", "--views", "3", "--camera", target_file.with_name("small.json")]
    done = calib(*arguments, "--distance", "12cm", "--blur", "0.7px", "--jobs", "2", cwd=tmp_path)
    assert done.code == 0, done.err
    assert {path.name for path in (tmp_path / "set").iterdir()} == {
        "index.html", "page.json", "truth.json", "target.json", "view_0000.png", "view_0001.png", "view_0002.png",
    }  # fmt: skip
    assert "3 photos of 160 x 120 px" in done.out
    assert re.search(r"^ +calib run .*board\.target\.json set ", done.out, re.MULTILINE)
    again = calib(*arguments, "--distance", "12cm", "--blur", "0.7px", cwd=tmp_path)
    assert "3 were there already" in again.out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--distance", "20mm"], "--distance 20mm: the target reaches"),
        (["--white", "5%"], "--white 5% is not lighter than --black 10%"),
        (["--bits", "12"], "--bits '12' is unknown; use 8, 16, 32"),
        (["--bits", "32"], "--bits 32: is of arrays; files hold 8 or 16"),
        (["--bits", "16", "--format", "jpeg"], "use png or tiff"),
        (["--focus", "300mm"], "says nothing without --aperture"),
        (["--quality", "50"], "--quality 50: says nothing of png"),
        (["--poses", "p.json", "--views", "3"], "--views: says nothing with --poses"),
        (["--region", "sphere", "--cap-angle", "30deg"], "--cap-angle: says nothing of a sphere"),
    ],
)
def test_bad_values_are_refused(
    options: list[str], message: str, target_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A value that breaks a rule is refused in one line that names it, before anything is written."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as caught:
        app()(["render", str(target_file), "-o", "set", *options], standalone_mode=False)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "set").exists()


def test_hard_sets_are_warned_of(target_file: Path, tmp_path: Path) -> None:
    """Rings that are too small, a target that leaves the image, or light beyond full scale, are said."""
    small = ["--camera", target_file.with_name("small.json"), "--views", "2", "--jobs", "1"]
    far = calib("render", target_file, "-o", "far", *small, "--distance", "800mm", cwd=tmp_path)
    assert far.code == 0
    assert "largest mark has a radius of 1.2 px" in far.out
    near = calib(
        "render", target_file, "-o", "near", *small, "--distance", "50mm", "--light-gradient", "60%", cwd=tmp_path
    )
    assert near.code == 0
    assert "light gradient takes the white beyond full scale" in near.out
    assert "beyond the image in 100% of the views" in near.out
