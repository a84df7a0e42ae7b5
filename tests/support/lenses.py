"""Cameras of every model in the registry, and of lenses of many shapes."""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from calib.cameras import ABILITIES, MODELS
from calib.cameras.camera import Camera
from calib.cameras.spline import COLUMNS, ROWS
from designer.base.arrays import Array
from tests.support.solver_scenes import SIZE as LARGE
from tests.support.virtual_scenes import fisheye_map, virtual_camera, wavy_map

SIZE = (1000, 800)
SLIGHT = {"px": 1.0, "1": 0.01, "rad": 0.01}
"""By unit, the parameters of a slight lens."""


def slight(model: str) -> Camera:
    """A camera whose parameters beyond the linear ones are small, of a model that is known by its line alone."""
    rest = [parameter.neutral + SLIGHT[parameter.unit] for parameter in MODELS[model].parameters[4:]]
    if ABILITIES[model].is_learned:
        return Camera(model, np.array([2500.0, 2510.0, 1230.0, 1010.0, *rest]), LARGE, wavy_map(0.02))
    return Camera(model, np.array([900.0, 880.0, 510.0, 390.0, *rest]), SIZE)


def bent(seed: int = 0, size_px: float = 6.0) -> Camera:
    """A spline with random control points."""
    control = size_px * np.random.default_rng(seed).standard_normal(2 * ROWS * COLUMNS)
    return Camera("spline", np.concatenate([[900.0, 880.0, 510.0, 390.0], control]), SIZE)


_CONVENTIONAL = {
    "without lens": ("opencv", (900.0, 880, 510, 390, 0, 0, 0, 0, 0)),
    "barrel": ("opencv", (600.0, 620, 480, 405, -0.3, 0.1, 0.002, -0.001, -0.012)),
    "pincushion": ("opencv", (700.0, 700, 500, 400, 0.2, 0.05, -0.001, 0.003, 0.01)),
    "backward barrel": ("luhmann", (600.0, 610, 490, 400, -0.2, 0.05, -0.01, 0.002, -0.001)),
    "backward pincushion": ("luhmann", (900.0, 910, 490, 400, 0.1, 0.03, 0.01, -0.002, 0.001)),
    "rational barrel": ("opencv8", (300.0, 301, 495, 402, 0.35, 0.08, 0.001, -0.002, 0.002, 0.7, 0.25, 0.01)),
    "rational with a pole": ("opencv8", (600.0, 610, 480, 405, 0.1, 0.02, -0.002, 0.001, 0, -0.3, 0.05, -0.05)),
    "prism": ("opencv12", (600.0, 620, 480, 405, 0.1, 0.02, 0.002, -0.001, 0, 0.4, 0.1, 0, 0.01, -0.004, 0.02, 0.003)),
    "tilted sensor": (
        "opencv14",
        (600.0, 620, 480, 405, 0.1, 0.02, 0.002, -0.001, 0, 0.2, 0.1, 0, 0.01, -0.004, 0.02, 0.003, 0.12, -0.08),
    ),
    "tilted fisheye": (
        "thin_prism_fisheye",
        (330.0, 331, 505, 397, -0.01, 0.004, 0.002, -0.001, -0.006, 0.0012, 0.003, -0.002),
    ),
    "half space": ("fisheye", (330.0, 331.0, 505.0, 397.0, -0.01, 0.004, -0.006, 0.0012)),
    "beyond the half space": ("ds", (260.0, 261.0, 495.0, 402.0, -0.25, 0.57)),
    "wide ellipsoid": ("eucm", (300.0, 300.0, 495.0, 402.0, 0.62, 1.08)),
    "flat ellipsoid": ("eucm", (500.0, 500.0, 495.0, 402.0, 0.3, 0.9)),
    "wide sphere": ("omni", (700.0, 700.0, 495.0, 402.0, 1.4)),
    "wide division": ("division", (330.0, 330.0, 495.0, 402.0, -0.3, 0.02, -0.004)),
    "narrow division": ("division", (900.0, 900.0, 495.0, 402.0, 0.1, 0.0, 0.0)),
}


def conventional(name: str) -> Camera:
    """A camera whose lens is a formula."""
    model, params = _CONVENTIONAL[name]
    return Camera(model, np.array(params), SIZE)


LENSES: Mapping[str, Callable[[], Camera]] = {
    **{name: partial(conventional, name) for name in _CONVENTIONAL},
    "any surface": bent,
    "learned fisheye": lambda: virtual_camera(fisheye_map()),
    "learned in a part of the image": lambda: virtual_camera(wavy_map(0.02, span=(0.3, 0.7))),
    **{f"slight {model}": partial(slight, model) for model in MODELS},
}
"""Made by the tests that ask for them, as maps are learned by kernels whose compilation takes many seconds."""


def pixels(camera: Camera, count: int = 2000, seed: int = 0) -> Array:
    """Pixels all over the image and a little beyond."""
    return np.random.default_rng(seed).uniform([-2, -2], np.array(camera.image_size) + 2.0, (count, 2))
