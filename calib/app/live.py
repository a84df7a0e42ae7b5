"""Photos taken under guidance, to the judged camera or rig: `calib live`, `calib.live("ico.target.json", "camera")`."""

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar, cast

from calib.app import options
from calib.app.calibration import Run
from calib.app.solved_rig import SolvedRig
from designer.base.errors import InputError
from designer.base.files import place_of
from designer.base.options import option
from designer.page.capability import capability, instead, written_to
from designer.page.progress import Progress

if TYPE_CHECKING:
    from calib.app.inputs import Place
    from calib.capture.conversation import Begin, Conversation
    from calib.capture.photo_folder import PhotoFolder
    from calib.capture.serving import Heard
    from designer.page.output import Output

S = TypeVar("S", bound="Conversation")
R = TypeVar("R", Run, SolvedRig)
NEEDED = ("starlette", "uvicorn", "websockets")
Out = Annotated["Output | Place", written_to("folder of photos and results (default: exports/NAME/live)")]
Cameras = Annotated[
    Sequence[str | int],
    option(
        "a camera's number (0), its address (rtsp://...), or a video; again for each of a rig (default: the browser's)",
        flag="--camera", is_many=True,
    ),
]  # fmt: skip
Watched = Annotated[
    "Place | Sequence[Place]",
    option(
        "instead: the folder that another program writes photos to; again for each of a rig", metavar="DIR",
        is_many=True,
    ),
]  # fmt: skip
Limits = Annotated[str, options.LIMITS]
GoOn = Annotated[bool, option("go on with the session in the folder")]
Port = Annotated[int, option("of the page, on this machine (0: any)", 0, 65535)]
InBrowser = Annotated[bool, option("open the page in the browser", flag="--open", off="--no-open")]


def unheard(line: str) -> None:
    """A line of which nobody is told."""


def _folder(given: Mapping[str, object]) -> Path:
    return options.exports_folder(cast(Path, given["target"])) / "live"


@capability(folder=_folder, draws=True)
def live_rig(
    target: options.Target,
    out: Out,
    *,
    cameras: Cameras = (),
    watch: Watched = (),
    size: options.CameraSize = None,
    resume: GoOn = False,
    model: options.Model = "all",
    made: options.Made = None,
    criteria: Limits = "standard",
    port: Port = 0,
    browser: InBrowser = True,
    opened: "Heard | None" = None,
    heard: "Heard" = unheard,
) -> SolvedRig:
    """Take photos under guidance with several cameras: `live_rig("ico.target.json", "rig", cameras=[0, 1])`.

    As `live`; at the end all is as after `calib.rig` of the photos.

    Args:
        opened: is told the page's address instead.
        heard: is told a line of each photo, and of what goes wrong.

    Raises:
        InputError: files, cameras or options that do not do, a folder that holds another session, or photos that
            determine no rig.
    """
    from calib.app.inputs import target_of
    from calib.app.rig import rig
    from calib.capture.photo_folder import PhotoFolder
    from calib.capture.rig_session import RigSession, write_table
    from calib.capture.sources import require_apart, rig_sources
    from calib.judge.rig_guide import RigGuide
    from designer.page.output import output_of
    from designer.page.page_file import why_no_page

    folders = _folders(watch)
    if (count := len(cameras) + len(folders)) < 2:
        raise InputError(f"{count} cameras; give two or more, or take photos with one by calib.live")
    _require_server()
    geometry, sources = target_of(target, "rings"), rig_sources(cameras, folders, size)
    to = output_of(out)
    SolvedRig.check(to.place)
    require_apart(folders, to.place)
    if why := why_no_page(to.place, SolvedRig.kind):
        raise InputError(why)
    guide = RigGuide(geometry, tuple(sources), criteria=criteria, model=model, made=made)
    photos = PhotoFolder(to.place, geometry, guide.names, resume=resume, cameras=guide.names)

    def solve(session: RigSession, progress: Progress) -> SolvedRig:
        table = write_table(session)
        return rig(target, table=table, model=model, criteria=criteria, made=made, progress=progress, out=to)

    return _taken(
        lambda tell, show: RigSession(geometry, guide, photos, tuple(sources.values()), tell, show), solve, photos, to,
        port, _opener(opened, heard, browser=browser), heard,
    )  # fmt: skip


@instead(cameras=live_rig, watch=live_rig)
@capability(folder=_folder, draws=True)
def live(
    target: options.Target,
    out: Out,
    *,
    cameras: Cameras = (),
    watch: Watched = (),
    size: options.CameraSize = None,
    resume: GoOn = False,
    model: options.Model = "all",
    made: options.Made = None,
    criteria: Limits = "standard",
    port: Port = 0,
    browser: InBrowser = True,
    opened: "Heard | None" = None,
    heard: "Heard" = unheard,
) -> Run:
    """Take photos under guidance of a page, until the camera is good: `live("ico.target.json", "camera")`.

    The page shows where to hold the target next. Nothing leaves this machine. Photos are written as they are taken; at
    the end the folder is as after calib run.

    Args:
        opened: is told the page's address instead, once.
        heard: is told a line of each photo, and of what goes wrong.

    Raises:
        InputError: files, cameras or options that do not do, a folder that holds another session, or photos that
            determine no camera.
    """
    from calib.app.calibration_folder import RunFolder
    from calib.app.inputs import target_of
    from calib.app.run import run
    from calib.capture.photo_folder import PhotoFolder
    from calib.capture.session import Session
    from calib.capture.sources import (
        BrowserCamera,
        OpenCVCamera,
        Source,
        WatchedFolder,
        require_apart,
        require_size_used,
    )
    from calib.judge.guide import Guide
    from calib.solver.plan import models_of
    from designer.page.output import output_of

    folders = _folders(watch)
    if folders and cameras:
        raise InputError("--watch and --camera: photos come from a folder, or from a camera; give one of them")
    if len(cameras) + len(folders) > 1:
        flag = f"--camera: {len(cameras)} cameras" if cameras else f"--watch: {len(folders)} folders"
        raise InputError(f"{flag}; calib.live_rig takes photos with several")
    _require_server()
    require_size_used(cameras, size)
    geometry, sources = target_of(target, "rings"), list[Source](map(WatchedFolder, folders))
    sources += (OpenCVCamera(str(one), size) for one in cameras)
    sources = sources or [BrowserCamera()]
    to = output_of(out)
    writer = RunFolder(to, models_of(model))
    require_apart(folders, writer.folder)
    writer.require_room()
    guide = Guide(geometry, criteria=criteria, model=model, made=made)
    photos = PhotoFolder(writer.folder, geometry, tuple(one.name for one in sources), resume=resume)

    def solve(session: Session, progress: Progress) -> Run:
        return run(target, session.photos, model=model, criteria=criteria, made=made, progress=progress, out=to)

    return _taken(
        lambda tell, show: Session(geometry, guide, photos, tuple(sources), tell, show), solve, photos, to, port,
        _opener(opened, heard, browser=browser), heard,
    )  # fmt: skip


def _require_server() -> None:
    """Refuse to begin without the web server.

    Raises:
        InputError: a part of it is not installed.
    """
    from importlib.util import find_spec

    for name in NEEDED:
        if find_spec(name) is None:
            raise InputError(
                f"calib live needs {name}, which is not installed; pip install 'ringsolid[live]' brings it"
            )


def _folders(watch: "Place | Sequence[Place]") -> list[Path]:
    given = [watch] if isinstance(watch, str | PathLike) else watch
    return [place_of(one, "a folder") for one in given]


def _opener(opened: "Heard | None", heard: "Heard", *, browser: bool) -> "Heard":
    """What is told the page's address: who called, or else a person, and the browser."""
    if opened is not None:
        return opened

    def tell(address: str) -> None:
        import webbrowser

        heard(f"open {address}")
        if browser:
            webbrowser.open(address)

    return tell


def _taken(
    begin: "Begin[S]", solve: Callable[[S, Progress], R], photos: "PhotoFolder", to: "Output", port: int,
    opened: "Heard", heard: "Heard",
) -> R:  # fmt: skip
    """What comes of the photos of a session: solved, judged, and drawn, as the page is to show it at the end."""
    from calib.capture.photo_folder import SESSION_FILE
    from calib.capture.server import bound_socket
    from calib.capture.serving import Serving
    from designer.base.answer import command_line

    of_session: list[Path] = [photos.photos, photos.folder / SESSION_FILE]

    def solved(session: S) -> R:
        def tell(what: str, done: float, total: int) -> None:
            session.report("solving", f"{what} {done:.0f} of {total}" if total else what)

        to.files, to.finished, to.answer = [], [*of_session], {}  # when made again, the first attempt does not count
        found = solve(session, tell)
        session.report("solving", "drawing the page")
        to.files += found.drawn_in(to.place, command_line())
        return found

    with bound_socket(port) as bound:
        photos.begin()
        to.finished += of_session
        return Serving(begin, solved, heard).until_done(bound, opened)
