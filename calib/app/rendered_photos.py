"""Photos that are rendered when they are asked for, of one camera or of a rig's: `photos.save("photos")`."""

import csv
import io
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Self

from calib.renderer.options import PHOTO_TABLE, RIG_FILE, TRUTH_FILE
from designer.base.codec import encode_written
from designer.base.errors import InputError
from designer.base.words import shown
from designer.page.output import Output, output_of
from designer.page.progress import Progress, unheard
from designer.page.result import Result

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.cameras.rig import Rig
    from calib.renderer.contents import PhotoContent
    from calib.renderer.held_target import HeldFrames
    from calib.renderer.job import Rendered, RenderJob
    from calib.renderer.light import Levels
    from calib.renderer.rig_template import SimulatedRig
    from calib.renderer.scene import RenderScene
    from calib.renderer.truth import RigTruth
    from designer.base.arrays import Array, Flags
    from designer.base.files import JsonValue
    from designer.page.blocks import Page

TARGET = {"target.json": "the target as it was rendered"}
FILES = {TRUTH_FILE: "poses, camera and options: what a calibration of these photos should find", **TARGET}
FILES_OF_RIG = {
    RIG_FILE: "the true rig: cameras, where they stand, delays of their clocks",
    TRUTH_FILE: "how the target was held in each frame; a camera's folder has another, of its photos",
    PHOTO_TABLE: "camera, frame and file of each photo, and its time stamp where cameras are not synchronous",
    **TARGET,
}


@dataclass(frozen=True, eq=False, kw_only=True)
class RenderedSet(Result, kind="photos", title="Rendered photos", doing="rendering"):
    """Photos of one camera, or of a rig's, that are rendered when they are asked for."""

    target_file: str = ""  # as it was given; "": it comes from no file
    folder: str = ""  # that they were rendered into; "": into none yet
    done: "Rendered | None" = None  # there

    @property
    @abstractmethod
    def by_folder(self) -> "Mapping[str, RenderedPhotos]":
        """The photos of each camera, whose name is the folder's; "" where there is one."""

    @property
    @abstractmethod
    def warnings(self) -> tuple[str, ...]:
        """What will make detection or calibration hard, one line each."""

    @property
    def remarks(self) -> tuple[str, ...]:  # type: ignore[override]  # of what is rendered
        """The warnings."""
        return self.warnings

    @property
    def first(self) -> "RenderJob":
        """All that determines the photos of the first camera."""
        return next(iter(self.by_folder.values())).job

    @property
    def image_count(self) -> int:
        """Of all cameras."""
        return sum(len(one.job.cam_from_target) for one in self.by_folder.values())

    def files_in(self, folder: "Place") -> tuple[Path, ...]:
        """Those of the set that are there."""
        place = Path(folder)
        own = [
            place / name / file for name, one in self.by_folder.items() for file in (*one.job.file_names, TRUTH_FILE)
        ]
        return tuple(path for path in (*own, *(place / name for name in self.tables())) if path.exists())

    def save(
        self, folder: "Place", *, jobs: int | None = 1, overwrite: bool = False, progress: Progress = unheard,
        command: str = "", has_page: bool = False,
    ) -> tuple[Path, ...]:  # fmt: skip
        """Render what is missing in a folder, with the `truth.json` of all; of a rig in a folder a camera; the files.

        Args:
            jobs: processes; None: one per core. More than one start Python anew, so that a script needs the usual
                `if __name__ == "__main__":` around what it does.

        Raises:
            InputError: the folder holds another set, or images of unknown origin.
        """
        output = output_of(folder)
        made = self.rendered_into(output, jobs, overwrite=overwrite, progress=progress)
        return (*output.files, *(made.draw_page(output.place, command)[1] if has_page else ()))

    def rendered_into(
        self, out: "Output | Place | None", jobs: int | None, *, overwrite: bool, progress: Progress
    ) -> Self:
        """What `save` does, and the same photos with what was done; None: nothing."""
        from calib.cameras.rig import RIG
        from calib.judge.folders import keep_target
        from calib.renderer.job import run_jobs
        from calib.renderer.quantities import processes_of

        if out is None:
            return self
        output, target = output_of(out), self.first.target
        folder = output.place
        if self.first.options.bits == 32:
            raise InputError("--bits 32: is of arrays; files hold 8 or 16")
        if overwrite and RIG_FILE in self.tables() and (folder / RIG_FILE).exists():
            for name in RIG.read(folder / RIG_FILE).names:
                if name not in self.by_folder:
                    raise InputError(
                        f"{folder / RIG_FILE}: its camera {shown(name)} is none of this rig's, and would stay; "
                        "choose another folder"
                    )
        is_again = (folder / TRUTH_FILE).exists()
        try:
            done = run_jobs(
                {folder / name: one.job for name, one in self.by_folder.items()},
                {folder / name: content for name, content in self.tables().items()}, processes=processes_of(jobs),
                overwrite=overwrite, on_view=lambda count, total: progress("rendering", count, total),
            )  # fmt: skip
        except KeyboardInterrupt:
            output.files += [path for path in self.files_in(folder) if path.suffix not in (".json", ".csv")]
            count, asked = len(output.files), self.image_count
            output.finished.append(folder)
            output.answer = {"images": count, "asked": asked}
            output.again = f"{count} of {asked} images are there; the same command renders the others"
            raise
        output.files += [*self.files_in(folder), *keep_target(folder, target, is_again=is_again)]
        return replace(self, folder=str(folder), done=done)

    def document(self) -> "dict[str, JsonValue]":
        """What was rendered, of what, and how long it took."""
        return {
            "folder": self.folder, "images": self.image_count,
            **({} if self.done is None else encode_written(self.done)),
            "target_id": self.first.target.geometry_id, "seed": self.first.seed,
        }  # fmt: skip

    def page(self) -> "Page":
        """What the photos show, and from where they are taken."""
        return self.page_beside(None)

    @abstractmethod
    def page_beside(self, folder: Path | None) -> "Page":
        """The same with the photos in a folder."""

    def purposes(self, folder: Path) -> tuple[tuple[str, str], ...]:
        """The files beside the photos."""
        return tuple(self.files.items())


@dataclass(frozen=True, eq=False)
class RenderedPhotos(RenderedSet, kind="photos", title="Rendered photos", doing="rendering", files=FILES):
    """Photos that are rendered when they are asked for: `photos.image(0)`, `photos.save("photos")`."""

    job: "RenderJob"  # all that determines them
    looks_aside: bool = False  # a target that reaches beyond the image was asked for
    camera_remarks: tuple[str, ...] = ()  # on the camera's file

    @property
    def by_folder(self) -> "Mapping[str, RenderedPhotos]":
        """These."""
        return {"": self}

    @property
    def cam_from_target(self) -> "Array":
        """Where the camera stands in each.  # (V, 4, 4)"""
        return self.job.cam_from_target

    @cached_property
    def scene(self) -> "RenderScene":
        """The target as rays meet it."""
        from calib.renderer.scene import scene_from_target

        return scene_from_target(self.job.target)

    @cached_property
    def contents(self) -> "tuple[PhotoContent, ...]":
        """What each photo shows of the target."""
        from calib.detector.candidates import MIN_RADIUS_PX
        from calib.renderer.contents import photo_contents

        return photo_contents(self.job.target, self.job.camera, self.job.cam_from_target, MIN_RADIUS_PX)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What will make detection hard, one line each."""
        from calib.renderer.contents import photo_warnings

        return tuple(photo_warnings(self.contents, self.job.options, looks_aside=self.looks_aside))

    @property
    def remarks(self) -> tuple[str, ...]:  # type: ignore[override]  # of what is rendered
        """On the camera's file, and the warnings."""
        return (*self.camera_remarks, *self.warnings)

    def image(self, number: int) -> "Levels":
        """A photo, the same as the file that `save` writes of it.  # (H, W)"""
        import numpy as np

        from calib.renderer.quantities import whole
        from calib.renderer.view import render_view

        job, number = self.job, whole("photo", number, 0, len(self.job.cam_from_target) - 1)
        rng = np.random.default_rng([job.seed, number])
        return render_view(self.scene, job.camera, job.cam_from_target[number], job.options, rng).image

    def document(self) -> "dict[str, JsonValue]":
        """What was rendered, and the size of each."""
        return {**super().document(), "image_size_px": list(self.job.camera.image_size)}

    def page_beside(self, folder: Path | None) -> "Page":
        """What the photos show of the target, and from where they are taken."""
        from calib.app.render_page import photos_page

        return photos_page(self, folder)


@dataclass(frozen=True, eq=False)
class RenderedRig(RenderedSet, kind="photos", title="Rendered photos", doing="rendering", files=FILES_OF_RIG):
    """A rig's photos, rendered when they are asked for: `photos.save("photos")`, `photos.of["left"].image(0)`."""

    simulated: "SimulatedRig"  # what `held.rig` was made of
    held: "HeldFrames"
    of: Mapping[str, RenderedPhotos]  # the photos of each camera, by its name

    @property
    def by_folder(self) -> Mapping[str, RenderedPhotos]:
        """Of each camera."""
        return self.of

    @property
    def rig(self) -> "Rig":
        """The true one, with the cameras' delays where they are not synchronous."""
        return self.held.rig

    @property
    def rig_from_target(self) -> "Array":
        """How the target is held, at each frame's time.  # (V, 4, 4)"""
        return self.held.rig_from_target

    @cached_property
    def sees(self) -> "Flags":
        """Whether each camera has a ring that is large enough for the detector, in each frame.  # (C, V)"""
        import numpy as np

        return np.array([[one.is_found for one in photos.contents] for photos in self.of.values()])

    @property
    def shared_frames(self) -> tuple[tuple[int, ...], ...]:
        """In which two cameras each see the target so."""
        return tuple(map(tuple, (self.sees.astype(int) @ self.sees.T.astype(int)).tolist()))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What will make the rig's calibration hard, one line each."""
        from calib.renderer.contents import rig_warnings

        return tuple(rig_warnings(self.rig.names, self.sees))

    @property
    def delays_ms(self) -> Mapping[str, float]:
        """By which each camera's time stamps run behind; empty: they are synchronous."""
        delay_s = self.rig.delay_s
        return {} if delay_s is None else dict(zip(self.rig.names, (1e3 * delay_s).tolist(), strict=True))

    @property
    def truth(self) -> "RigTruth":
        """How the target was held."""
        from calib.renderer.truth import RigTruth, TrueFrame

        first, names = self.first, [Path(name).stem for name in self.first.file_names]
        times = [None] * len(names) if self.held.time_s is None else self.held.time_s.tolist()
        frames = tuple(TrueFrame(*one) for one in zip(names, self.rig_from_target, times, strict=True))
        return RigTruth(first.target.geometry_id, first.target.layout_id, self.rig.names, frames, first.seed)

    def tables(self) -> Mapping[str, bytes]:
        """The rig, how the target was held, and a line a photo, with its time stamp where there are any."""
        from calib.cameras.rig import RIG
        from calib.renderer.truth import RIG_TRUTH

        stream, stamp_s = io.StringIO(), self.held.stamp_s
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(("camera", "frame", "file", *(() if stamp_s is None else ("time_s",))))
        for row, (name, photos) in enumerate(self.of.items()):
            for frame, file in enumerate(photos.job.file_names):
                stamp = () if stamp_s is None else (f"{stamp_s[row, frame]:.6f}",)
                table.writerow((name, Path(file).stem, f"{name}/{file}", *stamp))
        return {
            RIG_FILE: RIG.text(self.rig), TRUTH_FILE: RIG_TRUTH.text(self.truth),
            PHOTO_TABLE: stream.getvalue().encode(),
        }  # fmt: skip

    def document(self) -> "dict[str, JsonValue]":
        """What was rendered, by which cameras, and how often two of them see the target."""
        return {
            **super().document(), "rig": self.simulated.name, "cameras": list(self.rig.names),
            "frames": len(self.rig_from_target), "shared_frames": [list(row) for row in self.shared_frames],
            "delays_ms": dict(self.delays_ms),
        }  # fmt: skip

    def page_beside(self, folder: Path | None) -> "Page":
        """How often each camera sees the target, alone and with others."""
        from calib.app.render_page import rig_photos_page

        return rig_photos_page(self, folder)
