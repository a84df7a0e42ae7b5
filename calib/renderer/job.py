"""A set of photos on disk: several processes, resumed where an earlier run stopped."""

import json
import multiprocessing
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import TypeAlias

import cv2
import numpy as np

from calib.cameras.camera import Camera
from calib.core.parallel import interrupts_held, serve
from calib.renderer.light import Levels
from calib.renderer.options import TRUTH_FILE, FileFormat, RenderOptions
from calib.renderer.truth import TRUTH, FileOptions, Truth, true_views
from calib.renderer.view import render_view
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.files import write_files
from designer.base.own_files import require_ours, signed
from designer.target import TargetGeometry

SUFFIX: dict[FileFormat, str] = {"png": ".png", "tiff": ".tiff", "jpeg": ".jpg"}
ANOTHER_SET = "holds another set of photos; choose another folder with -o, or add --overwrite"


@dataclass(frozen=True, eq=False)
class RenderJob:
    """All that determines a set of photos."""

    target: TargetGeometry
    camera: Camera
    cam_from_target: Array  # (V, 4, 4)
    options: RenderOptions
    seed: int
    file_format: FileFormat = "png"
    quality: int = 95  # of JPEG

    @property
    def file_names(self) -> list[str]:
        """One image a view."""
        digits = max(4, len(str(len(self.cam_from_target) - 1)))
        return [f"view_{n:0{digits}d}{SUFFIX[self.file_format]}" for n in range(len(self.cam_from_target))]


_Missing: TypeAlias = tuple[RenderJob, int, Path]
"""A view that is to be rendered: of which set, its number, the folder."""


@dataclass(frozen=True)
class Rendered:
    """What a run did."""

    rendered: int
    kept: int  # finished by an earlier run
    seconds: float
    processes: int


def truth_text(job: RenderJob) -> str:
    """The text of `truth.json`: one line a view."""
    truth = Truth(
        job.target.geometry_id, job.camera, true_views(job.file_names, job.cam_from_target), job.seed,
        job.target.layout_id, job.options, FileOptions(job.file_format, job.quality),
    )  # fmt: skip
    return TRUTH.text(truth).decode()


def run_jobs(
    jobs: Mapping[Path, RenderJob], files: Mapping[Path, bytes] = MappingProxyType({}), *, processes: int,
    overwrite: bool, on_view: Callable[[int, int], None],
) -> Rendered:  # fmt: skip
    """Render what is missing in the folder of each set; nothing is written if one of them is refused.

    Args:
        jobs: by their folders.
        files: of all sets together, which are written first.
        processes: views at a time.
        overwrite: replace other sets that are there.
        on_view: is told how many of how many views are done.

    Raises:
        InputError: a folder holds another set, or images of unknown origin, and is not to be overwritten.
    """
    start = time.perf_counter()
    for folder, job in jobs.items():
        _require_free(job, folder, overwrite)
    for path, content in files.items() if not overwrite else ():
        if path.exists() and path.read_bytes() != content:
            raise InputError(f"{path}: {ANOTHER_SET}")
    write_files(files)
    missing = [(job, index, folder) for folder, job in jobs.items() for index in _claim(job, folder, overwrite)]
    total = sum(len(job.cam_from_target) for job in jobs.values())
    kept = total - len(missing)
    on_view(kept, total)
    processes = max(1, min(processes, len(missing)))
    for done, _ in enumerate(_render(missing, processes), start=1):
        on_view(kept + done, total)
    return Rendered(len(missing), kept, time.perf_counter() - start, processes)


def _old_truth(folder: Path) -> str | None:
    """The truth that lies in a folder, if one does."""
    path = folder / TRUTH_FILE
    return path.read_text(encoding="utf-8", errors="replace") if path.exists() else None


def _require_free(job: RenderJob, folder: Path, overwrite: bool) -> None:
    """Refuse a folder with other images, and one whose images are not ours to replace."""
    old, path = _old_truth(folder), folder / TRUTH_FILE
    if old is not None and _is_same(old, truth_text(job)) and not overwrite:
        return
    if old is not None and not overwrite:
        raise InputError(f"{path}: {ANOTHER_SET}")
    paths = [folder / name for name in job.file_names]
    found = next((image for image in paths if image.exists()), None)
    if old is None and found is not None and not overwrite:
        raise InputError(f"{found}: is there already, without a {TRUTH_FILE}; choose another folder with -o")
    for one in (path, *(folder / name for name in _named_in(old)), *paths):
        require_ours(one)


def _claim(job: RenderJob, folder: Path, overwrite: bool) -> list[int]:
    """Write the truth, and find the views whose images are missing."""
    folder.mkdir(parents=True, exist_ok=True)
    truth, old = truth_text(job), _old_truth(folder)
    paths = [folder / name for name in job.file_names]
    if old is not None and _is_same(old, truth) and not overwrite:
        return [n for n, image in enumerate(paths) if not image.exists()]
    for image in (*(folder / name for name in _named_in(old)), *paths):
        image.unlink(missing_ok=True)
    _replace(folder / TRUTH_FILE, truth.encode())
    return list(range(len(paths)))


def _is_same(old: str, truth: str) -> bool:
    """Whether two truths say the same, however they are laid out."""
    try:
        return bool(json.loads(old) == json.loads(truth))
    except (ValueError, RecursionError):
        return False


def _named_in(truth: str | None) -> list[str]:
    """The images of an older set that are to go with it."""
    try:
        views = json.loads(truth or "{}").get("views", [])
        names = [str(view["file"]) for view in views]
    except (ValueError, AttributeError, TypeError, KeyError, RecursionError):
        return []
    return [name for name in names if name.startswith("view_") and Path(name).name == name]


def _render(views: Sequence[_Missing], processes: int) -> Iterator[None]:
    """Render views, in several processes if told so, and say when each is done."""
    if processes == 1:
        for view in views:
            render_file(*view)
            yield
        return
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(processes, mp_context=context, initializer=_prepare_process, initargs=(os.getpid(),))
    try:
        with interrupts_held():  # processes start at the first
            futures = [executor.submit(render_file, *view) for view in views]
        for future in as_completed(futures):
            future.result()
            yield
    finally:
        executor.shutdown(wait=True, cancel_futures=True)


def _prepare_process(parent: int) -> None:
    """Use one thread; leave Ctrl-C to the first process, which then sends no more views and waits for those at work."""
    serve(parent)
    cv2.setNumThreads(1)


def render_file(job: RenderJob, index: int, folder: Path) -> None:
    """Render one view of a set into its file. It depends on the seed and the view's number only."""
    rng = np.random.default_rng([job.seed, index])
    view = render_view(job.target, job.camera, job.cam_from_target[index], job.options, rng)
    _replace(folder / job.file_names[index], _encoded(view.image, job))


def _encoded(image: Levels, job: RenderJob) -> bytes:
    """The image as a file's content."""
    flags = {"png": [cv2.IMWRITE_PNG_COMPRESSION, 1], "tiff": [], "jpeg": [cv2.IMWRITE_JPEG_QUALITY, job.quality]}[
        job.file_format
    ]
    done, content = cv2.imencode(SUFFIX[job.file_format], image, flags)
    if not done:
        raise InputError(f"an image of {image.shape[1]} x {image.shape[0]} px cannot be written as {job.file_format}")
    return signed(f"view{SUFFIX[job.file_format]}", content.tobytes())


def _replace(path: Path, content: bytes) -> None:
    """Write a file under a temporary name, so that a finished name is a finished file."""
    temporary = path.with_name(f".{path.name}.part")
    temporary.write_bytes(content)
    os.replace(temporary, path)
