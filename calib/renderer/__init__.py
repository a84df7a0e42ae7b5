"""Synthetic photos of targets: ray-traced, with known truth.

The names are loaded when they are used: who reads a `truth.json` renders nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calib.renderer.options import RenderOptions
    from calib.renderer.view import View, render_view

__all__ = ["RenderOptions", "View", "render_view"]


def __getattr__(name: str) -> object:
    """A name of `__all__`, from the module that has it."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = "options" if name == "RenderOptions" else "view"
    return getattr(import_module(f"{__name__}.{module}"), name)
