"""Synthetic photos of targets: ray-traced, with known truth."""

from calib.render.options import RenderOptions
from calib.render.view import View, render_view

__all__ = ["RenderOptions", "View", "render_view"]
