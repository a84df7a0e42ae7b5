"""SVG for lasers: what is engraved as black areas, what is cut as red hairlines; user units are millimetres."""

from designer.formats.dxf import STOCK, layer_steps
from designer.formats.svg import area_path, decimal, polygon_path
from designer.make.pages import CUT, ENGRAVE, LABEL, Cutting
from designer.target import TargetGeometry

STYLES = {
    ENGRAVE: 'fill="#000000" fill-rule="evenodd" stroke="none"',
    CUT: 'fill="none" stroke="#ff0000" stroke-width="0.01"',
    LABEL: 'fill="none" stroke="#0000ff" stroke-width="0.01"',
}
"""Colours by which LightBurn and the drivers of engravers tell operations apart."""


def steps(files: str, target: TargetGeometry, suffix: str) -> tuple[str, ...]:
    """What to do with the file.

    Args:
        files: their names, a sheet each.
        target: what is cut and engraved.
        suffix: of the format.
    """
    return (
        f"Open {files} in LightBurn, or print it from Inkscape to the laser's driver: it is in millimetres.",
        *layer_steps(target, "red hairlines", "black areas", "blue hairlines"),
        *STOCK,
    )


def laser_svg_bytes(cutting: Cutting) -> bytes:
    """A sheet as SVG at its true size; the same sheet gives the same bytes. Letters are outlines, circles are arcs."""
    height = cutting.height_mm
    engraved = "".join(area_path(area, height) for area in cutting.engrave)  # one path: even-odd counts all of it
    paths = {ENGRAVE: [engraved]} | {name: [polygon_path(one, height) for one in some] for name, some in cutting.lines}
    size = decimal(cutting.width_mm), decimal(height)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<svg xmlns="http://www.w3.org/2000/svg" xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"',
        f'     version="1.1" width="{size[0]}mm" height="{size[1]}mm" viewBox="0 0 {size[0]} {size[1]}">',
    ]
    for name, style in STYLES.items():
        lines.append(f'<g id="{name}" inkscape:groupmode="layer" inkscape:label="{name}" {style}>')
        lines += [f'<path d="{path}"/>' for path in paths[name]]
        lines.append("</g>")
    return "\n".join([*lines, "</svg>\n"]).encode()
