"""Synthetic photos of targets: ray-traced, with known truth."""

from calib.renderer.options import RenderOptions
from calib.renderer.view import View, render_view

__all__ = ["RenderOptions", "View", "render_view"]
