"""Photos taken under guidance with several cameras at once, to the judged rig: what `calib live` does with them."""

import os
from collections.abc import Sequence
from pathlib import Path

from calib.app.inputs import Place, target_of
from calib.app.rig import rig
from calib.app.solved_rig import SolvedRig
from calib.capture.conversation import Conversation, Show, Tell
from calib.capture.live import require_server, require_size_used, unheard
from calib.capture.photo_folder import PhotoFolder
from calib.capture.rig_session import RigSession
from calib.capture.server import bound_socket
from calib.capture.serving import Heard, Serving
from calib.capture.sources.opencv_camera import OpenCVCamera, is_video
from calib.capture.sources.source import Source
from calib.capture.sources.watched_folder import WatchedFolder, require_apart
from calib.judge.criteria import STANDARD
from calib.judge.rig_guide import RigGuide
from calib.observe.rig_photos import camera_names_of
from designer.base.errors import InputError
from designer.base.files import place_of, write_files
from designer.base.words import shown
from designer.page.output import Output, output_of
from designer.page.page_file import why_no_page
from designer.target import TargetGeometry

TABLE_FILE = "photos.csv"
"""Which photos count, and which were taken at once, as `calib rig --table` reads it."""


def live_rig(
    target: TargetGeometry | Place,
    out: Output | Place,
    *,
    cameras: Sequence[str | int] = (),
    watch: Sequence[Place] = (),
    size: tuple[int, int] | None = None,
    resume: bool = False,
    model: str = "all",
    criteria: str = STANDARD,
    made: str | None = None,
    port: int = 0,
    opened: Heard = unheard,
    heard: Heard = unheard,
    command: str = "",
) -> SolvedRig:
    """Take photos under guidance with several cameras: `live_rig("ico.target.json", "rig", cameras=[0, 1])`.

    As `live`; at the end all is as after `calib.rig` of the photos.

    Args:
        target: what is photographed: a geometry, or its file.
        out: the folder that photos and results are written to.
        cameras: of this machine by number, addresses (rtsp://...), or video files.
        watch: instead, a folder a camera that other programs write photos to, those of one moment named alike.
        size: as of `live`, like all options that are named alike.
        resume: go on with the session in the folder.
        model: a camera model's name for all cameras, or `all`.
        criteria: when cameras and rig are good: a template's name, or a file.
        made: how the target was made.
        port: of the page.
        opened: is told the page's address, once.
        heard: is told a line of each photo, and of what goes wrong.
        command: that began it, for the page of the result.

    Raises:
        InputError: files, cameras or options that do not do, a folder that holds another session, or photos that
            determine no rig.
    """
    require_server()
    if len(cameras) + len(watch) < 2:
        raise InputError(
            f"{len(cameras) + len(watch)} cameras; give two or more, or take photos with one by calib.live"
        )
    geometry, sources = target_of(target, "rings"), sources_of(cameras, watch, size)
    to = output_of(out)
    SolvedRig.check(to.place)
    require_apart((one.folder for one in sources.values() if isinstance(one, WatchedFolder)), to.place)
    if why := why_no_page(to.place, SolvedRig.kind):
        raise InputError(why)
    guide = RigGuide(geometry, tuple(sources), criteria=criteria, model=model, made=made)
    folder = PhotoFolder(to.place, geometry, guide.names, resume=resume, cameras=guide.names)
    session: RigSession

    def begin(tell: Tell, show: Show) -> RigSession:
        nonlocal session
        session = RigSession(geometry, guide, folder, tuple(sources.values()), tell, show)
        return session

    def solve(_of: Conversation[RigGuide]) -> SolvedRig:
        def tell(what: str, done: float, total: int) -> None:
            session.report("solving", f"{what} {done:.0f} of {total}" if total else what)

        table = write_table(session)
        to.files.clear()  # of a rig that is solved again, what came of the first attempt does not count
        found = rig(target, table=table, model=model, criteria=criteria, made=made, progress=tell, out=to)
        session.report("solving", "drawing the page")
        _, files, remark = found.draw_page(to.place, command)
        if remark:
            raise InputError(remark)
        to.files += files
        return found

    with bound_socket(port) as bound:
        folder.begin()
        return Serving(begin, solve, heard).until_done(bound, opened)


def write_table(session: RigSession) -> Path:
    """Write which photos count, and which were taken at once.

    Raises:
        InputError: the folder cannot be written.
    """
    path = session.folder.folder / TABLE_FILE
    lines = [
        f"{camera},{moment},{_cell(os.path.relpath(kept.files[camera], path.parent))}"
        for moment, kept in session.counted.items()
        for camera in session.guide.names
        if camera in kept.files
    ]
    write_files({path: "\n".join(["camera,frame,file", *lines, ""]).encode()})
    return path


def _cell(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if set(text) & set(',"\n') else text


def sources_of(cameras: Sequence[str | int], watch: Sequence[Place], size: tuple[int, int] | None) -> dict[str, Source]:
    """Where frames come from, by the names of the cameras.

    Raises:
        InputError: what is not there, given twice, or cannot be together.
    """
    if watch and cameras:
        raise InputError("--watch and --camera: photos come from folders, or from cameras; give one of them")
    require_size_used(cameras, size)
    folders = [place_of(one, "a folder") for one in watch]
    if folders:
        return dict(zip(camera_names_of(folders), map(WatchedFolder, folders), strict=True))
    places = [str(one) for one in cameras]
    again = next((one for one in places if places.count(one) > 1), None)
    if again is not None:
        raise InputError(f"--camera {shown(again)}: is given twice; give each camera once")
    films = [Path(one) for one in places if is_video(one)]
    if films and len(films) < len(places):
        raise InputError(
            f"--camera {shown(str(films[0]))}: a video goes with no camera that shows what is now; give videos alone"
        )
    if films:
        names = camera_names_of([one.with_suffix("") for one in films])
    else:
        names = [f"camera-{one}" if one.isdecimal() else f"network-{row}" for row, one in enumerate(places)]
    return {name: OpenCVCamera(place, size) for name, place in zip(names, places, strict=True)}
