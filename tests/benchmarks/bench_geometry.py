"""Times the geometry stage against CAD and boolean routes to the same solid, and the whole command.

Run from the repository's root: `python tests/benchmarks/bench_geometry.py`. It prints a table; the goals are
those of the design: the geometry stage 50 times faster than CAD, the command at most 3 s, half of it imports,
`design --help` at most 0.5 s.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from manifold3d import CrossSection, Manifold, OpType

from designer.kinds.ico import IcoSpec, icosahedron
from designer.kinds.layout import lay_out
from designer.make.mesh import Part, inlaid, solid_hull
from designer.make.pattern import Pattern, make_pattern
from designer.spec.spec import PrinterProfile, PrintSpec

EDGE_MM, INLAY_MM = 100.0, 1.0
SPEC = IcoSpec(EDGE_MM, 8, 7.0, 0.45, 10.0, 2.0, 3.0)
PRINTER = PrinterProfile("bambu-p1s", (256.0, 256.0, 256.0), 0.4, 0.45, 0.2)
PRINTING = PrintSpec("one-piece", PRINTER, INLAY_MM, 0.0, 0.0, 0.0, "#ffffff", "#000000", True, False, 0.005)


def best_of(times: int, work: Callable[[], object]) -> float:
    """The shortest of several durations, in seconds: the one least disturbed by other processes."""
    durations = []
    for _ in range(times):
        start = time.perf_counter()
        work()
        durations.append(time.perf_counter() - start)
    return min(durations)


def pattern() -> Pattern:
    return make_pattern(lay_out(SPEC), PRINTING)


def mesh_route() -> Part:
    """The geometry stage of the command, from the spec on."""
    ink = pattern()
    return inlaid(ink, solid_hull(ink, SPEC.solid, INLAY_MM), INLAY_MM)


def cad_route() -> float:
    """True circles and one boolean cut in build123d, from the spec on. Returns the ink's volume."""
    from designer.make.cad import inlaid_solids

    return sum(solid.volume for solid in inlaid_solids(SPEC, pattern(), INLAY_MM).ink)


def manifold_route() -> tuple[Manifold, Manifold]:
    """The same polygons as the geometry stage, set in by mesh booleans: body and ink."""
    ink = pattern()
    solid, larger, core = (
        Manifold.hull_points((EDGE_MM + depth / icosahedron().inradius) * icosahedron().vertices)
        for depth in (0, INLAY_MM, -INLAY_MM)
    )
    # Cutters stand out of the surface, so that no two faces coincide.
    stamps = [Manifold.extrude(CrossSection(list(s.contours)), 2 * INLAY_MM) for s in ink.stamps]
    windows, marks = [], []
    for face, frame in zip(ink.faces, ink.target_from_face, strict=True):
        below = frame[:3] @ np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, -INLAY_MM], [0, 0, 0, 1.0]])
        assert face.window is not None
        windows.append(Manifold.extrude(CrossSection([face.window[::-1]]), 3 * INLAY_MM).transform(below))
        marks += [
            stamps[row].translate((x, y, 0)).transform(below)
            for row, (x, y) in zip(face.stamp, face.position_mm.tolist(), strict=True)
        ]
    border = larger - Manifold.batch_boolean([core, *windows], OpType.Add)
    ink_solid, body = solid.split(Manifold.batch_boolean([border, *marks], OpType.Add))
    assert body.num_tri() > 0  # booleans are lazy until asked
    assert ink_solid.num_tri() > 0
    return body, ink_solid


def command(*arguments: str) -> float:
    """Duration of a `design` command, in seconds."""
    start = time.perf_counter()
    subprocess.run([sys.executable, "-m", "designer.cli", *arguments], check=True, capture_output=True)
    return time.perf_counter() - start


def import_seconds(*arguments: str) -> float:
    """How much of a `design` command goes into imports, by `-X importtime` (itself some percent slower)."""
    run = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "designer.cli", *arguments],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    own = [line.split(":", 1)[1].split("|")[0] for line in run.stderr.splitlines() if line.startswith("import time:")]
    return sum(int(text) for text in own if text.strip().isdigit()) / 1e6


def compare_routes() -> None:
    import designer.make.cad  # noqa: F401  # its import is not what is compared

    part = mesh_route()
    assert part.ink is not None
    body, ink = manifold_route()
    np.testing.assert_allclose(cad_route(), part.ink.volume_mm3, rtol=1e-6)
    np.testing.assert_allclose([body.volume(), ink.volume()], [part.body.volume_mm3, part.ink.volume_mm3], rtol=1e-6)
    mesh, cad, booleans = best_of(9, mesh_route), best_of(2, cad_route), best_of(3, manifold_route)
    print(f"icosahedron, edge {EDGE_MM:g} mm, 720 features, inlay {INLAY_MM:g} mm; the same volumes by all routes")
    print(f"  geometry stage            {mesh:8.3f} s   {len(part.body.triangles) + len(part.ink.triangles)} triangles")
    print(f"  build123d booleans        {cad:8.3f} s   {cad / mesh:6.1f} times longer (goal 50)")
    print(f"  manifold3d booleans       {booleans:8.3f} s   {booleans / mesh:6.1f} times longer")


def time_commands() -> None:
    with tempfile.TemporaryDirectory() as folder:
        arguments = ("ico", "--edge", f"{EDGE_MM:g}mm", "-o", str(Path(folder) / "out"))
        whole = best_of(3, lambda: command(*arguments))
        imports = import_seconds(*arguments)
    print(f"  design ico --edge {EDGE_MM:g}mm   {whole:8.2f} s   goal 3 s")
    print(f"    of which imports        {imports:8.2f} s   {imports / whole:6.0%} (goal 50 %)")
    print(f"  design --help             {best_of(5, lambda: command('--help')):8.2f} s   goal 0.5 s")


if __name__ == "__main__":
    compare_routes()
    time_commands()
