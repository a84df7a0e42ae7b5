"""Images of bags as photos: `photos_in("run.mcap", "/cam/image_raw")`, the stillest of each part of the motion.

A bag is gone through once, for time stamps and thumbnails; an image is read again, alone, when it is searched. How much
the picture, or the robot, moves from image to image parts a recording in equal ways; of each part the image is taken
around which it moves least. Where a recording stops and goes, those in motion are left out.
"""

import re
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.images.bag import IMAGES, Bag, MessagePlace, Topic, bag_named, photo_of_message, stamp_ns
from calib.images.headers import DamagedError
from calib.images.photo import Photo
from calib.observe.photos import FoundPhotos, PhotoFile
from calib.observe.rig_photos import RigPhoto, RigPhotos, camera_names_of
from calib.observe.robot_poses import STILL_MM, RobotPoses, way_mm
from calib.observe.transforms import order_fault
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.base.words import counted, printable, shown

MOST_PHOTOS = 100
"""Of a recording that are searched; more tell next to nothing more."""
THUMB_PX = 64
MUCH_FASTER, STILL_GREY = 3.0, 1.0
"""Images around which it moves so many times faster than around a fourth of those chosen, and by more than this, are
left out."""


@dataclass(eq=False)
class BagImages:
    """The images of a topic in the order of their stamps."""

    bag: Bag
    topic: Topic
    places: list[MessagePlace] = field(default_factory=list)
    stamp_ns: list[int] = field(default_factory=list)
    thumbs: list[NDArray[np.uint8]] = field(default_factory=list)
    unread: list[str] = field(default_factory=list)  # why images are none
    without_stamp: int = 0
    back: str = ""  # stamps that go back

    @property
    def time_s(self) -> Array:
        """Their stamps.  # (N,)"""
        return 1e-9 * np.array(self.stamp_ns, dtype=np.float64)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a person should know of them."""
        name, said = printable(self.topic.name), list(self.bag.loss([self.topic]))
        if self.unread:
            said.append(f"{counted(len(self.unread), 'image')} of {name} cannot be read, the first: {self.unread[0]}")
        if self.without_stamp:
            said.append(
                f"{counted(self.without_stamp, 'image')} of {name} have no time stamp: that of recording is taken"
            )
        if same := len(self.stamp_ns) - len(set(self.stamp_ns)):
            said.append(f"{counted(same, 'image')} of {name} have the time stamp of another")
        return (*said, *([self.back] if self.back else []))

    def photo(self, row: int) -> PhotoFile:
        """One as a photo, named by its stamp."""
        name = f"{self.stamp_ns[row]:019d}"
        again = row - bisect_left(self.stamp_ns, self.stamp_ns[row])
        path = self.bag.path / self.topic.name.strip("/") / (f"{name}-{again + 1}" if again else name)
        return PhotoFile(path, time_s=1e-9 * self.stamp_ns[row], opened=partial(self._opened, self.places[row], path))

    def _opened(self, place: MessagePlace, path: Path) -> Photo:
        try:
            return photo_of_message(self.bag.read(place, self.topic.type), self.topic.type)
        except DamagedError as error:
            raise InputError(f"{path}: {error}") from None


def images_in(bag: Bag, topics: Sequence[Topic]) -> dict[str, BagImages]:
    """The images of topics, of which one at least can be read; InputError: none of a topic can be; it says why."""
    found = {topic.name: BagImages(bag, topic) for topic in topics}
    for place, message in bag.messages(topics):
        images = found[place.topic]
        try:
            thumb = _thumb(message, images.topic.type)
        except DamagedError as error:
            images.unread.append(str(error))
            continue
        stamp = stamp_ns(message)
        images.without_stamp += stamp == 0
        images.places.append(place)
        images.stamp_ns.append(stamp or place.log_ns)
        images.thumbs.append(thumb)
    for images in found.values():
        if not images.places:
            why = (*images.unread, *bag.loss([images.topic]), "it holds none")[0]
            raise InputError(f"{bag.path}: no image of {printable(images.topic.name)} can be read: {why}")
        images.back = order_fault(f"{bag.path}: {printable(images.topic.name)}", images.time_s)
        order = np.argsort(images.stamp_ns, kind="stable").tolist()
        images.places, images.thumbs = [images.places[row] for row in order], [images.thumbs[row] for row in order]
        images.stamp_ns.sort()
    return found


def _thumb(message: object, kind: str) -> NDArray[np.uint8]:
    """A small picture, of 8 bits."""
    import cv2

    pixels = photo_of_message(message, kind, THUMB_PX).pixels
    small = cv2.resize(pixels, (THUMB_PX, THUMB_PX * 5 // 8), interpolation=cv2.INTER_AREA)
    return (small // (1 if pixels.dtype == np.uint8 else 257)).astype(np.uint8)


def photos_in(
    argument: str, topic: str | None = None, option: str = "", robot: RobotPoses | None = None
) -> FoundPhotos:
    """The chosen images of a topic of a bag, given as `run.mcap` or `run.mcap#/cam/image_raw`.

    Args:
        argument: the bag.
        topic: of images; None: that in the argument, or the only one.
        option: that names it; "": as the argument does.
        robot: whose motion chooses; None: that of the picture.

    Raises:
        InputError: no such bag or topic, or no image in it can be read.
    """
    path, named = bag_named(argument) or (Path(argument), None)
    bag = Bag(path)
    option = option or ("--topic" if topic else f"{path.name}#TOPIC")
    images = images_in(bag, [bag.topic(topic or named, option, *IMAGES)])
    (one,) = images.values()
    name = f"images of {printable(one.topic.name)}"
    rows, said = chosen(*_of_pictures([one]), STILL_GREY, name) if robot is None else _by_robot(one, robot, name)
    return FoundPhotos(tuple(one.photo(row) for row in rows), remarks=(*one.remarks, *said))


def rig_photos_in(argument: str, topics: Sequence[str], tolerance_s: float) -> RigPhotos:
    """The chosen images of several cameras, joined by their stamps.

    Raises:
        InputError: fewer than two topics, one that is not there, none joined, or stamps that go back.
    """
    from calib.observe.rig_search import joined_by_time

    bag = Bag((bag_named(argument) or (Path(argument), None))[0])
    if len(topics) < 2:
        raise InputError(
            f"{argument}: a rig needs the topics of two cameras or more: --topics A,B; there are {bag.listed(*IMAGES)}"
        )
    each = images_in(bag, [bag.topic(name, "--topics", *IMAGES) for name in topics])
    if len(each) < len(topics):
        raise InputError(f"--topics {shown(','.join(topics))}: two are the same; a camera has a topic of its own")
    if back := next((one.back for one in each.values() if one.back), ""):
        raise InputError(back)
    names = camera_names_of([Path("/", re.sub(r"/compressed$", "", name)) for name in each])
    photos, row_of = list[RigPhoto](), dict[Path, tuple[int, int]]()
    for number, (name, images) in enumerate(zip(names, each.values(), strict=True)):
        for row in range(len(images.places)):
            photos.append(RigPhoto.taken(name, images.photo(row)))
            row_of[photos[-1].path] = number, row
    joined = joined_by_time(photos, tolerance_s)
    rows = {name: [-1] * len(each) for name in joined.frame_names}
    for taken in joined.photos:
        number, row = row_of[taken.path]
        rows[taken.frame][number] = row
    frames = [name for name in joined.frame_names if sum(row >= 0 for row in rows[name]) > 1]
    kept, said = chosen(*_of_pictures(list(each.values()), [rows[name] for name in frames]), STILL_GREY, "moments")
    wanted = {frames[row] for row in kept} if said else set(joined.frame_names)
    return RigPhotos(
        tuple(photo for photo in joined.photos if photo.frame in wanted),
        tuple(name for name in joined.frame_names if name in wanted),
        (*joined.remarks, *(one for images in each.values() for one in images.remarks), *said),
    )


def _of_pictures(each: Sequence[BagImages], rows: Sequence[Sequence[int]] | None = None) -> tuple[Array, Array]:
    """How much the pictures change to the next moment, and around each, in grey levels.  # (N - 1,), (N,)"""
    import cv2

    rows = [[row] for row in range(len(each[0].places))] if rows is None else rows
    step = np.zeros(len(rows) - 1)
    for number, images in enumerate(each):
        own = [one[number] for one in rows]
        pairs = [(images.thumbs[a], images.thumbs[b]) if min(a, b) >= 0 else None for a, b in pairwise(own)]
        change = [0.0 if pair is None else float(cv2.absdiff(*pair).mean()) for pair in pairs]
        step = np.maximum(step, change)
    ends = np.concatenate([step[:1], step, step[-1:]]) if len(step) else np.zeros(2)
    return step, np.maximum(ends[:-1], ends[1:])


def _by_robot(images: BagImages, robot: RobotPoses, name: str) -> tuple[list[int], tuple[str, ...]]:
    """The images at which the robot's pose is known and it moves least."""
    time_s = images.time_s
    if images.back:
        raise InputError(images.back)
    known = np.flatnonzero(robot.is_known(time_s))
    if not len(known) or robot.time_s is None:
        begin, end = ("-", "-") if robot.time_s is None else (f"{robot.time_s[0]:.3f}", f"{robot.time_s[-1]:.3f}")
        raise InputError(
            f"{robot.origin}: is of {begin} to {end} s, the images of {time_s[0]:.3f} to {time_s[-1]:.3f} s: none has "
            "a pose; give the poses of the same recording"
        )
    at = robot.at(time_s[known])
    around = robot.moves_mm(time_s[known])
    rows, said = chosen(way_mm(at[:-1], at[1:]), around, STILL_MM, name, keeps_few=False)
    lost = (f"{len(time_s) - len(known)} of {counted(len(time_s), 'image')} are of times without a robot pose",)
    return [int(known[row]) for row in rows], (*(lost if len(known) < len(time_s) else ()), *said)


def chosen(
    step: Array, around: Array, still: float, what: str, *, keeps_few: bool = True, most: int = MOST_PHOTOS
) -> tuple[list[int], tuple[str, ...]]:
    """The stillest moment of each of equal parts of a motion, and a word on it.

    Args:
        step: from each moment to the next (N - 1,).
        around: how much it moves around each (N,).
        still: moves around by no more stand still.
        what: they are, for the word.
        keeps_few: no more than `most` are all kept.
        most: that are kept.
    """
    count = len(around)
    if count <= most and keeps_few:
        return list(range(count)), ()
    way = np.concatenate([[0.0], np.cumsum(step)])
    way = way / way[-1] if way[-1] > 0 else np.linspace(0, 1, count)
    part = np.arange(count) if count <= most else np.minimum((way * most).astype(int), most - 1)
    order = np.lexsort((around, part))
    rows = np.sort(order[np.flatnonzero(np.diff(part[order], prepend=-1))])
    rows = rows[around[rows] <= max(MUCH_FASTER * float(np.percentile(around[rows], 25)), still)]
    return rows.tolist(), (f"{len(rows)} of {count} {what} are searched: those around which least moves",)
