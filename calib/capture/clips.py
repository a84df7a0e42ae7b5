"""Photos from clips: the frames in which a target stands still, is sharp, and tells most of the camera.

First the clips are read through for how much each frame differs from those around it, all on one clock. The stillest of
each short window are looked at as frames are that come from a camera (`calib.capture.session`): what moves, is blurred
or shows the same once more is left out. Of many the most informative are taken (`calib.judge.greedy`).
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from calib.core.types import LEAST_POINTS, Detections
from calib.detector.frame_quality import FrameQuality, frame_quality
from calib.detector.glance import look_quickly
from calib.images.photo import Grey, Photo
from calib.images.video import Clip, calls_itself_clip, frames_of, open_clip
from calib.judge.greedy import InformativeCandidates
from calib.judge.guide_state import insight_of, settings_of
from calib.judge.information import image_goal, knowledge_of, view_information
from calib.judge.live_frame import FAST, moved_px, notes_of, shows_same
from calib.judge.view_search import COARSE_MAP
from calib.observe.photos import FoundPhotos, PhotoFile
from calib.observe.rig_photos import RigPhoto, RigPhotos, camera_names_of, read_stamps, with_stamps
from calib.observe.rig_search import RigInput, joined_by_time
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import counted
from designer.page.progress import Progress
from designer.target import TargetGeometry

STEP_S = 0.1
"""Between frames that are compared."""
WINDOW_S, MOST_WINDOWS = 0.5, 240
"""Of each the stillest frame is looked at; of long clips windows are longer."""
MOST_TAKEN, FEWEST_TAKEN = 60, 12
MOST_BYTES = 2**29
"""Of pixels that are kept in memory."""
SMALL_PX = 240
"""The longer side of what is compared."""
STILLEST = 3 * FAST
"""As for `FAST`: where hardly anything stands still, what moves no faster than this is taken too."""
FEWEST_ALIKE, APART, ALIKE, MORE_ALIKE = 30, 3, 0.6, 0.1
"""Steps that clips share; steps between shifts that differ; correlation by which they are set to one clock, and how
much more it is than at others."""
LEAST_MOST = 1e-3, 1e3
OF_A_CLIP = (
    "frames of a clip are compressed, and may be cropped or stabilised: the camera is that of such clips, not of photos"
)
VAGUE = 100.0
"""Times what all frames tell of the camera: so little is known before the first is chosen."""


@dataclass(frozen=True, eq=False)
class _Motion:
    """How much a clip's frames differ from those before, by steps of one clock."""

    number: dict[int, int]  # of the frame, by its step
    still: dict[int, float]  # the larger difference to the steps before and after, of the usual one


@dataclass(frozen=True, eq=False)
class _Look:
    """What a quick look at a frame tells."""

    time_s: float
    found: Detections
    speed_px_s: float
    quality: FrameQuality | None


@dataclass(frozen=True, eq=False)
class ClipPhotos:
    """Frames of clips, by camera and moment."""

    of: Mapping[str, Mapping[int, PhotoFile]]  # by the clips' names, by moments that they share
    remarks: tuple[str, ...]


def photos_of_clip(path: Path, target: TargetGeometry, progress: Progress) -> FoundPhotos:
    """The frames of one clip to be searched, named CLIP-NUMBER; InputError: no frame of it can be read."""
    found = photos_of_clips({"": path}, target, progress)
    return FoundPhotos(tuple(found.of[""].values()), remarks=found.remarks)


def holds_photos(path: Path) -> bool:
    """Whether it is a folder or a clip."""
    return path.is_dir() or calls_itself_clip(path)


def clips_of_rig(given: RigInput, target: TargetGeometry, progress: Progress) -> RigPhotos | None:
    """The frames of a rig's clips, one a camera, joined by their times; None: no clips are given.

    Raises:
        InputError: clips and folders, one clip alone, or one that cannot be read.
    """
    paths = [Path(one) for one in given.photos]
    clips = [path for path in paths if calls_itself_clip(path)]
    if not clips:
        return None
    if len(clips) < len(paths) or len(clips) < 2:
        what = "one clip" if len(paths) == 1 else "clips and folders"
        raise InputError(f"{clips[0]}: {what}; give a clip a camera, or a folder of photos a camera")
    if given.pattern is not None:
        raise InputError("--pattern: is of the files in folders; leave it out with clips")
    names = camera_names_of([path.with_suffix("") for path in clips])
    asked = tuple(RigPhoto(name, path) for name, path in zip(names, clips, strict=True))
    start_s = None
    if given.times is not None:
        stamped = with_stamps(asked, read_stamps(given.times, asked))
        start_s = {one.camera: one.time_s or 0.0 for one in stamped}
    found = photos_of_clips({one.camera: one.path for one in asked}, target, progress, start_s)
    photos = [RigPhoto.taken(name, photo) for name, own in found.of.items() for photo in own.values()]
    joined = joined_by_time(photos, given.tolerance_s or 0.5 * STEP_S)
    return replace(joined, remarks=(*found.remarks, *joined.remarks))


def photos_of_clips(
    paths: Mapping[str, Path], target: TargetGeometry, progress: Progress, start_s: Mapping[str, float] | None = None
) -> ClipPhotos:
    """The frames of clips that show one scene: each moment is still in all that see the target.

    Args:
        paths: of the clips.
        target: that they show.
        progress: is told how far the work is.
        start_s: when each begins, by one clock; None: as what moves in them tells, or all at once.

    Raises:
        InputError: no frame of one can be read.
    """
    told = list[str]()
    clips = {name: open_clip(path) for name, path in paths.items()}
    at = start_s or dict.fromkeys(paths, 0.0)
    motion = {name: _motion(clip, at[name], told, progress) for name, clip in clips.items()}
    if start_s is None and len(clips) > 1:
        at = _starts(motion, told)
        motion |= {name: _motion(clip, at[name], [], progress) for name, clip in clips.items() if at[name]}
    steps = _stillest(motion.values())
    looks, kept = dict[str, dict[int, _Look]](), dict[str, dict[int, Grey]]()
    for name, clip in clips.items():
        looks[name], kept[name] = _looked(clip, motion[name], steps, target, MOST_BYTES // len(clips), progress)
    taken, said = _taken(looks, {name: max(clip.image_size) for name, clip in clips.items()}, target)
    photos = {}
    for name, clip in clips.items():
        found = _photos(clip, {step: motion[name].number[step] for step in taken if step in looks[name]}, kept[name])
        photos[name] = {step: replace(one, time_s=looks[name][step].time_s + at[name]) for step, one in found.items()}
        told.append(f"{clip.path}: {counted(len(found), 'frame')} of {len(motion[name].number)} compared: {said}")
    return ClipPhotos(photos, tuple(told))


def _motion(clip: Clip, start_s: float, told: list[str], progress: Progress) -> _Motion:
    """How still each frame is, one in a step."""
    import cv2

    last, small, before = -math.inf, None, 0.0
    number, still = dict[int, int](), dict[int, float]()
    total = max(clip.stated_frames, 1)
    start_s += 0.5 * min(1 / clip.rate_hz, STEP_S)  # the frame nearest to a step's begin: a start is not known exactly

    def is_next(_: int, time_s: float) -> bool:
        return _step(time_s + start_s) > last

    shrink = max(1, round(max(clip.image_size) / SMALL_PX))
    size = tuple(max(1, side // shrink) for side in clip.image_size)
    for frame in frames_of(clip, is_next, told):
        now = cv2.resize(frame.pixels, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        difference = math.inf if small is None else float(np.abs(now - small).mean())
        if number:
            still[int(last)] = max(before, difference)
        last, small, before = _step(frame.time_s + start_s), now, difference
        number[int(last)], still[int(last)] = frame.number, difference
        progress(f"comparing frames of {clip.path.name}", min(frame.number, total), total)
    usual = float(np.median([one for one in still.values() if math.isfinite(one)] or [1.0])) or 1.0
    return _Motion(number, {step: one / usual for step, one in still.items()})


def _starts(motion: Mapping[str, _Motion], told: list[str]) -> dict[str, float]:
    """When each clip begins after the first, by when things move in both; 0 where that does not tell."""
    (first, own), *following = motion.items()
    start_s = {first: 0.0}
    for name, other in following:
        a, b = (np.log(np.clip([one for _, one in sorted(each.still.items())], *LEAST_MOST)) for each in (own, other))
        fewest = max(FEWEST_ALIKE, min(len(a), len(b)) // 2)
        lags = range(fewest - len(b), len(a) - fewest + 1)
        alike = np.array([_alike(a[max(lag, 0) :], b[max(-lag, 0) :]) for lag in lags])
        best = int(alike.argmax()) if len(alike) else 0
        others = alike[np.abs(np.arange(len(alike)) - best) > APART]
        if not len(alike) or alike[best] < max(ALIKE, others.max(initial=-1.0) + MORE_ALIKE):
            start_s[name] = 0.0
            told.append(f"{name} is taken to begin with {first}; --times tells when each clip begins")
            continue
        low, high = alike[max(best - 1, 0)], alike[min(best + 1, len(alike) - 1)]
        bend = low - 2 * alike[best] + high
        start_s[name] = STEP_S * (lags[best] + (0.5 * (low - high) / bend if bend < 0 else 0.0))
        order = "after" if start_s[name] >= 0 else "before"
        told.append(
            f"{name} begins {abs(start_s[name]):.2f} s {order} {first}, by when things move in both; "
            "--times tells it exactly"
        )
    return start_s


def _alike(a: Array, b: Array) -> float:
    """The correlation of two series as far as both go."""
    count = min(len(a), len(b))
    a, b = a[:count] - a[:count].mean(), b[:count] - b[:count].mean()
    return float(a @ b / max(math.sqrt(float((a @ a) * (b @ b))), 1e-12))


def _step(time_s: float) -> int:
    return math.floor(time_s / STEP_S + 1e-6)


def _stillest(motion: Iterable[_Motion]) -> list[int]:
    """The stillest step of each window, in all clips that have it."""
    still: dict[int, float] = {}
    for one in motion:
        for step, value in one.still.items():
            still[step] = still.get(step, 0.0) + value
    steps = sorted(still)
    window = max(WINDOW_S / STEP_S, math.ceil((steps[-1] - steps[0] + 1) / MOST_WINDOWS))
    best: dict[int, int] = {}
    for step in steps:
        place = int((step - steps[0]) // window)
        if place not in best or still[step] < still[best[place]]:
            best[place] = step
    return list(best.values())


def _looked(
    clip: Clip, motion: _Motion, steps: Sequence[int], target: TargetGeometry, most_bytes: int, progress: Progress
) -> tuple[dict[int, _Look], dict[int, Grey]]:
    """What is seen at some steps of a clip, and their pixels by the frames' numbers, as many as may be kept."""
    order = sorted(motion.number)
    place = {step: row for row, step in enumerate(order)}
    # Each is compared with the frame before it.
    before = {step: order[max(place[step] - 1, 0)] for step in steps if step in place}
    step_of = {motion.number[step]: step for step in {*before, *before.values()}}
    seen, kept, looks = dict[int, tuple[float, Detections]](), dict[int, Grey](), dict[int, _Look]()
    for frame in frames_of(clip, lambda number, _: number in step_of):
        step = step_of[frame.number]
        found = look_quickly(frame.pixels, target, f"frame {frame.number}")
        seen[step] = frame.time_s, found
        progress(f"looking at frames of {clip.path.name}", len(seen), len(step_of))
        if step not in before:
            continue
        earlier_s, earlier = seen.get(before[step], (frame.time_s, found))
        gap_s = frame.time_s - earlier_s
        speed = moved_px(earlier, found) / gap_s if gap_s > 0 else math.inf
        quality = frame_quality(frame.pixels, found, target)
        looks[step] = _Look(frame.time_s, found, speed, quality)
        if sum(one.nbytes for one in kept.values()) + frame.pixels.nbytes <= most_bytes and len(found.ring):
            kept[frame.number] = frame.pixels
    return looks, kept


def _taken(
    looks: Mapping[str, Mapping[int, _Look]], longer_px: Mapping[str, int], target: TargetGeometry
) -> tuple[list[int], str]:
    """The steps whose frames are taken, ascending, and by what, in words."""
    most = max(FEWEST_TAKEN, min(MOST_TAKEN, *(MOST_BYTES // (len(looks) * px**2) for px in longer_px.values())))
    speed: dict[int, float] = {}  # the largest of those that see the target, in longer sides a second
    for name, own in looks.items():
        blurs = [one.quality.blur_px for one in own.values() if one.quality and not notes_of(one.quality)]
        sharpest = min((blur for blur in blurs if blur > 0), default=math.inf)
        for step, one in own.items():
            if len(one.found.ring) < LEAST_POINTS:
                continue
            is_bad = any(note.forbids for note in notes_of(one.quality, sharpest))
            speed[step] = max(speed.get(step, 0.0), math.inf if is_bad else one.speed_px_s / longer_px[name])
    sharp = sorted((step for step in speed if math.isfinite(speed[step])), key=lambda step: speed[step])
    if not sharp or speed[sharp[0]] > STILLEST:  # the search says why
        every = sorted({step for own in looks.values() for step in own})
        rows = np.unique(np.linspace(0, len(every) - 1, FEWEST_TAKEN).astype(np.int64)).tolist()
        return [every[row] for row in rows], "spread over it, as none shows the target sharp and still"
    new = list[int]()
    for step in sharp:
        if not any(_shows_same(looks, step, other) for other in new):
            new.append(step)
    still = [step for step in new if speed[step] <= FAST]
    words = "sharp and still, each of another view"
    if len(still) < FEWEST_TAKEN:
        still = [step for step in new[:FEWEST_TAKEN] if speed[step] <= STILLEST]
    if (fastest := 100 * speed[still[-1]]) > 100 * FAST:
        words = f"moving by up to {fastest:.2g} % of the image a second; hold each view for half a second"
    if len(still) > most:
        words += f"; of {len(still)} those that tell most of the camera"
        each = [
            _informative({step: own[step].found for step in still if step in own}, target) for own in looks.values()
        ]
        first = [step for steps in zip(*each, strict=False) for step in steps]
        still = list(dict.fromkeys([*first, *still]))[:most]
    return sorted(still), words


def _shows_same(looks: Mapping[str, Mapping[int, _Look]], step: int, other: int) -> bool:
    """Whether two moments show the same in all clips."""
    both = [(own[step].found, own[other].found) for own in looks.values() if step in own and other in own]
    seeing = [(a, b) for a, b in both if len(a.ring) or len(b.ring)]
    return bool(seeing) and all(shows_same(a, b) for a, b in seeing)


def _informative(found: Mapping[int, Detections], target: TargetGeometry) -> list[int]:
    """The most informative, the best first, by a camera that all of them together tell; none if they tell none."""
    names = {one.image: step for step, one in found.items()}
    calibration = insight_of(list(found.values()), settings_of(target)).calibration
    if calibration is None:
        return []
    seen, known = calibration.observations, knowledge_of(calibration)
    weight = np.zeros((seen.view_count, len(seen.points.position_mm)))
    weight[seen.view, seen.point] = 1.0
    told = view_information(known, calibration.cam_from_target, seen.points.position_mm, weight)
    start: Array = VAGUE**2 * np.eye(told.shape[1])
    candidates = InformativeCandidates.by(told, np.ones(told.shape[:2], dtype=np.bool_))
    chosen = candidates.chosen(start, image_goal(known, *COARSE_MAP).change, MOST_TAKEN)
    return [names[seen.view_names[one.choice]] for one in chosen]


def _photos(clip: Clip, numbers: Mapping[int, int], kept: Mapping[int, Grey]) -> dict[int, PhotoFile]:
    """Frames as photos, by steps; what is not in memory is read again."""
    missing = set(numbers.values()) - set(kept)
    pixels = dict(kept)
    if missing:
        pixels |= {one.number: one.pixels for one in frames_of(clip, lambda number, _: number in missing)}
    return {
        step: PhotoFile(
            clip.path / f"{clip.path.stem}-{number:05d}",
            opened=partial(Photo, pixels[number], (*clip.remarks, OF_A_CLIP)),
            is_kept=True,
        )
        for step, number in numbers.items()
        if number in pixels
    }
