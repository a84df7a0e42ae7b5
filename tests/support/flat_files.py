"""Files for lasers, cutters and board houses, read by the programs of others."""

import io
import zipfile
from pathlib import Path

import ezdxf
import numpy as np
from ezdxf.document import Drawing as DxfDocument
from pygerber.gerberx3.api.v2 import GerberFile, ParsedFile

from designer.base.arrays import Array
from designer.kinds.sizing import size_job
from designer.make.cutting import ENGRAVE
from designer.produce import Design, make_files
from designer.spec.build import Format
from tests.support.designs import SMALL, asked_for


def flat(kind: str, *formats: Format, **more: object) -> Design:
    """A small target on paper or sheet, with a border."""
    build = "sheet" if kind == "board" else "stickers"
    values = {**SMALL[kind], "build": build, "formats": ",".join(formats), "chord_error": "50um", "page": "fit", **more}
    return Design(size_job(asked_for(kind, values)).job)


def content_of(design: Design, suffix: str) -> bytes:
    """A file of a design."""
    name = f"{design.job.name}.{suffix}"
    return next(file.content for file in make_files(design, lambda _: None) if file.name == name)


def dxf_of(design: Design) -> DxfDocument:
    return ezdxf.read(io.StringIO(content_of(design, "dxf").decode("ascii")))


def circles(document: DxfDocument) -> Array:
    """Centres and radii of what is engraved, in mm.  # (N, 3)"""
    found = document.modelspace().query(f'CIRCLE[layer=="{ENGRAVE}"]')
    return np.array([(one.dxf.center.x, one.dxf.center.y, one.dxf.radius) for one in found])


def gerbers_of(design: Design, suffix: str, place: Path) -> dict[str, ParsedFile]:
    """The layers of an order, as PyGerber reads them, by the ends of their names."""
    with zipfile.ZipFile(io.BytesIO(content_of(design, suffix))) as archive:
        archive.extractall(place)
    return {path.suffix: GerberFile.from_file(path).parse() for path in place.iterdir() if path.suffix != ".drl"}
