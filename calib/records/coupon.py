"""coupon.json: what photos of a coupon tell of a printer, for its page, `calib coupon --json` and other programs."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from calib.coupons.result import CouponMadeWith, NextPrint, PrinterFaults
from designer.base.file_kind import FileKind
from designer.base.marks import Count, FewLines, Gap, Length, Line, Word

COUPON_FILE = "coupon.json"
MOST_PICTURES = 1000


@dataclass(frozen=True)
class ReadPicture:
    """What one photo or scan gave."""

    name: Word
    is_scan: bool
    rings: Count
    edges: Count
    left_out: Count  # edges
    px_per_mm: Gap
    blur_px: Gap
    gamma: Gap  # of its tone curve
    noise: Gap  # in grey levels
    misfit: Gap  # of the edges' profile; 1 or less is good
    rings_px: Gap  # root mean square of the centres' residuals
    tilt_deg: Gap  # between the print's normal and the camera's axis
    fault: Line = ""  # why it was left out; "": it was used


@dataclass(frozen=True)
class CouponRecord:
    """A coupon that was looked at. Null is not known."""

    program: Word
    settings: Annotated[Mapping[Word, Line], Length(0, 100)]
    pictures: Annotated[tuple[ReadPicture, ...], Length(1, MOST_PICTURES)]
    found: PrinterFaults
    made_with: CouponMadeWith
    next_print: NextPrint
    remarks: FewLines


COUPON = FileKind(CouponRecord, "coupon", "a coupon.json", "look at the coupon's photos again: calib coupon")
