"""COLMAP's cameras.txt against COLMAP's own reader and projection."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest

from calib.cameras import project
from calib.cameras.formats import FORMATS
from calib.cameras.formats.colmap import NUMBERED
from calib.cameras.formats.colmap import text_of as text_of_binary
from calib.cameras.formats.holding import fit_to_format
from calib.cameras.formats.reading import open_camera
from designer.base.errors import InputError
from tests.support.foreign_cameras import CAMERAS, SIZE, lens_camera, text_of, whole_image, written
from tests.support.foreign_projections import in_colmap

READABLE = {
    "SIMPLE_PINHOLE": [900.0, 510, 390],
    "PINHOLE": [900.0, 880, 510, 390],
    "SIMPLE_RADIAL": [900.0, 510, 390, -0.1],
    "RADIAL": [900.0, 510, 390, -0.1, 0.03],
    "OPENCV": [900.0, 880, 510, 390, -0.1, 0.03, 0.002, -0.001],
    "FULL_OPENCV": [900.0, 880, 510, 390, -0.1, 0.03, 0.002, -0.001, 0.01, 0, 0, 0],
}


def test_the_half_pixel() -> None:
    """A principal point in the middle pixel of an image of 1024 columns is 511.5 here and 512 in COLMAP."""
    camera = FORMATS["colmap"].read("1 PINHOLE 1024 768 900 900 512 384", "c", None).camera
    assert camera.params[2:4].tolist() == [511.5, 383.5]
    assert text_of("colmap", camera).splitlines()[-1] == "1 PINHOLE 1024 768 900.0 900.0 512.0 384.0"


@pytest.mark.parametrize("model", READABLE)
def test_what_colmap_writes_is_read(model: str, tmp_path: Path) -> None:
    """Every model that is a special case of ours is read, and sees what COLMAP's projection sees."""
    camera = pycolmap.Camera(model=model, width=SIZE[0], height=SIZE[1], params=READABLE[model], camera_id=3)
    reconstruction = pycolmap.Reconstruction()
    reconstruction.add_camera(camera)
    reconstruction.write_text(str(tmp_path))
    found = FORMATS["colmap"].read((tmp_path / "cameras.txt").read_text(), "cameras.txt", None)
    assert found.refit is None
    pixel, ray = whole_image(found.camera)
    assert np.abs(camera.img_from_cam(ray) - (pixel + 0.5)).max() < 1e-9


def test_the_residual_of_another_lens_is_what_colmap_shows(tmp_path: Path) -> None:
    """A double sphere is none of COLMAP's: of its lenses the one told to be closest is, by as much as is told."""
    camera = lens_camera("kalibr", "ds-none")
    held = fit_to_format(camera, FORMATS["colmap"])
    assert held.refit is not None
    tried = {lens.name: fit.rms_px for lens, fit in held.tried}
    assert {"OPENCV_FISHEYE", "EUCM"} <= set(tried)
    assert "OPENCV" not in tried  # it sees too far for a focal plane
    pixel, ray = whole_image(camera)
    front = ray[:, 2] > 0.05
    text = FORMATS["colmap"].write(held.camera, held.lens)
    off = np.linalg.norm(in_colmap(text, ray[front], "", camera.image_size, tmp_path) - pixel[front], axis=1)
    assert off.max() <= held.refit.max_px + 1e-9
    seen = project(held.camera, ray)
    assert np.abs(np.linalg.norm(seen - pixel, axis=1).max() - held.refit.max_px) < 1e-9


def test_the_smallest_model_that_holds_the_camera() -> None:
    """Without a lens PINHOLE is written, without k3 OPENCV, which more readers know, else FULL_OPENCV."""
    models = {camera: written("colmap", camera)[1].splitlines()[-1].split()[1] for camera in CAMERAS}
    assert models["pinhole"] == "PINHOLE"
    assert models["tiny coefficients"] == "OPENCV"
    assert models["barrel"] == "FULL_OPENCV"


def test_colmaps_binary_file_is_read(tmp_path: Path) -> None:
    """What COLMAP writes into cameras.bin is what it writes into cameras.txt, of every model it has."""
    reconstruction = pycolmap.Reconstruction()
    names = [name for name, row in pycolmap.CameraModelId.__members__.items() if 0 <= int(row) < len(NUMBERED)]
    assert sorted(names) == sorted(NUMBERED)
    for row, name in enumerate(names, start=1):
        camera = pycolmap.Camera.create_from_model_name(row, name, 612.3, *SIZE)
        reconstruction.add_camera(camera)
    reconstruction.write_text(str(tmp_path))
    reconstruction.write_binary(str(tmp_path))
    content, text = (tmp_path / "cameras.bin").read_bytes(), (tmp_path / "cameras.txt").read_text()
    mine = [line.split() for line in text_of_binary(content, "c").splitlines() if not line.startswith("#")]
    theirs = [line.split() for line in text.splitlines() if not line.startswith("#")]
    assert [[*one[:4], *map(float, one[4:])] for one in sorted(mine)] == [
        [*one[:4], *map(float, one[4:])] for one in sorted(theirs)
    ]
    number = names.index("OPENCV") + 1
    one = open_camera(f"{tmp_path / 'cameras.bin'}#{number}")
    assert one.format.name == "colmap"
    assert one.read.camera.image_size == SIZE
    for damaged in (content[:-1], content + b"x", content[:9], b"", b"\xff" * 99, content[:8] + b"\x01" * 40):
        (tmp_path / "bad.bin").write_bytes(damaged)
        with pytest.raises(InputError, match=r"cameras\.bin of COLMAP|none that is known"):
            open_camera(str(tmp_path / "bad.bin"))


def test_lines_that_are_no_camera_of_ours() -> None:
    """Other models, a wrong count, a second camera of the same id: each is named with its line."""
    for text, rule in (
        (
            "# a\n\n1 FOV 10 10 1 1 5 5 0.5",
            "line 3: camera model 'FOV': not supported; in COLMAP use one of PINHOLE, OPENCV",
        ),
        ("1 OPENCV 10 10 1 1 5 5 0 0 0", "line 1: OPENCV has 7 parameters; it must have 8: fx fy cx cy k1 k2 p1 p2"),
        ("1 PINHOLE 10", "line 1: must be CAMERA_ID MODEL WIDTH HEIGHT PARAMS"),
        ("1 PINHOLE 10 10 9 9 5 5\n1 PINHOLE 10 10 9 9 5 5", "line 2: camera '1' a second time"),
        ("1 PINHOLE 10 10 9 9 5 5\n2 PINHOLE 10 10 9 9 5 5", r"holds 2 cameras \(1, 2\); name one"),
        ("# nothing\n", "holds no camera"),
    ):
        with pytest.raises(InputError, match=rule):
            FORMATS["colmap"].read(text, "cameras.txt", None)


def test_one_of_several_cameras() -> None:
    """A camera is named by its id."""
    text = "1 PINHOLE 10 10 9 9 5 5\n2 SIMPLE_PINHOLE 10 10 7 5 5\n"
    camera = FORMATS["colmap"].read(text, "cameras.txt", "2").camera
    assert np.allclose(project(camera, np.array([0.0, 0, 1])), [4.5, 4.5])
    assert camera.params[0] == 7
