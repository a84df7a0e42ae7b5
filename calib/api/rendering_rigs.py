"""Synthetic photos of a target by the cameras of a rig, all at once or each at its own time."""

import csv
import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike, fspath
from pathlib import Path

import numpy as np

from calib.api.rendering import RenderedPhotos, check_light
from calib.app.inputs import DISTANCES_MM, MAX_SEED, Place, folder_of, processes_of, target_of
from calib.cameras.rig import RIG, Rig
from calib.core.types import LEAST_RADIUS_PX
from calib.renderer.faces import ring_truth
from calib.renderer.held_target import held_poses, way_of
from calib.renderer.job import Rendered, RenderJob, require_free, run_jobs
from calib.renderer.options import RenderOptions
from calib.renderer.quantities import real, whole
from calib.renderer.rig_template import HeldTarget, SimulatedRig, read_simulated_rig, with_folder_names
from calib.renderer.scene import scene_from_target
from calib.renderer.truth import RIG_TRUTH, TRUTH_FILE, FileFormat, RigTruth, TrueFrame
from designer.base.arrays import Array, Flags
from designer.base.errors import InputError
from designer.base.files import write_files
from designer.base.words import shown
from designer.page.progress import Progress, unheard
from designer.target import TargetGeometry

RIG_FILE, PHOTO_TABLE = "rig.json", "photos.csv"
PHOTO_COLUMNS = ("camera", "frame", "file", "time_s")
LONGEST_DELAY_S = 1.0
MOST_FRAMES = 10_000
JITTER = 0.1
"""Of the largest delay: by which photos of one frame are taken earlier or later besides, as their time stamps say."""


@dataclass(frozen=True, eq=False)
class _Motion:
    """How the target is held in V frames, of which C cameras take photos."""

    rig_from_target: Array  # (V, 4, 4) at each frame's time
    as_seen: Array  # (C, V, 4, 4) when each photo was taken
    time_s: Array | None = None  # (V,) of each frame; None: the target stands still in each
    stamp_s: Array | None = None  # (C, V) of each photo


@dataclass(frozen=True, eq=False)
class RenderedRig:
    """A rig's photos, rendered when they are asked for: `photos.save("photos")`, `photos.of["left"].image(0)`."""

    simulated: SimulatedRig  # `simulated.rig` is the truth, with the cameras' delays where they are not synchronous
    jobs: tuple[RenderJob, ...]  # (C,) all that determines the photos of each camera
    rig_from_target: Array  # (V, 4, 4) at each frame's time
    time_s: Array | None = None  # (V,) of each frame; None: the target stands still in each
    stamp_s: Array | None = None  # (C, V) of each photo

    @property
    def rig(self) -> Rig:
        """The true one."""
        return self.simulated.rig

    @cached_property
    def of(self) -> Mapping[str, RenderedPhotos]:
        """The photos of each camera, by its name."""
        return {
            name: RenderedPhotos(job, looks_aside=True) for name, job in zip(self.rig.names, self.jobs, strict=True)
        }

    @cached_property
    def sees(self) -> Flags:
        """Whether each camera has a ring that is large enough for the detector, in each frame.  # (C, V)"""
        scene = scene_from_target(self.jobs[0].target)
        rows = []
        for job in self.jobs:
            rings = (ring_truth(scene, job.camera, pose) for pose in job.cam_from_target)
            rows.append([bool((one.whole & (one.minor_radius_px >= LEAST_RADIUS_PX)).any()) for one in rings])
        return np.array(rows)

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What will make the rig's calibration hard, one line each."""
        return tuple(_warnings(self))

    @property
    def delays_ms(self) -> Mapping[str, float]:
        """By which each camera's time stamps run behind; empty: they are synchronous."""
        delay_s = self.rig.delay_s
        return {} if delay_s is None else dict(zip(self.rig.names, (1e3 * delay_s).tolist(), strict=True))

    @property
    def truth(self) -> RigTruth:
        """How the target was held."""
        target, first = self.jobs[0].target, self.jobs[0]
        names = [Path(name).stem for name in first.file_names]
        times = [None] * len(names) if self.time_s is None else self.time_s.tolist()
        frames = tuple(TrueFrame(*one) for one in zip(names, self.rig_from_target, times, strict=True))
        return RigTruth(target.geometry_id, target.layout_id, self.rig.names, frames, first.seed)

    @property
    def photo_table(self) -> str:
        """The text of `photos.csv`: a line a photo, with its time stamp where there are any."""
        stream = io.StringIO()
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(PHOTO_COLUMNS if self.stamp_s is not None else PHOTO_COLUMNS[:-1])
        for row, (name, job) in enumerate(zip(self.rig.names, self.jobs, strict=True)):
            for frame, file in enumerate(job.file_names):
                stamp = () if self.stamp_s is None else (f"{self.stamp_s[row, frame]:.6f}",)
                table.writerow((name, Path(file).stem, f"{name}/{file}", *stamp))
        return stream.getvalue()

    def save(
        self, folder: Place, *, jobs: int | None = 1, overwrite: bool = False, progress: Progress = unheard
    ) -> Rendered:
        """Render what is missing: a folder a camera, `rig.json` and `truth.json` of all, and a table of the photos.

        Args:
            folder: for them; made if need be.
            jobs: processes; None: one per core; see `RenderedPhotos.save`.
            overwrite: replace another set that is there.
            progress: is told how many are done.

        Raises:
            InputError: the folder holds another set, or images of unknown origin.
        """
        place, processes = folder_of(folder), processes_of(jobs)
        files = {
            place / RIG_FILE: RIG.text(self.rig),
            place / TRUTH_FILE: RIG_TRUTH.text(self.truth),
            place / PHOTO_TABLE: self.photo_table.encode(),
        }
        _require_same_set(files, self.rig, overwrite=overwrite)
        sets = {place / name: job for name, job in zip(self.rig.names, self.jobs, strict=True)}
        require_free(sets, overwrite=overwrite)
        write_files(files)
        return run_jobs(
            sets, processes=processes, overwrite=overwrite,
            on_view=lambda done, total: progress("rendering", done, total),
        )  # fmt: skip

    def files_in(self, folder: Place) -> tuple[Path, ...]:
        """Those of the set that are there."""
        place = Path(folder)
        own = [place / name for name in (RIG_FILE, TRUTH_FILE, PHOTO_TABLE)]
        return tuple(
            path
            for path in (*(one for name, photos in self.of.items() for one in photos.files_in(place / name)), *own)
            if path.exists()
        )


def render_rig(
    target: TargetGeometry | Place,
    rig: Rig | SimulatedRig | Place = "stereo-pair",
    *,
    frames: int = 30,
    unsynchronised_s: float = 0.0,
    distance_mm: float | tuple[float, float] | None = None,
    options: RenderOptions | None = None,
    seed: int = 0,
    file_format: FileFormat = "png",
    quality: int = 95,
) -> RenderedRig:
    """Photos of a target as the cameras of a rig would take them: `render_rig("ico.target.json").save("photos")`.

    In each frame the target is held to one of the cameras in turn, every second frame so that most others see it too.
    It stands still, unless the cameras are not synchronous: then it moves along a smooth way.

    Args:
        target: a geometry, or its file.
        rig: a rig, its file, or a template.
        frames: how many.
        unsynchronised_s: by how much the clocks of the cameras but the first run behind or ahead, at most; photos of
            one frame are taken earlier or later by a tenth of it besides, as their time stamps say.
        distance_mm: of the target from the camera that it is held to, or the nearest and farthest; None: as the
            template says.
        options: light, lens and sensor; None: plain ones, without noise.
        seed: of all that is random.
        file_format: of the files that are saved.
        quality: of JPEG.

    Raises:
        InputError: a file that cannot be read, or a value that breaks a rule.
    """
    geometry, simulated = target_of(target, "marks"), simulated_rig(rig)
    held, true = held_before(simulated, distance_mm), simulated.rig
    light = RenderOptions() if options is None else options
    check_light(light, file_format)
    seed, count = whole("--seed", seed, 0, MAX_SEED), whole("--frames", frames, 1, MOST_FRAMES)
    delay_s = real("--unsynchronised", unsynchronised_s, 0, LONGEST_DELAY_S, "s")
    rng, quality = np.random.default_rng([seed, count]), whole("--quality", quality, 1, 100)
    if delay_s:
        true, motion = _in_motion(true, geometry, held, count, delay_s, rng)
    else:
        poses = held_poses(true, geometry, held, count, rng)
        motion = _Motion(poses, np.broadcast_to(poses, (len(true.names), *poses.shape)))
    jobs = tuple(
        RenderJob(geometry, camera, cam_from_rig @ seen, light, (seed + row) % (MAX_SEED + 1), file_format, quality)
        for row, (camera, cam_from_rig, seen) in enumerate(
            zip(true.cameras, true.cam_from_rig, motion.as_seen, strict=True)
        )
    )
    return RenderedRig(replace(simulated, rig=true), jobs, motion.rig_from_target, motion.time_s, motion.stamp_s)


def simulated_rig(rig: Rig | SimulatedRig | Place) -> SimulatedRig:
    """What a rig is, whatever it is given as."""
    if isinstance(rig, SimulatedRig):
        return rig
    if isinstance(rig, Rig):
        return SimulatedRig("rig", "a rig", "", with_folder_names(_true(rig), "rig"), None)
    if not isinstance(rig, str | PathLike):
        raise InputError(
            f"rig {shown(rig)}: is of type {type(rig).__name__}; give a template, a TOML file or a rig.json"
        )
    found = read_simulated_rig(fspath(rig))
    return replace(found, rig=_true(found.rig))


def _true(rig: Rig) -> Rig:
    """The rig as what it is, without what a calibration knows of it."""
    return replace(rig, covariance=None, noise_px=None, delay_s=None, geometry_id="")


def held_before(simulated: SimulatedRig, distance_mm: float | tuple[float, float] | None) -> HeldTarget:
    """How the target is held before a rig."""
    if distance_mm is None:
        if simulated.held is None:
            raise InputError(
                f"--rig {simulated.name}: says where the cameras are, not where the target is held; "
                "add --distance, such as 400mm..800mm"
            )
        return simulated.held
    both = distance_mm if isinstance(distance_mm, tuple) and len(distance_mm) == 2 else (distance_mm, distance_mm)
    near, far = (real("--distance", one, *DISTANCES_MM, "mm") for one in both)
    if near > far:
        raise InputError(f"--distance {near:g}mm..{far:g}mm: the smaller length comes first")
    return HeldTarget((near, far)) if simulated.held is None else replace(simulated.held, distance_mm=(near, far))


def _in_motion(
    rig: Rig, target: TargetGeometry, held: HeldTarget, count: int, most_s: float, rng: np.random.Generator
) -> tuple[Rig, _Motion]:
    """The rig with its delays, and what its cameras see while the target moves."""
    time_s = np.arange(count) / held.rate_hz
    delay_s = rng.uniform(-most_s, most_s, len(rig.names))
    delay_s[0] = 0.0
    stamp_s = time_s + JITTER * most_s * rng.uniform(-1, 1, (len(rig.names), count))
    margin = (1 + JITTER) * most_s
    way = way_of(rig, target, held, (-margin, float(time_s[-1]) + margin), rng)
    return replace(rig, delay_s=delay_s), _Motion(way.at(time_s), way.at(stamp_s - delay_s[:, None]), time_s, stamp_s)


def _require_same_set(files: Mapping[Path, bytes], rig: Rig, *, overwrite: bool) -> None:
    """Refuse a folder with another rig's photos."""
    place = next(iter(files))
    if not overwrite:
        for path, content in files.items():
            if path.exists() and path.read_bytes() != content:
                raise InputError(
                    f"{path}: holds another set of photos; choose another folder with -o, or add --overwrite"
                )
    elif place.exists():
        others = [name for name in RIG.read(place).names if name not in rig.names]
        if others:
            raise InputError(
                f"{place}: its camera {shown(others[0])} is none of this rig's, and would stay; choose another folder"
            )


def _warnings(photos: RenderedRig) -> Iterator[str]:
    """Cameras that see nothing, and cameras that no chain of frames joins."""
    sees, names = photos.sees, photos.rig.names
    blind = [name for name, row in zip(names, sees, strict=True) if not row.any()]
    if blind:
        yield (
            f"in no frame {', '.join(blind)} has a ring of {LEAST_RADIUS_PX:g} px, as the detector wants; "
            "take more --frames, hold the target nearer with --distance, or take one with larger rings"
        )
    joined, before = sees[:1].any(axis=0), -1
    while joined.sum() > before:
        before = int(joined.sum())
        joined = sees[(sees & joined).any(axis=1)].any(axis=0) if before else joined
    apart = [name for name, row in zip(names, sees, strict=True) if row.any() and not (row & joined).any()]
    if apart:
        yield (
            f"no frame joins {', '.join(apart)} to the first camera, not by others either; take more --frames, or a "
            "solid instead of a board"
        )
