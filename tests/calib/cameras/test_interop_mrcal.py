"""mrcal's camera models against mrcal."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.cameras import project
from calib.cameras.camera import Camera
from calib.cameras.formats import FORMATS
from calib.cameras.formats.holding import fit_to_format
from calib.cameras.formats.mrcal_surface import cahvore_rays, surface_named
from calib.cameras.refit import image_grid
from designer.base.errors import InputError
from tests.support.foreign_cameras import (
    CAMERAS,
    SIZE,
    ask_mrcal,
    lens_camera,
    lenses_of,
    text_of,
    whole_image,
    written,
)

PROJECT = """
answer = []
for path, size, ray in question:
    model = mrcal.cameramodel(path)
    assert model.imagersize().tolist() == size
    answer.append(mrcal.project(np.array(ray), *model.intrinsics()).tolist())
"""

WRITE = """
answer = []
for path, lens, params in question:
    mrcal.cameramodel(intrinsics=(lens, np.array(params, dtype=float)), imagersize=(1024, 768)).write(path)
"""

LENSES = {
    "LENSMODEL_PINHOLE": [900.0, 880, 510, 390],
    "LENSMODEL_OPENCV4": [900.0, 880, 510, 390, -0.1, 0.03, 0.002, -0.001],
    "LENSMODEL_OPENCV5": [900.0, 880, 510, 390, -0.1, 0.03, 0.002, -0.001, 0.01],
    "LENSMODEL_OPENCV8": [900.0, 880, 510, 390, -0.1, 0.03, 0.002, -0.001, 0.01, 0, 0, 0],
}


SURFACE = "LENSMODEL_SPLINED_STEREOGRAPHIC"


@pytest.fixture(scope="module")
def cameras_seen(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Camera, np.ndarray]]:
    """Cameras that mrcal's lenses hold, and where mrcal sees their rays."""
    folder = tmp_path_factory.mktemp("mrcal")
    cameras = {name: written("mrcal", name) for name in CAMERAS}
    for name in (*lenses_of("mrcal"), SURFACE):
        camera = lens_camera("kalibr", "ds-none") if name == SURFACE else lens_camera("mrcal", name)
        cameras[name] = camera, text_of("mrcal", camera, name)
    question = []
    for index, (camera, text) in enumerate(cameras.values()):
        (folder / f"{index}.cameramodel").write_text(text)
        question.append([f"{folder}/{index}.cameramodel", list(camera.image_size), whole_image(camera)[1].tolist()])
    seen = ask_mrcal(PROJECT, question, folder)
    assert isinstance(seen, list)
    return {name: (camera, np.array(one)) for (name, (camera, _)), one in zip(cameras.items(), seen, strict=True)}


@pytest.mark.parametrize("name", [*CAMERAS, *lenses_of("mrcal")])
def test_mrcal_sees_the_same_through_each_lens(name: str, cameras_seen: dict[str, tuple[Camera, np.ndarray]]) -> None:
    """Mrcal reads each lens by its name and sees the rays in the camera's pixels, those from behind, too."""
    camera, seen = cameras_seen[name]
    assert np.abs(seen - whole_image(camera)[0]).max() < 1e-9


def test_a_surface_is_off_by_what_is_told(cameras_seen: dict[str, tuple[Camera, np.ndarray]]) -> None:
    """A double sphere in mrcal's splined lens: mrcal sees its rays as far off as is told, within a thousandth px."""
    camera, seen = cameras_seen[SURFACE]
    held = fit_to_format(camera, FORMATS["mrcal"], lens=SURFACE)
    assert held.refit is not None
    off = np.linalg.norm(seen - whole_image(camera)[0], axis=1)
    assert np.sqrt(np.mean(off**2)) == pytest.approx(held.refit.rms_px, rel=0.3)  # at other pixels
    assert off.max() < 2 * held.refit.max_px
    assert held.refit.max_px < 1e-3


TILTED = [900.0, 880, 510, 390, 0.02, -0.015, 0.01, -0.1, 0.03]
OF_MRCAL = {
    "LENSMODEL_CAHVOR": TILTED,
    "LENSMODEL_CAHVORE_linearity=0.4": [*TILTED, 0, 0, 0],
    "LENSMODEL_CAHVORE_linearity=-0.3": [*TILTED, 0, 0, 0],
    **{
        f"LENSMODEL_SPLINED_STEREOGRAPHIC_order={order}_Nx=8_Ny=7_fov_x_deg=120": [
            *(520, 510, 515, 385),
            *(0.01 * np.random.default_rng(order).standard_normal(112)),
        ]
        for order in (2, 3)
    },
}


def test_rays_of_lenses_that_are_none_of_ours_are_mrcals(tmp_path: Path) -> None:
    """Mrcal sees the rays of tilted CAHVOR and CAHVORE, and of surfaces of both degrees, where they were taken."""
    pixel = image_grid(SIZE, 20).reshape(-1, 2)
    question = []
    for name, params in OF_MRCAL.items():
        numbers = list(map(float, params))
        if "SPLINED" in name:
            ray = surface_named(name, numbers, "m").rays(pixel)
        else:
            linearity = float(name.partition("=")[2] or 1)
            ray = cahvore_rays(pixel, numbers[:4], numbers[4:], linearity)
        known = np.isfinite(ray).all(axis=1)
        assert known.mean() > 0.6
        question.append([name, numbers, np.where(known[:, None], ray, [0, 0, 1]).tolist(), known.tolist()])
    code = "answer = [mrcal.project(np.array(r), n, np.array(p)).tolist() for n, p, r, _ in question]"
    for seen, (name, _, _, known) in zip(np.array(ask_mrcal(code, question, tmp_path)), question, strict=True):
        assert np.abs(seen - pixel)[known].max() < 1e-6, name


def test_a_lens_of_mrcal_that_is_none_of_ours_is_fitted() -> None:
    """What is left over is told, and what was fitted."""
    numbers = ", ".join(map(str, OF_MRCAL["LENSMODEL_CAHVORE_linearity=0.4"]))
    text = OTHERS.replace("DISTORTION_OPENCV5", "LENSMODEL_CAHVORE_linearity=0.4").replace("640, 480", "1024, 768")
    text = text.replace("500, 501., +3.2e2, 240, -.25, 0.0625, 0., -2E-3, 5e-1", numbers)
    found = FORMATS["mrcal"].read(text, "m", None)
    assert found.refit is not None
    pixel = image_grid(SIZE).reshape(-1, 2)
    ray = cahvore_rays(pixel, TILTED[:4], TILTED[4:], 0.4)
    off = np.linalg.norm(project(found.camera, ray) - pixel, axis=1)
    assert np.nanmax(off) == pytest.approx(found.refit.max_px, abs=1e-6)
    assert "its lens LENSMODEL_CAHVORE_linearity=0.4 was fitted by the model" in found.remarks[0]


def test_what_cahvor_holds_of_ours_is_read_as_it_is() -> None:
    """With the optical axis across the image r0 scales the focal length, and no fit is needed."""
    for name, more, model in (
        ("LENSMODEL_CAHVOR", "", "opencv"),
        ("LENSMODEL_CAHVORE_linearity=0", "0, 0, 0,", "fisheye"),
    ):
        text = OTHERS.replace("DISTORTION_OPENCV5", name).replace(
            "-.25, 0.0625, 0., -2E-3, 5e-1,", f"0, 0, .25, -.125, .0625, {more}"
        )
        found = FORMATS["mrcal"].read(text, "m", None)
        assert found.refit is None
        assert found.camera.model == model
        assert found.camera.params[:6].tolist() == [625, 626.25, 320, 240, -0.1, 0.05]


def test_what_mrcal_writes_is_read(tmp_path: Path) -> None:
    """The lenses that are special cases of ours are read exactly, to mrcal's ten digits."""
    files = {lens: tmp_path / f"{lens}.cameramodel" for lens in LENSES}
    ask_mrcal(WRITE, [[str(files[lens]), lens, LENSES[lens]] for lens in LENSES], tmp_path)
    for lens, params in LENSES.items():
        found = FORMATS["mrcal"].read(files[lens].read_text(), "m", None)
        assert found.refit is None
        assert found.camera.image_size == SIZE
        assert np.allclose(found.camera.params[: len(params)], params[:9], rtol=1e-9)


OTHERS = """
 # {
{'lens_model':  #"LENSMODEL_CAHVOR",
"DISTORTION_OPENCV5", "intrinsics": (500, 501., +3.2e2, 240, -.25, 0.0625, 0., -2E-3, 5e-1,),
 'rt_cam_ref' :[ 0., 1, 2, 33, # 44e4,
 44e4, -55.3E-3], 'imagersize': [640, 480], 'xxx': b'asdf;lkj&*()DSFEWR]]{}}}', 'vvvv': [ 1,[4,5],[3,[4,3,[]],444], ],
 'optimization_inputs': b'DATA', 'icam_intrinsics': 0, }
"""


def test_other_ways_to_write_a_model() -> None:
    """Older and newer key names, comments, tuples, extra keys and megabytes of observations are all fine."""
    camera = FORMATS["mrcal"].read(OTHERS.replace("DATA", "{}[](),#" * 1_000_000), "m", None).camera
    assert camera.params.tolist() == [500, 501, 320, 240, -0.25, 0.0625, 0, -0.002, 0.5]
    assert camera.image_size == (640, 480)


def test_lenses_of_mrcal_that_are_not_ours() -> None:
    """They are refused with mrcal's own remedy; rays that do not meet in a point, and names of no surface, as such."""
    for name, rule in (
        ("LENSMODEL_LONLAT", "first run mrcal-convert-lensmodel with one of LENSMODEL_PINHOLE, LENSMODEL_OPENCV5"),
        ("LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=30_Ny=20_fov_x_deg=170", "has 9 numbers; it must have 1204"),
        ("LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=3_Ny=20_fov_x_deg=170", "Nx and Ny must be more than 3"),
        ("LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=900_Ny=900_fov_x_deg=170", "their product at most 10000"),
        ("LENSMODEL_SPLINED_STEREOGRAPHIC_order=4", "must be LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=30"),
        ("LENSMODEL_CAHVORE_linearity=0.4", "has 9 numbers; it must have 12"),
        ("LENSMODEL_CAHVORE_linearity=nan", "linearity 'nan': must be a number"),
    ):
        with pytest.raises(InputError, match=rule):
            FORMATS["mrcal"].read(OTHERS.replace("DISTORTION_OPENCV5", name), "m", None)
    moving = OTHERS.replace("DISTORTION_OPENCV5", "LENSMODEL_CAHVORE_linearity=0").replace("5e-1,", "0, 0, 1e-3, 0")
    with pytest.raises(InputError, match="its rays do not meet in a point"):
        FORMATS["mrcal"].read(moving, "m", None)
    with pytest.raises(InputError, match="intrinsics has 9 numbers; it must have 8"):
        FORMATS["mrcal"].read(OTHERS.replace("OPENCV5", "OPENCV4"), "m", None)


def test_a_surface_goes_on_beyond_an_image_circle() -> None:
    """As the camera's model does, as far as it reaches: what is read back is the camera, not how a spline runs away."""
    camera = replace(lens_camera("ros", "equidistant"), field_rad=np.radians(150))
    back = FORMATS["mrcal"].read(text_of("mrcal", camera, "LENSMODEL_SPLINED_STEREOGRAPHIC"), "m", None)
    assert back.refit is not None
    assert back.refit.max_px < 0.05
