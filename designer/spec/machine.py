"""How a printer moves, melts and changes its filament: what time, filament and fits follow from.

The defaults are those of a printer that nothing is known of (`templates/printers/generic.toml`): a machine of 2023 or
later at moderate settings, every number an assumption. A printer's file says its own, each with a source.
"""

import math
from dataclasses import dataclass
from typing import Annotated

from designer.base.marks import LEFT_OUT, Above, AtLeast, AtMost, Length

BRIM_MM = 5.0
"""Free around a part on the bed: the usual width of a brim in slicers."""
TOWER_DEPTH_MM = 35.0
"""Free beside a large flat part: 400 mm³ of purge in a layer of 0.2 mm cover 60 x 33 mm of a prime tower."""
Speed = Annotated[float, Above(0), AtMost(2000)]
Acceleration = Annotated[float, Above(0), AtMost(100_000)]
Seconds = Annotated[float, AtLeast(0), AtMost(7200)]
Purge = Annotated[float, AtLeast(0), AtMost(5000)]
Flow = Annotated[float, Above(0), AtMost(200)]
PlateSide = Annotated[float, Above(0), AtMost(5000)]
Layers = Annotated[int, AtLeast(0), AtMost(10_000)]
Place = Annotated[float, AtLeast(0), AtMost(5000)]
Area = tuple[Place, Place, Place, Place]
"""A rectangle of the bed, in mm from its front left corner: left, front, right, rear."""


@dataclass(frozen=True)
class Speeds:
    """How fast the nozzle moves along each kind of line, in mm/s."""

    outer_wall_mm_s: Speed = 120.0
    inner_wall_mm_s: Speed = 180.0
    infill_mm_s: Speed = 200.0
    solid_infill_mm_s: Speed = 180.0
    top_mm_s: Speed = 120.0
    bridge_mm_s: Speed = 50.0  # over sparse infill; Bambu Studio's and OrcaSlicer's profiles of all these printers
    first_layer_mm_s: Speed = 40.0
    travel_mm_s: Speed = 300.0


@dataclass(frozen=True)
class Accelerations:
    """How fast it gets there, in mm/s²."""

    outer_wall_mm_s2: Acceleration = 3000.0
    inner_wall_mm_s2: Acceleration = 4000.0
    infill_mm_s2: Acceleration = 5000.0
    solid_infill_mm_s2: Acceleration = 5000.0
    top_mm_s2: Acceleration = 2000.0
    first_layer_mm_s2: Acceleration = 500.0
    travel_mm_s2: Acceleration = 7000.0


@dataclass(frozen=True)
class FilamentChange:
    """From one filament to the other."""

    time_s: Seconds = 40.0  # all of it but the purge
    purge_to_ink_mm3: Purge = 140.0
    purge_to_body_mm3: Purge = 280.0  # dark before light needs more
    purge_flow_mm3_s: Flow = 10.0  # at full speed
    is_tool_changer: bool = False  # each filament has a nozzle of its own
    has_tower: bool = True  # what is purged, or primed, is printed as a tower beside the part
    most_on_tower_mm3: Purge = 5000.0  # of one purge; the rest falls down a chute


@dataclass(frozen=True)
class Shells:
    """The slicer's settings that decide on filament."""

    walls: Layers = 3
    bottom_layers: Layers = 4
    top_layers: Layers = 5
    infill: Annotated[float, AtLeast(0), AtMost(1)] = 0.15

    def words(self, layers: float = math.inf) -> str:
        """Of a part with so many layers."""
        if layers <= self.bottom_layers + self.top_layers:
            return f"{self.walls} walls, all layers solid"
        return (
            f"{self.walls} walls, {self.bottom_layers} solid layers below and {self.top_layers} above, "
            f"{100 * self.infill:g} % infill"
        )


@dataclass(frozen=True)
class Presets:
    """What Bambu Studio and OrcaSlicer both call a printer, and their own settings for it."""

    nozzle_mm: Annotated[float, Above(0), AtMost(10)]  # the nozzle that they are for
    plate_mm: tuple[PlateSide, PlateSide]  # width and depth of a plate, as they draw it
    model: str
    printer: str
    process: str
    filament: str
    plate_type: str  # that the printer comes with


@dataclass(frozen=True)
class Machine:
    """All of it."""

    speeds: Speeds = Speeds()
    accelerations: Accelerations = Accelerations()
    change: FilamentChange = FilamentChange()
    shells: Shells = Shells()
    presets: Annotated[Presets | None, LEFT_OUT] = None  # None: not known, or not the same in both
    flow_mm3_s: Flow = 12.0  # the most that the nozzle melts
    jerk_mm_s: Speed = 9.0  # by how much the speed may jump at a corner
    retraction_s: Seconds = 0.1  # to pull filament back before a travel and to push it on again
    least_layer_s: Seconds = 5.0  # a layer that takes less is printed slower, to cool
    start_s: Seconds = 300.0  # heating, homing and levelling, before the first layer
    clearance_mm: Annotated[float, AtLeast(0), AtMost(2)] = 0.15  # between printed parts that are put into each other
    excluded_mm: Annotated[tuple[Area, ...], Length(0, 8)] = ()  # of the bed: where nothing may be printed


UNKNOWN_MACHINE = Machine()
"""Of a printer that nothing is known of."""
