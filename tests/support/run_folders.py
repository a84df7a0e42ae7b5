"""Folders as `calib run` leaves them, made without photos: for tests of what is built from them."""

import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from calib.app.calibration import Run
from calib.core.types import FaceRecord
from calib.judge.folders import read_run
from calib.observe.calibration_file import Provenance, write_calibration
from calib.observe.dataset import RECORDS, ImageRecord, Records
from calib.renderer.truth import Truth
from calib.solver.calibration import Calibration
from calib.solver.metrics.evaluation import evaluate
from calib.solver.metrics.evaluation_files import evaluation_files
from calib.solver.problem import SolveOptions
from calib.solver.solve import solve
from designer.base.files import distinct_stems, write_files
from designer.page.blocks import Page
from designer.target import TargetGeometry
from tests.support.calibrations import board, example
from tests.support.command_line import PICTURE


def solved(
    models: Sequence[str] = ("opencv", "luhmann"),
    *,
    target: TargetGeometry | None = None,
    names: tuple[str, ...] = (),
    views: int = 8,
    seed: int = 1,
) -> list[Calibration]:
    """Calibrations of the same noisy sightings by several models."""
    one = example(target or board(), np.random.default_rng(seed), views=views, noise_px=0.05)
    seen = replace(one.observations, view_names=names or one.observations.view_names)
    return [solve(seen, model, SolveOptions()) for model in models]


def write_run(folder: Path, calibrations: Sequence[Calibration], *, truth: Truth | None = None) -> None:
    """A folder with a model's folder for each calibration, and the records of the search."""
    for one in calibrations:
        place = folder / one.camera.model
        write_calibration(place, one, Provenance("test 1.0", options=SolveOptions()))
        write_files(evaluation_files(evaluate(one, truth), place))
    seen = calibrations[0].observations
    images = tuple(
        ImageRecord(
            name, seen.image_size, int((seen.view == view).sum()), 0,
            (FaceRecord(0, (), 0, int((seen.view == view).sum()), len(seen.points.face), ()),), (),
        )
        for view, name in enumerate(seen.view_names)
    )  # fmt: skip
    records = Records("test 1.0", "", seen.points.geometry_id, images)
    write_files({folder / "detections.records.json": RECORDS.text(records)})


def write_overlays(folder: Path, names: Sequence[str], size: tuple[int, int] = (320, 240)) -> None:
    """A picture of noise for each photo, the hardest to make small."""
    rng = np.random.default_rng(3)
    pixels = rng.integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
    for number, stem in enumerate(distinct_stems(names)):
        stream = io.BytesIO()
        Image.fromarray(np.roll(pixels, 7 * number, axis=1)).save(stream, "PNG", compress_level=1)
        write_files({folder / "overlays" / f"{stem}.overlay.png": stream.getvalue()})


BLANK = b'<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9" viewBox="0 0 9 9"><path d="M0 0"/></svg>'
"""In place of figures: most of the time goes into them, and most tests are of something else."""
PANEL = "calib.draw.style.svg_panel"


@pytest.fixture(autouse=True)
def nothing_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """For a folder that has a `conftest.py`: figures of calibrations are blank; those of `show` test what they show."""
    monkeypatch.setattr("calib.draw.picture", lambda *_, **__: PICTURE)
    monkeypatch.setattr(PANEL, lambda *_, **__: BLANK)


def page_of_run(folder: Path, command: str = "calib run board.target.json photos") -> Page:
    """The page of a run's folder."""
    return Run(read_run(folder), place=folder).page_in(folder, command)
