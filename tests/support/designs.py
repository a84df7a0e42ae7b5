"""Small two-filament targets for tests, made as the command makes them."""

from collections.abc import Mapping
from functools import cache

from designer.formats.threemf import ThreeMfFiles, plate_files
from designer.kinds.sizing import size_job
from designer.kinds.spec_file import parse_spec
from designer.make.mesh import Mesh
from designer.produce import Design
from designer.spec.options import Asked

COARSE = "50um"
"""Chord error of circles: fewer triangles to write, read and slice, and no rule depends on how many there are."""


def asked_for(kind: str, values: Mapping[str, object]) -> Asked:
    """What a person asks for, as typed."""
    return parse_spec({"kind": kind, **values}, "")


SMALL: Mapping[str, Mapping[str, object]] = {
    "ico": {"edge": "20mm"},
    "board": {"size": "60x60mm", "thickness": "4mm", "ring_diameter": "7mm", "pitch": "10mm", "columns": 5, "rows": 5},
    "cube": {"edge": "28mm"},
    "coupon": {},
}
"""A few rings of each kind."""


@cache
def small(kind: str) -> Design:
    """A small target of a kind, as the command makes it."""
    return Design(size_job(asked_for(kind, {"chord_error": COARSE, **SMALL[kind]})).job)


@cache
def small_ico(nozzle_mm: float = 0.4) -> Design:
    """`design ico --edge 20mm`, and the same for a finer nozzle in its scale: 15 rings a face, 300 in all."""
    sizes = {"edge": f"{50 * nozzle_mm:g}mm", "nozzle": f"{nozzle_mm}mm", "chord_error": COARSE}
    return Design(size_job(asked_for("ico", sizes)).job)


def small_board() -> Design:
    """A board of 5 x 5 rings with a line of text, 60 x 60 x 4 mm."""
    return small("board")


def ink_of(design: Design) -> Mesh:
    """The ink of a two-filament design."""
    assert design.part.ink is not None
    return design.part.ink


def packages_of(design: Design) -> ThreeMfFiles:
    """The design's 3MF packages."""
    job = design.job
    return plate_files(design.plates[0].pieces, job.printing)
