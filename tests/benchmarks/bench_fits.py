"""Every tile of a solid over every seat in every turn, and in and out of its own, by mesh booleans.

    python -m tests.benchmarks.bench_fits              # some minutes: icosahedron and cube, edges of 100 and 45 mm

Prints how many tiles go into a seat (one each is wanted), the least overlap of those that do not, and what overlaps
while a tile goes in last (nothing is wanted).
"""

import itertools
import sys

import numpy as np
from manifold3d import Manifold

from designer.make.assembly import Assembly
from designer.make.mesh import placed, solid_of
from tests.designer.make.test_assembly import NOTHING_MM3, assembly_of, beside, in_place

OUT_MM = (0.0, 0.05, 0.5, 2.0, 4.0, 8.0)


def main() -> int:
    """Print two lines per solid."""
    is_good = True
    for kind, edge_mm in itertools.product(("ico", "cube"), (100.0, 45.0)):
        assembly = assembly_of(kind, edge_mm)
        fitting, least, count = over_all_seats(assembly)
        own = [(seat, seat, 0) for seat in range(len(assembly.tiles))]
        print(f"{kind} {edge_mm:g}mm: {len(fitting)} of {count} go in, own seats alone: {fitting == own}; ", end="")
        print(f"least overlap of the others {least:.2f} mm3", flush=True)
        worst = max(overlap_on_its_way(assembly, face) for face in range(len(assembly.tiles)))
        print(f"  most overlap of a tile that goes in last: {worst:.2g} mm3", flush=True)
        is_good &= fitting == own and worst < NOTHING_MM3
    return 0 if is_good else 1


def over_all_seats(assembly: Assembly) -> tuple[list[tuple[int, int, int]], float, int]:
    """Tile, seat and turn of those that go in; the least overlap of the others; and how many were tried."""
    sides, back = assembly.solid.polyhedron.sides, -assembly.sizes.thickness_mm
    pins = [solid_of(tile.body).trim_by_plane((0.0, 0.0, -1.0), -back - 1.0) for tile in assembly.tiles]
    fitting, least, count = [], np.inf, 0
    for seat, frame in enumerate(assembly.target_from_tile):
        part = next(part for part in assembly.core if seat in part.seats)
        local = placed(part.solid, np.linalg.inv(frame)).trim_by_plane((0.0, 0.0, 1.0), back - 5.0)
        for tile, turn in itertools.product(range(len(pins)), range(sides)):
            overlap = (pins[tile].rotate((0.0, 0.0, 360.0 * turn / sides)) ^ local).volume()
            count += 1
            if overlap < NOTHING_MM3:
                fitting.append((tile, seat, turn))
            else:
                least = min(least, overlap)
    return sorted(fitting), least, count


def overlap_on_its_way(assembly: Assembly, face: int) -> float:
    """With core and all other tiles about it in place, along its normal."""
    around: list[Manifold] = [in_place(assembly, other) for other in beside(assembly, face)]
    around += [part.solid for part in assembly.core]
    return max((in_place(assembly, face, out_mm) ^ other).volume() for out_mm in OUT_MM for other in around)


if __name__ == "__main__":
    sys.exit(main())
