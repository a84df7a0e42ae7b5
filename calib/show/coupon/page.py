"""The page of `calib coupon`: what a coupon's photos tell of the printer."""

from pathlib import Path

from calib.records.coupon import COUPON, COUPON_FILE, CouponRecord
from calib.show.coupon.words import (
    bleed_table,
    facts_of,
    findings_of,
    headline_of,
    next_steps,
    options_of,
    pictures_table,
    shape_table,
    widths_table,
)
from calib.show.parts.origin import Origin
from designer.page.blocks import Command, Facts, Page, Section
from designer.page.folders import files_section, question_section, title_of

QUESTION = (
    "How much wider than designed does the printer draw, how large, and how square? Tone curve and blur of each "
    "picture are solved with the edges, and what they leave open is in the standard deviations."
)


def coupon_page(folder: Path, origin: Origin) -> Page:
    """The page of the coupon of a folder.

    Raises:
        InputError: coupon.json is damaged.
    """
    record = COUPON.read(folder / COUPON_FILE)
    setting = (*facts_of(record).rows, ("measured by", record.program))
    sections = (
        Section("Next", next_steps(record), lead="What to print the next design with."),
        Section("Ink bleed", (bleed_table(record), widths_table(record))),
        Section("Size and shape", (shape_table(record),)),
        Section("Pictures", (pictures_table(record), findings_of(record))),
        question_section(QUESTION, setting),
        files_section(
            folder, ((COUPON_FILE, "all numbers with their sigmas"),),
            Command("calib report .", "in this folder: makes this page again"),
        ),
    )  # fmt: skip
    return Page(
        title_of(folder), "Coupon", headline_of(record), sections, lead=(Facts(_options(record)),),
        made_by=origin.command, program=origin.program,
    )  # fmt: skip


def _options(record: CouponRecord) -> tuple[tuple[str, str], ...]:
    """The options, and how sure they are."""
    return tuple((one.name, one.value + (f" ± {one.sigma}" if one.sigma else "")) for one in options_of(record))
