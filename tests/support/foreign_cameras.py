"""Cameras to convert, and what the reference programs make of the files."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from calib.cameras import rays
from calib.cameras.camera import Camera
from calib.cameras.refit import image_grid
from calib.interop import FORMATS
from calib.interop.reading import fit_to_format

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


def written(format_name: str, camera: str) -> tuple[Camera, str]:
    """A camera as a format can hold it, and its text."""
    held, _ = fit_to_format(CAMERAS[camera], FORMATS[format_name])
    return held, FORMATS[format_name].write(held)


def whole_image(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (N, 2) all over an image, and the directions (N, 3) seen there."""
    pixel = image_grid(camera.image_size).reshape(-1, 2)
    return pixel, rays(camera, pixel)


def ask_mrcal(code: str, question: object, folder: Path) -> object:
    """The answer of Debian's mrcal, which lives in a Python of its own: `code` sets `answer` from `question`."""
    if (
        not Path(SYSTEM_PYTHON).exists()
        or subprocess.run([SYSTEM_PYTHON, "-c", "import mrcal"], check=False, capture_output=True).returncode
    ):
        pytest.skip("mrcal is missing: install the Debian packages mrcal and python3-mrcal")
    (folder / "question.json").write_text(json.dumps(question))
    program = (
        "import json, mrcal, numpy as np\n"
        f"question = json.load(open({str(folder / 'question.json')!r}))\n{code}\nprint(json.dumps(answer))\n"
    )
    done = subprocess.run([SYSTEM_PYTHON, "-c", program], check=False, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])
