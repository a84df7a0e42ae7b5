"""Cameras to convert, and what the reference programs make of the files."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calib.cameras import neutral, parameter_names, rays
from calib.cameras.camera import Camera
from calib.cameras.formats import FORMATS
from calib.cameras.formats.holding import fit_to_format
from calib.cameras.refit import image_grid
from tests.support.programs import run

SIZE = (1024, 768)
CAMERAS = {
    "pinhole": Camera("pinhole", np.array([900.0, 880, 510, 390]), SIZE),
    "barrel": Camera("opencv", np.array([620.0, 600, 508.2, 391.7, -0.3, 0.1, 0.002, -0.0004, -0.012]), SIZE),
    "pincushion": Camera("opencv", np.array([1700.0, 1702, 500, 400, 0.2, 0.05, -0.001, 0.003, 0.01]), SIZE),
    "tiny coefficients": Camera("opencv", np.array([2500.0, 2500, 511, 384, 1e-5, -2e-9, 3e-7, 4e-12, 0]), SIZE),
    "backward": Camera("luhmann", np.array([1900.0, 1910, 490, 400, -0.12, 0.05, -0.01, 0.002, -0.001]), SIZE),
}
"""Of all models that can be written; with fx, fy and with p1, p2 too far apart to be taken for each other."""

CLOSE_PX = 0.01
SYSTEM_PYTHON = "/usr/bin/python3"
"""Debian's mrcal is a package of the system's Python."""


@cache
def written(format_name: str, camera: str) -> tuple[Camera, str]:
    """A camera as a format can hold it, and its text."""
    held = fit_to_format(CAMERAS[camera], FORMATS[format_name])
    return held.camera, FORMATS[format_name].write(held.camera, held.lens)


WIDE_SIZE = (1000, 800)
MODELS = {
    "pinhole": (900.0, 880, 510, 390),
    "opencv": (620.0, 600, 508.2, 391.7, -0.3, 0.1, 0.002, -0.0004, -0.012),
    "opencv8": (600.0, 610, 500, 390, 0.3, 0.05, 0.001, -0.0005, 0.01, 0.5, 0.06, 0.004),
    "opencv12": (600.0, 610, 500, 390, 0.3, 0.05, 0.001, -0.0005, 0.01, 0.5, 0.06, 0.004, 1e-3, -2e-3, 3e-3, 1e-3),
    "opencv14": (
        *(600.0, 610, 500, 390, 0.3, 0.05, 0.001, -0.0005, 0.01, 0.5, 0.06, 0.004, 1e-3, -2e-3, 3e-3, 1e-3),
        *(0.05, -0.03),
    ),
    "opencv_skew": (620.0, 600, 508.2, 391.7, -0.3, 0.1, 0.002, -0.0004, -0.012, 2.5),
    "fisheye": (330.0, 331.0, 505.0, 397.0, -0.01, 0.004, -0.006, 0.0012),
    "thin_prism_fisheye": (330.0, 331.0, 505.0, 397.0, -0.01, 0.004, 0.002, -0.001, -0.006, 0.0012, 0.001, 0.002),
    "ds": (260.0, 261.0, 495.0, 402.0, -0.25, 0.57),
    "eucm": (310.0, 311.0, 495.0, 402.0, 0.6, 1.08),
    "omni": (700.0, 701.0, 495.0, 402.0, 1.4),
    "division": (400.0, 401.0, 495.0, 402.0, -0.2, 0.02, -0.004),
}
"""A camera of each model that a format holds, wide ones beyond the half space."""


def lenses_of(format_name: str) -> list[str]:
    """The names of the lenses that a format writes, of models that are ours."""
    return [name for name, lens in FORMATS[format_name].written.items() if lens.model is not None]


def lens_camera(format_name: str, name: str) -> Camera:
    """A camera that a lens of a format holds; what the lens has no place for is as without a lens."""
    lens = FORMATS[format_name].written[name]
    assert lens.model is not None
    names, none = parameter_names(lens.model), neutral(lens.model)
    params = np.array(MODELS[lens.model])
    return Camera(lens.model, np.where(np.isin(names, lens.cannot_hold), none, params), WIDE_SIZE)


def text_of(format_name: str, camera: Camera, lens: str | None = None) -> str:
    """A camera's file, by one of the format's lenses."""
    held = fit_to_format(camera, FORMATS[format_name], lens=lens)
    return FORMATS[format_name].write(held.camera, held.lens)


def ahead(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """As `whole_image`, where light comes from well before the camera, as reference programs have it."""
    pixel, ray = whole_image(camera)
    front = ray[:, 2] > 0.1
    assert front.sum() > 500
    return pixel[front], ray[front]


def whole_image(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) all over an image, and the directions (N, 3) seen there."""
    pixel = image_grid(camera.image_size).reshape(-1, 2)
    return pixel, rays(camera, pixel)


@cache
def has_mrcal() -> bool:
    """Whether Debian's mrcal is there, which lives in a Python of its own."""
    return Path(SYSTEM_PYTHON).exists() and not run(SYSTEM_PYTHON, "-c", "import mrcal", check=False).returncode


def ask_mrcal(code: str, question: object, folder: Path) -> object:
    """The answer of mrcal: `code` sets `answer` from `question`."""
    if not has_mrcal():
        pytest.skip("mrcal is missing: install the Debian packages mrcal and python3-mrcal")
    (folder / "question.json").write_text(json.dumps(question))
    program = (
        "import json, mrcal, numpy as np\n"
        f"question = json.load(open({str(folder / 'question.json')!r}))\n{code}\nprint(json.dumps(answer))\n"
    )
    done = run(SYSTEM_PYTHON, "-c", program, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])
