"""Photos taken under guidance, from the first frame to the judged camera: what `calib live` does."""

from collections.abc import Sequence
from importlib.util import find_spec

from calib.app.calibration import Run
from calib.app.calibration_folder import RunFolder
from calib.app.inputs import Place, target_of
from calib.app.run import run
from calib.capture.conversation import Conversation, Show, Tell
from calib.capture.photo_folder import PhotoFolder
from calib.capture.server import bound_socket
from calib.capture.serving import Heard, Serving
from calib.capture.session import Session
from calib.capture.sources.opencv_camera import OpenCVCamera
from calib.capture.sources.source import BrowserCamera, Source
from calib.capture.sources.watched_folder import WatchedFolder, require_apart
from calib.judge.criteria import STANDARD
from calib.judge.guide import Guide
from calib.solver.plan import models_of
from designer.base.errors import InputError
from designer.base.files import place_of
from designer.page.output import Output, output_of
from designer.target import TargetGeometry

NEEDED = ("starlette", "uvicorn", "websockets")


def unheard(line: str) -> None:
    """A line of which nobody is told."""


def live(
    target: TargetGeometry | Place,
    out: Output | Place,
    *,
    cameras: Sequence[str | int] = (),
    watch: Place | None = None,
    size: tuple[int, int] | None = None,
    resume: bool = False,
    model: str = "all",
    criteria: str = STANDARD,
    made: str | None = None,
    port: int = 0,
    opened: Heard = unheard,
    heard: Heard = unheard,
    command: str = "",
) -> Run:
    """Take photos under guidance, and calibrate the camera: `live("ico.target.json", "camera", opened=print)`.

    A page on this machine shows where to hold the target next, takes photos by itself, and ends when the camera is
    good; then all is as after `calib.run`.

    Args:
        target: what is photographed: a geometry, or its file.
        out: the folder that photos and results are written to.
        cameras: of this machine by number, an address (rtsp://...), or a video file; none: the browser's.
        watch: a folder that another program writes photos to, instead of a camera.
        size: width and height in px that a camera of this machine is asked for.
        resume: go on with the session in the folder.
        model: a camera model's name, or `all`.
        criteria: when a camera is good: a template's name, or a file.
        made: how the target was made, as for `run`.
        port: of the page; 0: any that is free.
        opened: is told the page's address, once.
        heard: is told a line of each photo, and of what goes wrong.
        command: that began it, for the page of the result.

    Raises:
        InputError: files, cameras or options that do not do, a folder that holds another session, or photos that
            determine no camera.
    """
    require_server()
    geometry, sources = target_of(target, "rings"), _sources(cameras, watch, size)
    to = output_of(out)
    writer = RunFolder(to, models_of(model))
    require_apart((one.folder for one in sources if isinstance(one, WatchedFolder)), writer.folder)
    writer.require_room()
    guide = Guide(geometry, criteria=criteria, model=model, made=made)
    folder = PhotoFolder(writer.folder, geometry, tuple(one.name for one in sources), resume=resume)

    def begin(tell: Tell, show: Show) -> Session:
        return Session(geometry, guide, folder, sources, tell, show)

    def solve(session: Conversation[Guide]) -> Run:
        def tell(what: str, done: float, total: int) -> None:
            session.report("solving", f"{what} {done:.0f} of {total}" if total else what)

        to.files, to.finished, to.answer = [], [], {}  # of a run that is made again, the first attempt does not count
        found = run(target, session.photos, model=model, criteria=criteria, made=made, progress=tell, out=to)
        session.report("solving", "drawing the page")
        _, files, remark = found.draw_page(to.place, command)
        if remark:
            raise InputError(remark)
        to.files += files
        return found

    with bound_socket(port) as bound:
        folder.begin()
        return Serving(begin, solve, heard).until_done(bound, opened)


def require_server() -> None:
    """Refuse to begin without the web server.

    Raises:
        InputError: a part of it is not installed.
    """
    for name in NEEDED:
        if find_spec(name) is None:
            raise InputError(
                f"calib live needs {name}, which is not installed; pip install 'ringsolid[live]' brings it"
            )


def require_size_used(cameras: Sequence[str | int], size: tuple[int, int] | None) -> None:
    """Refuse a size that nobody can be asked for.

    Raises:
        InputError: photos come from a folder, the browser, a video or a network.
    """
    if size is not None and not any(str(one).isdecimal() for one in cameras):
        raise InputError("--size: is what a camera of this machine is asked for; give its number with --camera, too")


def _sources(cameras: Sequence[str | int], watch: Place | None, size: tuple[int, int] | None) -> tuple[Source, ...]:
    """Where frames come from, as a person names it.

    Raises:
        InputError: a folder or a video that is not there, or both cameras and a folder.
    """
    if watch is not None and cameras:
        raise InputError("--watch and --camera: photos come from a folder, or from a camera; give one of them")
    if len(cameras) > 1:
        raise InputError(f"--camera: {len(cameras)} cameras; calib.live_rig takes photos with several")
    require_size_used(cameras, size)
    if watch is not None:
        return (WatchedFolder(place_of(watch, "a folder")),)
    return tuple(OpenCVCamera(str(one), size) for one in cameras) or (BrowserCamera(),)
