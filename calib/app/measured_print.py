"""What a print was measured to be: the measured target with its report, or the target that a length rescaled."""

from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from designer.base.errors import InputError
from designer.base.files import check_folder, place_of, write_files
from designer.base.marks import INLINE, NOT_IN_FILE
from designer.base.own_files import require_ours
from designer.base.words import NAME
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.coupon_reading.ink_of_rings import InkBleed
    from calib.measure_target.deviations import Compensation, Estimate
    from calib.measure_target.lengths import CaliperLength
    from calib.measure_target.record import AsBuiltRecord
    from calib.measure_target.result import AsBuilt
    from calib.measure_target.tile_fit import Seat
    from designer.base.answer import Value
    from designer.page.blocks import Page
    from designer.target import TargetGeometry

TARGET_SUFFIX = ".target.json"
PURPOSES = (
    ("the target as it was printed, with the covariances of its faces", TARGET_SUFFIX),
    ("all numbers with their covariances", ".as_built.json"),
    ("a line a number, with its sigma", ".as_built.csv"),
    ("the picture", ".as_built.png"),
)


def checked_place(path: str | PathLike[str], nominal: Path | None) -> Path:
    """Where a measured target goes; places that hold something else are refused, before any work is done.

    Raises:
        InputError: another name, or a place that is the target's own, or of another target that is not a measured one,
            or not to be written.
    """
    from calib.measure_target.record import TABLE_FORMAT
    from designer.target import FORMAT, load_target

    out = place_of(path, "a name, such as as_built.target.json")
    if not out.name.endswith(TARGET_SUFFIX) or out.name == TARGET_SUFFIX:
        name = out.name.removesuffix(".json").removesuffix(".target").rstrip(".") or "measured"
        raise InputError(f"-o {out}: target files end in {TARGET_SUFFIX}; call it {name}{TARGET_SUFFIX}")
    check_folder(out.parent)
    if out.exists() and nominal is not None and nominal.exists() and out.samefile(nominal):
        raise InputError(f"-o {out}: is the target it is measured against; choose another name")
    require_ours(out, kind=FORMAT)
    if out.exists() and out.stat().st_size and (source := load_target(out).source) != "measured":
        raise InputError(f"-o {out}: exists and holds a {source} target, not a measured one; choose another name")
    for ending, kind in ((".json", f"{NAME}.{MeasuredPrint.kind}"), (".csv", TABLE_FORMAT), (".png", "")):
        require_ours(_beside(out, f".as_built{ending}"), kind=kind)
    return out


def _beside(target: Path, ending: str) -> Path:
    return target.with_name(f"{target.name.removesuffix(TARGET_SUFFIX)}{ending}")


@dataclass(frozen=True, eq=False)
class MeasuredPrint(Result, kind="as_built", title="Measured print"):
    """A target as it was printed, and what that is worth: `measured.target`, `measured.record.whole.size`."""

    found: Annotated["AsBuilt", NOT_IN_FILE]  # the solution: cameras, faces, rings and their covariances
    measured_against: Annotated[Path | None, NOT_IN_FILE]  # the target as designed, which `save` leaves alone
    use: Annotated[str, NOT_IN_FILE]  # the command line that calibrates with it
    file: Annotated[Path | None, NOT_IN_FILE]  # of the measured target; None: it is not written
    remarks: Annotated[tuple[str, ...], NOT_IN_FILE]  # those of the record
    record: Annotated["AsBuiltRecord", INLINE]  # all that is told of it
    ink_bleed: "InkBleed | None"  # None: the rings do not tell

    @property
    def target(self) -> "TargetGeometry":
        """The target as it was printed."""
        return self.found.target

    @property
    def seats(self) -> "tuple[Seat, ...]":
        """How each piece sits of a target put together from tiles or stickers, in the order of the faces; else none.

        >>> [one.face for one in measured.seats if one.verdict == "sits badly"]
        """
        return () if self.record.seats is None else self.record.seats.seats

    @property
    def why_not(self) -> str:
        """Why the measured target is not to be used, in a line; "" if it is, or if nobody asked."""
        gain = self.record.judged_gain
        if self.record.status == "degenerate":
            return "no camera is determined: do what the remarks say, and measure again"
        if self.record.held_out is None or (gain is not None and gain.is_better):
            return ""
        if gain is None:
            return (
                "too few photos to judge the measured target by: keep the drawing, and take more photos, from all sides"
            )
        return "keep the drawing, which the measured target is no better than, or take more photos, from more sides"

    @property
    def is_negative(self) -> bool:
        """It is not to be used."""
        return bool(self.why_not)

    @cached_property
    def picture(self) -> bytes:
        """Where faces and rings came out, as PNG."""
        from calib.draw.measured_picture import report_picture

        return report_picture(self.record, self.target)

    def page(self) -> "Page":
        """How the print differs from its design, and whether a calibration with it is better."""
        from calib.app.measure_page import measured_page

        return measured_page(self, is_drawn=True)

    def words(self, page: "Page | None" = None) -> "Page":
        """The same without pictures."""
        from calib.app.measure_page import measured_page

        return measured_page(self, is_drawn=False)

    def purposes(self, folder: Path) -> tuple[tuple[str, str], ...]:
        """The files of all prints of a folder, this one's first."""
        own = "" if self.file is None else _beside(self.file, PURPOSES[1][1]).name
        found = sorted(folder.glob(f"?*{PURPOSES[1][1]}"), key=lambda path: (path.name != own, path.name))
        stems = [path.name.removesuffix(PURPOSES[1][1]) for path in found]
        return tuple((f"{stem}{ending}", purpose) for stem in stems for purpose, ending in PURPOSES)

    def save(self, path: str | PathLike[str], *, command: str = "", has_page: bool = True) -> tuple[Path, ...]:
        """Write `NAME.target.json`, and `NAME.as_built.json`, `.csv` and `.png` beside it; return the files.

        Raises:
            InputError: another name, a file of somebody else's, or the target it was measured against.
        """
        from calib.measure_target.record import table_to_csv
        from designer.target import target_to_json

        place = checked_place(path, self.measured_against)
        bleed_mm = None if self.ink_bleed is None else self.ink_bleed.bleed_mm
        files = {
            place: target_to_json(self.target).encode(),
            _beside(place, ".as_built.json"): self._text(),
            _beside(place, ".as_built.csv"): table_to_csv(self.record, bleed_mm, self.found.nominal).encode(),
            _beside(place, ".as_built.png"): self.picture,
        }
        write_files(files)
        return tuple(files)


@dataclass(frozen=True, eq=False)
class RescaledTarget(Result, kind="rescaled", title="Rescaled target"):
    """A target made larger or smaller by one length: `resized.target`, `resized.save("as_built.target.json")`.

    The length over front and back of a board moves its back, and nothing else.
    """

    nominal: "TargetGeometry"
    target: "TargetGeometry"
    length: "CaliperLength"
    remarks: tuple[str, ...]  # on the length, a line each
    made_with: "Compensation"
    measured_against: Path | None = None
    file: Path | None = None  # that was written

    @property
    def factor(self) -> float:
        """How many times as large it is."""
        from calib.measure_target.lengths import length_in

        return self.length.value_mm / length_in(self.nominal, self.length.name)

    @property
    def size(self) -> "Estimate | None":
        """How much larger than designed, as a share; None: the length is a thickness, which says nothing of it."""
        from calib.measure_target.back import tells_thickness
        from calib.measure_target.deviations import Estimate

        if tells_thickness(self.nominal, self.length.name):
            return None
        return Estimate(self.factor - 1, self.length.sigma_mm / self.length.value_mm)

    def page(self) -> "Page":
        """Its size, and what is next."""
        from calib.app.measure_page import rescaled_page

        return rescaled_page(self)

    def answer(self) -> "dict[str, Value]":
        """Ids, size, and what to dial in."""
        from calib.measure_target.deviations import compensation_percent

        size, made = self.size, self.made_with.shrink_percent
        return {
            "status": "rescaled",
            "nominal_geometry_id": self.nominal.geometry_id,
            "measured_geometry_id": self.target.geometry_id,
            "size": None if size is None else {"value": size.value, "sigma": size.sigma},
            "next_shrink_compensation_percent": None if size is None else compensation_percent(size.value, made),
        }

    def save(self, path: str | PathLike[str], *, command: str = "", has_page: bool = True) -> tuple[Path, ...]:
        """Write `NAME.target.json`; return its place.

        Raises:
            InputError: another name, a file of somebody else's, or the target as designed.
        """
        from designer.target import target_to_json

        place = checked_place(path, self.measured_against)
        write_files({place: target_to_json(self.target).encode()})
        return (place,)
