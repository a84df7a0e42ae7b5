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
    from calib.capture.serving import Heard
    from calib.capture.session import Session
    from designer.page.output import Output
    from designer.target import TargetGeometry

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
    from calib.app.rig import rig
    from designer.page.page_file import why_no_page

    folders = _folders(watch)
    if (count := len(cameras) + len(folders)) < 2:
        raise InputError(f"{count} cameras; give two or more, or take photos with one by calib.live")

    def check(to: "Output") -> None:
        SolvedRig.check(to.place)
        if why := why_no_page(to.place, SolvedRig.kind):
            raise InputError(why)

    def solve(session: "Session", to: "Output", progress: Progress) -> SolvedRig:
        table = session.folder.write_table({moment: kept.files for moment, kept in session.counted.items()})
        return rig(target, table=table, model=model, criteria=criteria, made=made, progress=progress, out=to)

    return _taken(
        target, out, (cameras, folders, size), check, solve, resume=resume, model=model, made=made, criteria=criteria,
        port=port, browser=browser, opened=opened, heard=heard,
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
    from calib.app.run import run
    from calib.solver.plan import models_of

    folders = _folders(watch)
    if not (folders and cameras) and len(cameras) + len(folders) > 1:
        flag = f"--camera: {len(cameras)} cameras" if cameras else f"--watch: {len(folders)} folders"
        raise InputError(f"{flag}; calib.live_rig takes photos with several")

    def check(to: "Output") -> None:
        RunFolder(to, models_of(model)).require_room()

    def solve(session: "Session", to: "Output", progress: Progress) -> Run:
        return run(target, session.photos, model=model, criteria=criteria, made=made, progress=progress, out=to)

    return _taken(
        target, out, (cameras, folders, size), check, solve, resume=resume, model=model, made=made, criteria=criteria,
        port=port, browser=browser, opened=opened, heard=heard,
    )  # fmt: skip


def _folders(watch: "Place | Sequence[Place]") -> list[Path]:
    given = [watch] if isinstance(watch, str | PathLike) else watch
    return [place_of(one, "a folder") for one in given]


def _taken(
    target: "TargetGeometry | Place", out: "Output | Place",
    given: tuple[Sequence[str | int], list[Path], tuple[int, int] | None], check: Callable[["Output"], None],
    solve: Callable[["Session", "Output", Progress], R], *, resume: bool, model: str, made: str | None, criteria: str,
    port: int, browser: bool, opened: "Heard | None", heard: "Heard",
) -> R:  # fmt: skip
    """What comes of the photos of a session: solved, judged, and drawn, as the page is to show it at the end.

    Args:
        given: cameras, watched folders, and the size that cameras are asked for.
        check: refuses a place that does not take what is made there.
        solve: makes the whole run of a session's photos.
    """
    from importlib.util import find_spec

    for name in NEEDED:
        if find_spec(name) is None:
            raise InputError(
                f"calib live needs {name}, which is not installed; pip install 'ringsolid[live]' brings it"
            )
    from calib.app.inputs import target_of
    from calib.capture.photo_folder import SESSION_FILE, PhotoFolder
    from calib.capture.server import bound_socket
    from calib.capture.serving import Serving
    from calib.capture.session import Session
    from calib.capture.sources import require_apart, sources_of
    from calib.judge.rig_guide import RigGuide
    from designer.base.answer import command_line
    from designer.page.output import output_of

    geometry, sources, to = target_of(target, "rings"), sources_of(*given), output_of(out)
    require_apart(given[1], to.place)
    check(to)
    guide = RigGuide(geometry, tuple(sources), criteria=criteria, model=model, made=made)
    shown = guide.names if len(sources) > 1 else tuple(source.name for source in sources.values())
    photos = PhotoFolder(to.place, geometry, shown, resume=resume, cameras=guide.names)
    of_session: list[Path] = [photos.photos, photos.folder / SESSION_FILE]

    def solved(session: Session) -> R:
        def tell(what: str, done: float, total: int) -> None:
            session.report("solving", f"{what} {done:.0f} of {total}" if total else what)

        to.files, to.finished, to.answer = [], [*of_session], {}  # when made again, the first attempt does not count
        found = solve(session, to, tell)
        session.report("solving", "drawing the page")
        to.files += found.drawn_in(to.place, command_line())
        session.report("done", str(found.verdict.sentence))
        return found

    def open_page(address: str) -> None:
        import webbrowser

        heard(f"open {address}")
        if browser:
            webbrowser.open(address)

    with bound_socket(port) as bound:
        photos.begin()
        to.finished += of_session
        serving = Serving(
            lambda tell, show: Session(guide, photos, tuple(sources.values()), tell, show), solved, heard
        )  # fmt: skip
        return serving.until_done(bound, opened or open_page)
