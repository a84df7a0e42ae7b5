"""What holds for every camera-file format."""

import contextlib
from pathlib import Path

import numpy as np
import pytest
import yaml

import calib
from calib.cameras import ABILITIES, project
from calib.cameras.camera import Camera
from calib.cameras.formats import ACCEPTED_PX, FORMATS, OWN
from calib.cameras.formats.holding import fit_to_format
from calib.cameras.formats.reading import open_camera, recognise
from designer.base.errors import InputError
from tests.support.foreign_cameras import (
    CAMERAS,
    MODELS,
    WIDE_SIZE,
    ahead,
    lens_camera,
    lenses_of,
    text_of,
    whole_image,
    written,
)
from tests.support.foreign_projections import SEEN_IN

EVERY = [(name, camera) for name in FORMATS for camera in CAMERAS]


@pytest.mark.parametrize(("name", "camera"), EVERY)
def test_a_file_reads_back_as_it_was_written(name: str, camera: str) -> None:
    """What a format wrote is known for its own and read back, to rounding errors, over the whole image."""
    held, text = written(name, camera)
    kind = recognise(text)
    assert kind is not None
    assert kind.name == name
    back = FORMATS[name].read(text, "file", None)
    assert back.refit is None
    assert back.remarks == ()
    assert back.camera.image_size == held.image_size
    pixel, ray = whole_image(held)
    assert np.abs(project(back.camera, ray) - pixel).max() < 1e-9


SEEN = [(name, "", camera) for name in SEEN_IN if name != "basalt" for camera in CAMERAS]
SEEN += [(name, lens, "") for name in SEEN_IN for lens in lenses_of(name)]
IN_FRONT = ("opencv", "ros", "colmap", "photonvision", "gyroflow", "depthai")
"""Formats whose programs see ahead alone."""


@pytest.mark.parametrize(("name", "lens", "camera"), SEEN)
def test_its_own_programs_see_what_the_camera_sees(name: str, lens: str, camera: str, tmp_path: Path) -> None:
    """With a file's numbers the program that it is for, or its published formula, sees each ray in its pixel."""
    held, text = written(name, camera) if camera else (lens_camera(name, lens), "")
    text = text or text_of(name, held, lens)
    is_ahead = name in IN_FRONT or lens == "pinhole-radtan8"
    pixel, ray = (ahead if is_ahead else whole_image)(held)
    assert np.abs(SEEN_IN[name](text, ray, lens, held.image_size, tmp_path) - pixel).max() < 1e-8


@pytest.mark.parametrize(("name", "lens"), [(name, lens) for name in FORMATS for lens in lenses_of(name)])
def test_each_lens_reads_back_as_it_was_written(name: str, lens: str) -> None:
    """A camera of a lens's model is held as it is, asked for or left to itself; the known file has the same rays."""
    camera = lens_camera(name, lens)
    by_itself = fit_to_format(camera, FORMATS[name])
    assert by_itself.refit is None
    assert by_itself.tried == ()
    held = fit_to_format(camera, FORMATS[name], lens=lens)
    assert held.refit is None
    text = FORMATS[name].write(held.camera, held.lens)
    kind = recognise(text)
    assert kind is not None
    assert kind.name == name
    back = FORMATS[name].read(text, "file", None)
    assert back.refit is None
    pixel, ray = whole_image(camera)
    assert np.abs(project(back.camera, ray) - pixel).max() < 1e-9


def has_wide(name: str) -> bool:
    """Whether a format has a lens for a camera that sees behind."""
    return any(lens.is_wide for lens in FORMATS[name].lenses)


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("model", MODELS)
def test_a_format_never_changes_the_family_of_a_lens(name: str, model: str) -> None:
    """A camera with a focal plane gets no wide lens, nor the other way round: written, within what is accepted, or not.

    A lens of another kind follows some cameras better, but its numbers mean something else; it has to be asked for.
    """
    camera = Camera(model, np.array(MODELS[model]), WIDE_SIZE)
    if ABILITIES[model].is_wide and not has_wide(name):
        with contextlib.suppress(InputError):
            done = calib.convert(camera, name, accept_px=1e3)
            assert done.max_px < ACCEPTED_PX or any("by a lens of another kind" in line for line in done.lost)
        return
    done = calib.convert(camera, name, accept_px=1e3)
    if done.max_px > ACCEPTED_PX:
        assert any(" px of where the camera sees a point" in line for line in done.lost)
        with pytest.raises(InputError, match="accept_px"):
            calib.convert(camera, name)
    (held,) = done.held
    lens = held.lens
    assert lens.model is None or lens.is_wide == ABILITIES[model].is_wide


@pytest.mark.parametrize("name", ["opencv", "ros", "kalibr"])
def test_small_numbers_in_yaml_are_numbers(name: str) -> None:
    """YAML 1.1 takes `1e-05` for text; Kalibr and ROS read with such a parser, so it must be `1.0e-05`."""
    held, text = written(name, "tiny coefficients")
    tree = yaml.safe_load(text.replace("%YAML:1.0\n", "").replace("!!opencv-matrix", ""))
    lens = tree["cam0"]["distortion_coeffs"] if name == "kalibr" else tree["distortion_coefficients"]["data"]
    assert all(isinstance(value, float) for value in lens)
    assert lens[:4] == held.params[4:8].tolist()


@pytest.mark.parametrize("name", [name for name in FORMATS if name != "json"])
def test_a_value_of_another_kind_is_named(name: str) -> None:
    """A word, an infinity or a nought for the focal length, and an image size that is no whole number of pixels."""
    held, text = written(name, "barrel")
    focal = repr(float(held.params[1]))
    for number, others in (
        (focal, ("wide", "1e999", "nan", "0.0", "-5.0")),
        ("1024", ("0", "-3", "10.5", "1e99", "x")),
    ):
        assert number in text
        for wrong in others:
            with pytest.raises(InputError, match=r"^f\.x: .") as caught:
                FORMATS[name].read(text.replace(number, wrong), "f.x", None)
            assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", [name for name in FORMATS if name != OWN])
def test_the_docs_say_what_a_format_holds(name: str) -> None:
    """Each lens, and the model that it is, stands in the format's row of docs/calibrate.md."""
    page = (Path(__file__).parents[3] / "docs/calibrate.md").read_text()
    row = next(line for line in page.splitlines() if line.startswith(f"| `{name}` {FORMATS[name].title} |"))
    for lens in FORMATS[name].lenses:
        assert f"`{lens.name}`" in row
        assert lens.model is None or not lens.is_written or lens.model in row


@pytest.mark.parametrize("name", [name for name in FORMATS if lenses_of(name) and has_wide(name)])
def test_a_refused_lens_is_answered_by_those_of_the_format_that_suit(name: str) -> None:
    """A lens with a focal plane asked for a camera that sees behind: the format's own lenses that can are named."""
    camera, lenses = Camera("fisheye", np.array(MODELS["fisheye"]), WIDE_SIZE), FORMATS[name].written
    for narrow in (one for one in lenses.values() if not one.is_wide):
        with pytest.raises(InputError, match=r"more than a half space.*; of .* take --lens ") as refused:
            fit_to_format(camera, FORMATS[name], lens=narrow.name)
        for advised in str(refused.value).rpartition("--lens ")[2].split(", "):
            fit_to_format(camera, FORMATS[name], lens=advised)


def test_a_toml_camera_that_is_cut_off_is_refused_or_told(tmp_path: Path) -> None:
    """Of a surface every control point has to be there; of a lens of few numbers, what is taken as nothing is told."""
    text = (Path(__file__).parents[3] / "templates/cameras/phase-one-spline.toml").read_text().rstrip()
    (tmp_path / "c.toml").write_text(text)
    assert open_camera(str(tmp_path / "c.toml")).read.remarks == ()
    (tmp_path / "c.toml").write_text(text.rsplit("\n", 30)[0])
    with pytest.raises(InputError, match=r"is missing, and 29 more of the 100 of model spline"):
        open_camera(str(tmp_path / "c.toml"))
    head = 'format = "ringsolid.camera"\nversion = 1\nmodel = "opencv"\nimage_size = [640, 480]\n[parameters]\n'
    linear = "fx_px = 500.0\nfy_px = 500.0\ncx_px = 320.0\ncy_px = 240.0\n"
    for lens, missing in (("", None), ("k1 = -0.1\nk2 = 0.05\n", "lacks p1 p2 k3")):
        (tmp_path / "c.toml").write_text(head + linear + lens)
        remarks = open_camera(str(tmp_path / "c.toml")).read.remarks
        assert (not remarks) if missing is None else (missing in remarks[0])
