"""Small two-filament targets for tests, made as the command makes them, and what else may be asked of them."""

from collections.abc import Callable, Iterable, Mapping
from functools import cache

from hypothesis import strategies as st

from designer.builds.design import Design
from designer.formats.project import PlateFiles, plate_files
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import parse_spec
from designer.make.mesh import Mesh
from designer.spec.build import BUILDS, MOUNTS
from designer.spec.format import FORMATS
from designer.spec.kind import KINDS, kind_named
from designer.spec.options import Asked, options_of
from designer.spec.spec import Job

COARSE = "50um"
"""Chord error of circles: fewer triangles to write, read and slice, and no rule depends on how many there are."""


def asked_for(kind: str, values: Mapping[str, object]) -> Asked:
    """What a person asks for, as typed."""
    return parse_spec({"kind": kind, **values}, "")


def design_of(kind: str, **values: object) -> Design:
    """A target as the command makes it."""
    return Design(size_job(asked_for(kind, values)).job)


SQUARE = ((-1, -1), (1, -1), (1, 1), (-1, 1))
SMALL: Mapping[str, Mapping[str, object]] = {
    "ico": {"edge": "20mm"},
    "board": {"size": "60x60mm", "thickness": "4mm", "ring_diameter": "7mm", "pitch": "10mm", "columns": 5, "rows": 5},
    "cube": {"edge": "28mm"},
    "octahedron": {"edge": "24mm"},
    "tetrahedron": {"edge": "36mm"},
    "dodecahedron": {"edge": "14mm"},
    "dome": {"edge": "20mm"},
    "corner": {"edge": "30mm"},
    "solid": {
        "vertices": [[x * half, y * half, z] for half, z in ((13, -10), (8, 10)) for x, y in SQUARE],
        "faces": [[4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]],
        "bare_faces": [[3, 2, 1, 0]],
    },
    "coupon": {},
}
"""A few rings of each kind."""


@cache
def small(kind: str) -> Design:
    """A small target of a kind, as the command makes it."""
    return design_of(kind, **{"chord_error": COARSE, **SMALL[kind]})


@cache
def small_ico(nozzle_mm: float = 0.4) -> Design:
    """`design ico --edge 20mm`, and the same for a finer nozzle in its scale: 15 rings a face, 300 in all."""
    return design_of("ico", edge=f"{50 * nozzle_mm:g}mm", nozzle=f"{nozzle_mm}mm", chord_error=COARSE)


def small_board() -> Design:
    """A board of 5 x 5 rings with a line of text, 60 x 60 x 4 mm."""
    return small("board")


def ink_of(design: Design) -> Mesh:
    """The ink of a two-filament design."""
    assert design.part.ink is not None
    return design.part.ink


def packages_of(design: Design) -> PlateFiles:
    """The design's 3MF packages."""
    job = design.job
    return plate_files(design.plates[0], job.printing)


def step_in_place(_: str, job: Job) -> Callable[[], bytes]:
    """Stands for `designer.builds.design.apart`, whose process takes four seconds to load the CAD kernel."""
    from designer.make.cad import step_bytes

    design = Design(job)
    return lambda: step_bytes(job.target, design.printed_pattern, job.printing, name=job.name, scale=design.scale)


PLAUSIBLE: Mapping[str, st.SearchStrategy[object]] = {
    "nozzle": st.sampled_from(["0.2mm", 0.4]),
    "line_width": st.floats(0.3, 0.9),
    "layer_height": st.floats(0.05, 0.16),
    "edge": st.floats(15, 300),
    "mesh": st.just("none.stl"),
    "unit": st.sampled_from(["mm", "inch"]),
    "corners": st.just(SMALL["solid"]["vertices"]),
    "marks": st.sampled_from(["chessboard", "charuco", "aprilgrid", "circles"]),
    "counts": st.builds("{}x{}".format, st.integers(2, 9), st.integers(2, 9)),
    "dictionary": st.sampled_from(["5x5_100", "DICT_APRILTAG_36h11"]),
    "number": st.integers(0, 20),
    "polygons": st.just(SMALL["solid"]["faces"]),
    "bare_faces": st.just(SMALL["solid"]["bare_faces"]),
    "size": st.builds("{}x{}mm".format, st.floats(50, 400), st.floats(50, 400)),
    "name": st.from_regex(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}", fullmatch=True),
    "file": st.sampled_from(["prusa-mk4", "bambu-a1-mini"]),
    "length": st.floats(-0.2, 0.2),
    "length above 0": st.floats(0.1, 12),
    "length from 0": st.floats(0, 5),
    "chord error": st.floats(0.0005, 0.5),
    "bed": st.just("30.5x40x30cm"),
    "machine": st.fixed_dictionaries({"jerk_mm_s": st.floats(1, 20)}),
    "count": st.integers(3, 12),
    "ratio": st.floats(0.2, 0.8),
    "percent": st.floats(-20, 20),
    "skew": st.tuples(*[st.floats(-2, 2)] * 3).map("xy {0[0]}deg, xz {0[1]}deg, yz {0[2]}deg".format),
    "colour": st.from_regex(r"#[0-9a-fA-F]{6}", fullmatch=True),
    "build": st.sampled_from([*BUILDS]),
    "lattice": st.sampled_from(["square", "triangular"]),
    "formats": st.lists(st.sampled_from([*FORMATS]), max_size=3),
    "page": st.sampled_from(["A4", "Letter", "fit", "400.25x600mm"]),
    "switch": st.booleans(),
    "price": st.floats(0, 100),
    "ink side": st.sampled_from(["down", "up"]),
    "mount": st.sampled_from([*MOUNTS, "none"]),
}
"""Values of options by their names, or by what they take."""


@st.composite
def wishes(draw: st.DrawFn, kinds: Iterable[str] = KINDS, *names: str) -> tuple[str, dict[str, object]]:
    """A kind, and values of a small target with up to four other options: any, some of the named, or the one named."""
    kind = draw(st.sampled_from([*kinds]))
    options, values = options_of(kind_named(kind).asked), dict[str, object](SMALL[kind])
    of_kind = [name for name in options if not names or name in names]
    for name in of_kind if len(names) == 1 else draw(st.lists(st.sampled_from(of_kind), max_size=4, unique=True)):
        values[name] = draw(PLAUSIBLE.get(name, PLAUSIBLE[options[name].value]))
    return kind, values
