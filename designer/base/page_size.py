"""Sizes of paper."""

from designer.base.errors import InputError
from designer.base.units import parse_lengths_mm

PAGE_SIZES_MM = {"A4": (210.0, 297.0), "A3": (297.0, 420.0), "Letter": (215.9, 279.4)}
MARGIN_MM = 10.0
"""What a printer may leave white along the paper's edges."""
SCALE_BAR_MM = 100.0
MIN_PAGE_MM = (SCALE_BAR_MM + 2 * MARGIN_MM, 60.0)
MAX_PAGE_MM = 5000.0
"""PDF readers stop at 14400 points, which is 5080 mm."""


def page_size_mm(page: str) -> tuple[float, float] | None:
    """Width and height of a page: "A4", "A3", "Letter" or "WIDTHxHEIGHTmm"; None for "fit".

    Raises:
        InputError: another text, a size that is not finite, too small for the scale bar, or absurdly large.
    """
    if page.casefold() == "fit":
        return None
    for known, size in PAGE_SIZES_MM.items():
        if page.casefold() == known.casefold():
            return size
    try:
        width, height = parse_lengths_mm(page, 2)
    except ValueError as error:
        rule = f"use {', '.join(PAGE_SIZES_MM)}, fit or WIDTHxHEIGHTmm such as 400x600mm"
        raise InputError(f"page {page!r}: {error}; {rule}") from None
    wide, low = MIN_PAGE_MM
    if max(width, height) < wide or min(width, height) < low:
        raise InputError(f"page {page!r} is too small for the scale bar; use at least {wide:g}x{low:g}mm")
    if max(width, height) > MAX_PAGE_MM:
        raise InputError(f"page {page!r} is larger than {MAX_PAGE_MM:g}mm, the most that PDF allows; use a smaller one")
    return width, height
