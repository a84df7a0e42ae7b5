"""What was detected, as control points of other programs: `calib markers`, `calib.markers("t.json", "run", "odm")`."""

from collections.abc import Iterable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from calib.app.detect import DETECTIONS_FILE
from calib.app.options import Target
from calib.observe.marker_files import MARKER_FORMATS, MarkerFormat
from designer.base.errors import InputError
from designer.base.files import check_folder, place_of, write_files
from designer.base.marks import NOT_IN_FILE
from designer.base.options import argument, option
from designer.base.words import shown, suggestion_or_all
from designer.kinds.presets import one_of
from designer.page.capability import capability, written_to
from designer.page.output import Output, asked_output, output_of
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.core.types import Detections
    from designer.page.blocks import Page


@dataclass(frozen=True, eq=False)
class MarkersInPhotos(Result, kind="markers", title="Markers in photos", doing="converting", is_written=False):
    """A target's features in photos, as another program's files: `found.texts["markers.xml"]`."""

    form: Annotated[MarkerFormat, NOT_IN_FILE]
    texts: Annotated[dict[str, str], NOT_IN_FILE]  # of the files, by their names
    to: str  # which format
    target_id: str
    photos: int  # that show the target
    markers: int  # how many features they show
    places: int  # of features in photos
    remarks: tuple[str, ...] = ()

    @property
    def is_negative(self) -> bool:
        """No photo shows the target."""
        return not self.photos

    def page(self) -> "Page":
        """What they hold, and what to do with them."""
        from designer.page.blocks import Facts, Headline, Page

        facts = Facts((("format", self.form.title), ("use", self.form.use), ("target id", self.target_id)))
        said = f"in {self.photos} photos, {self.places} places"
        return Page("", "", Headline("note", f"{self.markers} markers", said), (), lead=(facts,))

    def save(self, place: str | PathLike[str], *, command: str = "", has_page: bool = False) -> tuple[Path, ...]:
        """Write the files into a folder.

        Raises:
            InputError: they cannot be written, or are somebody else's.
        """
        folder = output_of(place).place
        check_folder(folder)
        files = {folder / name: text.encode() for name, text in self.texts.items()}
        write_files(files)
        return tuple(files)


@capability
def markers(
    target: Target,
    detections: Annotated["Iterable[Detections] | Place", argument("a detections.csv, or the folder of a run")],
    to: Annotated[
        str,
        option(f"whose files: {', '.join(MARKER_FORMATS)}", metavar="FORMAT", complete=one_of(tuple(MARKER_FORMATS))),
    ],
    *,
    out: Annotated["Output | Place | None", written_to("folder to write into", is_needed=True)] = None,
) -> MarkersInPhotos:
    """Write detections as control points of a program that finds cameras: `markers("t.json", "d.csv", "metashape")`.

    Each feature gets its name, such as f03-2-5, its place in each photo, and where the target has it in space.

    >>> calib.markers("ico.target.json", "detections.csv", "metashape").save("markers")

    Args:
        target: that the photos show.
        detections: of a set of photos, their file, or a run's folder.
        to: whose files.
        out: a folder to write into.

    Raises:
        InputError: a file that cannot be read, a format that is none, or photos whose names it cannot hold.
    """
    from calib.app.inputs import require_told_apart, target_of
    from calib.observe.dataset import read_detections

    if to not in MARKER_FORMATS:
        hint = suggestion_or_all(to, MARKER_FORMATS)
        raise InputError(f"--to {shown(to)}: no such format{hint}")
    output = asked_output(out)
    if output is not None:
        check_folder(output.place)
    geometry = target_of(target)
    require_told_apart(geometry, "markers")
    if isinstance(detections, str | PathLike):
        known = Path(target) if isinstance(target, str | PathLike) else Path("the target")
        place = place_of(detections, "a detections.csv")
        file = place / DETECTIONS_FILE if place.is_dir() else place
        seen = read_detections(file, geometry, target_path=known)
    else:
        seen = tuple(detections)
        if odd := next((one for one in seen if one.layout_id != geometry.layout_id), None):
            raise InputError(f"{odd.image}: shows a target of layout {odd.layout_id}, this has {geometry.layout_id}")
    found, form = [one for one in seen if len(one.ring)], MARKER_FORMATS[to]
    rings = {ring for one in found for ring in one.ring.tolist()}
    made = MarkersInPhotos(
        form, form.write(found, geometry) if found else {}, to, geometry.geometry_id, len(found), len(rings),
        sum(len(one.ring) for one in found),
    )  # fmt: skip
    if output is not None and found:
        output.files += made.save(output.place)
    return made
