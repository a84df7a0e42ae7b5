"""What the sizes of every kind of target have in common: proportions, and what a process can make."""

from collections.abc import Iterable, Iterator

from designer.base.errors import InputError
from designer.base.units import round_down, round_up
from designer.spec.options import Asked
from designer.spec.spec import Line, Spec

DIAMETER_OVER_PITCH = 0.7
"""Of the paper's rings, 7 mm at 10 mm."""


def diameter_and_pitch(asked: Asked) -> tuple[float, float]:
    """Ring diameter and pitch of which at least one is given; the other follows in the paper's proportion."""
    diameter, pitch = asked.ring_diameter, asked.pitch
    if pitch is None:
        if diameter is None:
            raise InputError("neither ring diameter nor pitch is given; give --ring-diameter or --pitch")
        return diameter, round_up(diameter / DIAMETER_OVER_PITCH)
    if diameter is None:
        diameter = round_down(DIAMETER_OVER_PITCH * pitch)
        if diameter == 0:
            raise InputError(f"pitch {pitch:g}mm leaves no stroke that can be made; use a larger pitch")
    return diameter, pitch


def chosen_ring(asked: Asked, spec: Spec) -> Iterator[str]:
    """Diameter or pitch, if it followed from the other."""
    share = f"{DIAMETER_OVER_PITCH:g} of the pitch, as in the paper"
    if asked.ring_diameter is None:
        yield f"rings of {spec.ring_diameter_mm:g}mm ({share})"
    elif asked.pitch is None:
        yield f"pitch {spec.pitch_mm:g}mm (the rings are {share})"


def chosen_words(chosen: Iterable[str]) -> str:
    """A line that says what was not given."""
    parts = tuple(chosen)
    return f"sizes: {', '.join(parts)}; the others as given" if parts else "sizes: as given"


def widths_mm(spec: Spec) -> tuple[float, float, float]:
    """Stroke, white centre and gap between neighbours."""
    diameter = spec.ring_diameter_mm
    return diameter / 2 * (1 - spec.ring_ratio), diameter * spec.ring_ratio, spec.pitch_mm - diameter


def check_rings(diameter: float, ratio: float, pitch: float, line: Line) -> None:
    """Rings must leave white between them, and no stroke, white centre or gap be thinner than the tool that makes it.

    Raises:
        InputError: they do not.
    """
    apart = f"use at least {diameter + line.comfortable_mm:.4g}mm for {line.process}"
    if pitch <= diameter:
        raise InputError(f"pitch {pitch:g}mm makes rings of {diameter:g}mm touch; {apart}")
    widths = (
        ("stroke", diameter / 2 * (1 - ratio), 2 * line.width_mm / (1 - ratio)),
        ("white centre", diameter * ratio, line.width_mm / ratio),
    )
    for what, width, least_diameter in widths:
        if width < line.nozzle_mm - 1e-9:
            raise InputError(
                f"ring diameter {diameter:g}mm gives a {what} of {width:.3g}mm, thinner than {line.process}; "
                f"use rings of at least {least_diameter:.3g}mm"
            )
    if pitch - diameter < line.nozzle_mm - 1e-9:
        gap = f"{pitch - diameter:.3g}mm between rings of {diameter:g}mm"
        raise InputError(f"pitch {pitch:g}mm leaves {gap}, thinner than {line.process}; {apart}")


def check_count(rings: int, line: Line) -> None:
    """Keep hostile sizes from filling the memory.

    Raises:
        InputError: too many rings.
    """
    if rings > line.most_rings:
        raise InputError(f"{rings} rings are more than {line.most_rings}; use a larger pitch or a smaller target")
