"""Files for lasers, cutters and board houses, read by the programs of others: how far centres are from the design.

Run from the repository's root: `python -m tests.benchmarks.bench_flat_formats`. DXF by ezdxf, SVG by
svgelements, Gerber by PyGerber; and what the files weigh. The goal: centres within 1 um.
"""

import io
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import svgelements
from scipy.spatial import cKDTree

import designer
from designer.builds.design import Design
from designer.make.pages import cuttings
from tests.designer.formats.test_flat_formats import Array, circles, content_of, dxf_of, flashes, gerbers_of, ring_of


def main() -> None:
    """Print a line a file."""
    warnings.filterwarnings("ignore")
    flat = ("dxf", "laser", "gerber", "gerber-mask")
    for kind, made in (
        ("board 220 mm", designer.board(size_mm=(220, 220), build="sheet", formats=flat)),
        ("ico 100 mm", designer.ico(edge_mm=100, build="stickers", formats=flat[:2], page="fit")),
    ):
        design = made.design
        (sheet,) = cuttings(design.pages)
        told = np.array([(*circle.centre_mm, circle.radius_mm) for area in sheet.engrave for circle in area.circles])
        _say(kind, "DXF", "dxf", design, told, lambda design: circles(dxf_of(design)))
        _say(kind, "laser SVG", "laser.svg", design, told, _svg_circles)
        for name, ink in (("gerber", ".gto"), ("gerber-mask", ".gts")):
            if name in design.job.formats:
                _say_gerber(kind, name, ink, design)


def _say(kind: str, title: str, suffix: str, design: Design, told: Array, read: Callable[[Design], Array]) -> None:
    begin = time.perf_counter()
    content = content_of(design, suffix)
    made_s = time.perf_counter() - begin
    seen = read(design)
    size, worst = len(content) / 1e6, _worst_um(seen, told)
    print(f"{kind:13} {title:11} {size:5.2f} MB  {worst:.4f} um  ({made_s:.1f} s for all files)")


def _svg_circles(design: Design) -> Array:
    drawing = svgelements.SVG.parse(io.BytesIO(content_of(design, "laser.svg")), ppi=25.4)
    found = []
    for path in drawing.elements(lambda element: isinstance(element, svgelements.Path) and element.fill == "#000000"):
        for part in path.as_subpaths():
            piece = svgelements.Path(part)
            if any(isinstance(step, svgelements.Arc) for step in piece):
                left, top, right, bottom = piece.bbox()
                found.append(((left + right) / 2, float(drawing.height) - (top + bottom) / 2, (right - left) / 2))
    return np.array(found)


def _say_gerber(kind: str, name: str, ink: str, design: Design) -> None:
    target = design.target
    told = np.column_stack([target.center_mm[:, :2] - target.outline_mm[0].min(axis=0), target.radius_outer_mm])
    with TemporaryDirectory() as place:
        seen = np.array([ring_of(flash) for flash in flashes(gerbers_of(design, f"{name}.zip", Path(place))[ink])])
    size = len(content_of(design, f"{name}.zip")) / 1e6
    print(f"{kind:13} {name:11} {size:5.2f} MB  {_worst_um(seen[:, :3] * [1, 1, 0.5], told):.4f} um")


def _worst_um(seen: Array, told: Array) -> float:
    """The largest distance of place and radius, one for one."""
    assert len(seen) == len(told)
    return 1000 * float(cKDTree(seen).query(told)[0].max())


if __name__ == "__main__":
    main()
