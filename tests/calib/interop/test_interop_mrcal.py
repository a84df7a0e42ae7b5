"""mrcal's camera models against mrcal."""

from pathlib import Path

import numpy as np
import pytest

from calib.interop import FORMATS
from designer.base.errors import InputError
from tests.support.foreign_cameras import CAMERAS, SIZE, ask_mrcal, whole_image, written

PROJECT = """
answer = []
for path, ray in question:
    model = mrcal.cameramodel(path)
    assert tuple(model.imagersize()) == (1024, 768)
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


def test_mrcal_reads_what_is_written(tmp_path: Path) -> None:
    """Mrcal reads every camera, and sees its rays in its pixels."""
    question, pixels = [], []
    for index, camera in enumerate(CAMERAS):
        held, text = written("mrcal", camera)
        (tmp_path / f"{index}.cameramodel").write_text(text)
        pixel, ray = whole_image(held)
        question.append([str(tmp_path / f"{index}.cameramodel"), ray.tolist()])
        pixels.append(pixel)
    seen = np.array(ask_mrcal(PROJECT, question, tmp_path))
    assert np.abs(seen - np.array(pixels)).max() < 1e-9


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
    """A splined model is refused with mrcal's own remedy."""
    for name in ("LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=30_Ny=20_fov_x_deg=170", "LENSMODEL_CAHVOR"):
        with pytest.raises(InputError, match="first run mrcal-convert-lensmodel LENSMODEL_OPENCV5"):
            FORMATS["mrcal"].read(OTHERS.replace("DISTORTION_OPENCV5", name), "m", None)
    with pytest.raises(InputError, match="intrinsics has 9 numbers; it must have 8"):
        FORMATS["mrcal"].read(OTHERS.replace("OPENCV5", "OPENCV4"), "m", None)
