"""Design of camera-calibration targets: from one size to files that print in two filaments.

>>> target = designer.ico(edge_mm=100)
>>> target.save("exports/ico")
>>> geometry = target.geometry

There is a function for each kind of target. Names are loaded when they are used: `calib` needs a few light ones only.
"""

from importlib import import_module

TYPE_CHECKING = False  # `typing` takes long to load, and Ctrl-C in the meantime leaves a traceback
if TYPE_CHECKING:
    from collections.abc import Callable

    from designer.app.design import DesignedTarget, design, load
    from designer.base.errors import InputError
    from designer.target import TargetGeometry, load_target

    ico: Callable[..., DesignedTarget]
    board: Callable[..., DesignedTarget]
    cube: Callable[..., DesignedTarget]

__all__ = ["DesignedTarget", "InputError", "TargetGeometry", "design", "load", "load_target"]
"""Besides a function for each kind of target, by its name."""

_HOMES = {
    "designer.app.design": ("DesignedTarget", "design", "load"),
    "designer.base.errors": ("InputError",),
    "designer.target": ("TargetGeometry", "load_target"),
}


def __getattr__(name: str) -> object:
    from designer.base.errors import offered

    for home, names in _HOMES.items():
        if name in names:
            globals()[name] = found = offered(getattr(import_module(home), name), __name__)
            return found
    from designer.spec.kind import KINDS

    if name in KINDS:
        from designer.app.design import function_of

        globals()[name] = made = offered(function_of(name), __name__)
        return made
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    from designer.spec.kind import KINDS

    return sorted({*globals(), *__all__, *KINDS})
