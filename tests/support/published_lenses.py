"""Wide lenses as their authors publish them, in terms of angles where the program has none, for checks of files."""

from collections.abc import Callable, Mapping

import numpy as np

Values = Mapping[str, float]


def kannala_brandt(ray: np.ndarray, values: Values) -> np.ndarray:
    """Kannala and Brandt 2006, equation 6: odd powers of the angle off the axis, along the direction about it."""
    angle, about = np.arccos(ray[:, 2]), np.arctan2(ray[:, 1], ray[:, 0])
    radius = angle + sum(values[f"k{k}"] * angle ** (2 * k + 1) for k in range(1, 5))
    return radius[:, None] * np.column_stack([np.cos(about), np.sin(about)])


def unified(ray: np.ndarray, values: Values) -> np.ndarray:
    """Mei and Rives 2007, equations 1 to 4: onto the sphere, and from a point xi above its middle."""
    return ray[:, :2] / (ray[:, 2:] + values["xi"])


def extended_unified(ray: np.ndarray, values: Values) -> np.ndarray:
    """Khomutenko, Garcia and Martinet 2016, equation 7."""
    x, y, z = ray.T
    rho = np.sqrt(values["beta"] * (x**2 + y**2) + z**2)
    return np.column_stack([x, y]) / (values["alpha"] * rho + (1 - values["alpha"]) * z)[:, None]


def double_sphere(ray: np.ndarray, values: Values) -> np.ndarray:
    """Usenko, Demmel and Cremers 2018, equations 40 to 42, of rays of length one."""
    on_second = ray + np.array([0, 0, values["xi"]])
    distance = np.linalg.norm(on_second, axis=1)
    return ray[:, :2] / (values["alpha"] * distance + (1 - values["alpha"]) * on_second[:, 2])[:, None]


PUBLISHED: Mapping[str, Callable[[np.ndarray, Values], np.ndarray]] = {
    "pinhole": lambda ray, _: ray[:, :2] / ray[:, 2:],
    "fisheye": kannala_brandt,
    "omni": unified,
    "eucm": extended_unified,
    "ds": double_sphere,
}


def published(model: str, ray: np.ndarray, values: Values) -> np.ndarray:
    """Pixels (N, 2) of rays (N, 3) of length one, with fx fy cx cy."""
    return PUBLISHED[model](ray, values) * [values["fx"], values["fy"]] + [values["cx"], values["cy"]]
