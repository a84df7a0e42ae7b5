"""Robots' bags without ROS: `Bag(Path("run.mcap")).topics`; rosbag1 (.bag), and rosbag2 of SQLite or MCAP.

Messages are of ROS's own types, whose definitions are known, so that a bag needs to hold none. Each file of a rosbag2
folder is opened on its own: a recording that ended too soon has no metadata.yaml. Nothing that a bag claims is believed
before as many bytes are there, and nothing is decompressed to more than `MOST_BYTES`.
"""

import heapq
import json
import re
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import BinaryIO, Protocol, cast

import numpy as np

from calib.images.headers import DamagedError
from calib.images.photo import MAX_PIXELS, Grey, Photo, grey_of, photo_of, preview_of
from designer.base.errors import InputError
from designer.base.words import cut, first_few, printable, shown

ROS1, STORAGES = ".bag", (".mcap", ".db3")
SUFFIXES = (ROS1, *STORAGES)
IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
IMAGES = (IMAGE, COMPRESSED)
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
TRANSFORMS, OLD_TRANSFORMS = "tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"
POSE, TRANSFORM = "geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/TransformStamped"
MOST_BYTES = 2**29
"""Of a chunk or a message once it is decompressed: an image of 250 million pixels, twice."""
MOST_TOPICS_TOLD = 12
MOST_SKIPS = 40
"""Times that reading goes on behind a damage; each leaps twice as far as the one before, until something is read."""
_FOLDER_FILE = re.compile(r"^\s*-\s*[\"']?([^\"'\n]+?\.(?:mcap|db3)(?:\.zstd)?)[\"']?\s*$", re.MULTILINE)
_ZSTD = b"\x28\xb5\x2f\xfd"
_REMEDY = {ROS1: "rosbag reindex", ".mcap": "mcap recover", ".db3": "ros2 bag reindex"}


class _Connection(Protocol):
    topic: str
    msgtype: str
    msgcount: int


class _BagReader(Protocol):
    """Of a file, as rosbags offers it."""

    connections: list[_Connection]
    start_time: int
    end_time: int
    message_count: int

    def open(self) -> None: ...

    def close(self) -> None: ...

    def messages(
        self, connections: Sequence[_Connection], start: int | None = None, stop: int | None = None
    ) -> Iterator[tuple[_Connection, int, bytes]]: ...


@dataclass(frozen=True)
class Topic:
    """What a bag holds under a name."""

    name: str
    type: str  # such as sensor_msgs/msg/Image
    count: int  # of messages

    @property
    def words(self) -> str:
        """As messages list it."""
        return f"{printable(cut(self.name))} ({printable(cut(self.type)).replace('/msg/', '/')}, {self.count})"


@dataclass(frozen=True)
class MessagePlace:
    """Where a message stands in a bag."""

    file: int
    topic: str
    log_ns: int  # when it was recorded
    nth: int  # of those of one topic and time
    begin: int = -1  # of its bytes in a file without an index of them
    size: int = 0


@dataclass(eq=False)
class Bag:
    """A bag that is open; threads may read from it."""

    path: Path
    topics: tuple[Topic, ...] = ()
    lost: Counter[str] = field(default_factory=Counter)  # messages of a topic that could not be read
    why: dict[str, str] = field(default_factory=dict)  # of the first of them
    _readers: list[_BagReader] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        files = _files_of(self.path)
        try:
            self._readers, self._decode = _opened(files)
            count: Counter[tuple[str, str]] = Counter()
            for one in (one for reader in self._readers for one in reader.connections):
                count[str(one.topic), str(one.msgtype)] += one.msgcount  # which a damaged table may lack
            self.topics = tuple(Topic(name, kind, n) for (name, kind), n in sorted(count.items()))
        except ImportError as error:  # also of a library that it is built on
            why = printable(cut(str(error), 120))
            raise InputError(f"{self.path}: robots' bags need an extra: pip install 'ringsolid[ros]' ({why})") from None
        except Exception as error:
            remedy = _REMEDY[files[0].suffix.lower()]
            raise InputError(
                f"{self.path}: cannot be read as a bag: {_why(error)}; copy it again, or mend its index with {remedy}"
            ) from None

    def of_types(self, *types: str) -> tuple[Topic, ...]:
        """Its topics of some types that hold messages."""
        return tuple(topic for topic in self.topics if topic.type in types and topic.count)

    def topic(self, name: str | None, option: str, *types: str) -> Topic:
        """A topic by its name, or the only one of some types.

        Raises:
            InputError: there is none, or several; it lists what there is.
        """
        fitting, what = self.of_types(*types), types[0].rpartition("/")[2]
        named = [one for one in self.topics if name is not None and one.name.strip("/") == name.strip("/")]
        right = [one for one in fitting if name is None or one in named]
        if len(right) == 1:
            return right[0]
        why = f"several topics of type {what}, name one with {option}" if right else f"no messages of type {what}"
        if named:
            kind = printable(cut(named[0].type))
            why = f"{option} {shown(name)}: {'holds no message' if named[0].type in types else f'is of type {kind}'}"
        elif name is not None:
            why = f"{option} {shown(name)}: no such topic"
        raise InputError(f"{self.path}: {why}; there are {self.listed(*types)}")

    def listed(self, *types: str) -> str:
        """Its topics of some types, or all if there are none, as messages list them."""
        return first_few([one.words for one in self.of_types(*types) or self.topics], MOST_TOPICS_TOLD) or "no topics"

    def messages(self, topics: Sequence[Topic]) -> Iterator[tuple[MessagePlace, object]]:
        """The messages of topics in the order of their recording; those that a damage takes are counted as lost."""
        nth: Counter[tuple[int, str, int]] = Counter()
        each = [self._of_file(number, topics) for number in range(len(self._readers))]
        got: Counter[str] = Counter()
        for log_ns, file, topic, raw, end in heapq.merge(*each, key=lambda one: one[0]):
            begin = end - len(raw) if end else -1
            place = MessagePlace(file, topic.name, log_ns, nth[file, topic.name, log_ns], begin, len(raw))
            nth[file, topic.name, log_ns] += 1
            try:
                message = self._decode(raw, topic.type)
            except Exception as error:
                self.why.setdefault(topic.name, _why(error))
                continue
            got[topic.name] += 1
            yield place, message
        for topic in topics:
            self.lost[topic.name] = max(0, topic.count - got[topic.name])

    def _of_file(self, number: int, topics: Sequence[Topic]) -> Iterator[tuple[int, int, Topic, bytes, int]]:
        """Those of one file, and where each ends if no index tells; behind a damage reading goes on, ever farther."""
        reader, known = self._readers[number], {(one.name, one.type): one for one in topics}
        wanted = [one for one in reader.connections if (one.topic, one.msgtype) in known]
        if not wanted:
            return
        begin, end, file = reader.start_time, reader.end_time, _without_index(reader)
        leap = first = max(1, (end - begin) // 10_000)
        for _ in range(MOST_SKIPS):
            try:
                for one, log_ns, raw in reader.messages(wanted, start=begin):
                    begin, leap = max(begin, log_ns + 1), first
                    yield log_ns, number, known[one.topic, one.msgtype], raw, 0 if file is None else file.tell()
                return
            except Exception as error:
                for one in wanted:
                    self.why.setdefault(one.topic, _why(error))
            begin, leap = begin + leap, 2 * leap
            if begin >= end:
                return

    def read(self, place: MessagePlace, kind: str) -> object:
        """A message again, of a type; InputError: it cannot be read."""
        reader = self._readers[place.file]
        try:
            with self._lock:
                if place.begin >= 0 and (file := _without_index(reader)) is not None:
                    file.seek(place.begin)
                    return self._decode(file.read(place.size), kind)
                wanted = [one for one in reader.connections if (one.topic, one.msgtype) == (place.topic, kind)]
                found = reader.messages(wanted, start=place.log_ns, stop=place.log_ns + 1)
                raw = next(raw for nth, (_, _, raw) in enumerate(found) if nth == place.nth)
            return self._decode(raw, kind)
        except Exception as error:
            raise InputError(f"{self.path}: {place.topic} at {1e-9 * place.log_ns:.6f} s: {_why(error)}") from None

    def loss(self, topics: Sequence[Topic]) -> tuple[str, ...]:
        """What was not read of topics, a line each."""
        count = sum(reader.message_count for reader in self._readers) - sum(topic.count for topic in self.topics)
        nameless = f"{self.path.name}: {count} messages are of no topic, and left out: it is damaged"
        lost = (
            f"{self.path.name}: {self.lost[one.name]} of {one.count} messages of {printable(cut(one.name))} cannot be "
            f"read and are left out ({self.why.get(one.name, 'they are not where the index has them')})"
            for one in topics
            if self.lost[one.name]
        )
        return (*lost, *((nameless,) if count > 0 else ()))


def _without_index(reader: _BagReader) -> BinaryIO | None:
    """The file of an MCAP whose messages are not in chunks, so that each would be looked for from its beginning."""
    storage = getattr(reader, "storage", None)
    file = getattr(storage, "bio", None)
    return None if file is None or getattr(storage, "chunks", True) else cast(BinaryIO, file)


def is_bag(path: Path) -> bool:
    """Whether a place is a bag by its name, or a folder that holds one's files."""
    if path.is_dir():
        named = (path / "metadata.yaml").is_file()
        return named or (any(_storages_in(path)) and all(one.suffix in STORAGES for one in path.iterdir()))
    return path.suffix.lower() in SUFFIXES


def bag_named(argument: str) -> tuple[Path, str | None] | None:
    """The bag and the topic that a text names, as in `run.mcap#/cam/image_raw`; None: it names no bag."""
    text, _, topic = argument.partition("#")
    is_named = bool(text) and is_bag(Path(text)) and not (topic and Path(argument).exists())
    return (Path(text), topic or None) if is_named else None


def _storages_in(folder: Path) -> list[Path]:
    try:
        return sorted(one for one in folder.iterdir() if one.suffix.lower() in STORAGES and one.is_file())
    except OSError:
        return []


def _files_of(path: Path) -> tuple[Path, ...]:
    """The files of a bag; InputError: they are not there."""
    if not path.is_dir():
        if not path.is_file():
            raise InputError(f"{path}: no such file; give a .bag, .mcap or .db3 file, or the folder of a rosbag2")
        if path.stat().st_size == 0:
            raise InputError(f"{path}: is empty (0 bytes); copy it again")
        return (path,)
    metadata = path / "metadata.yaml"
    text = metadata.read_text(errors="replace")[: 2**20] if metadata.is_file() else ""
    named = [Path(one).name for one in _FOLDER_FILE.findall(text)]
    if packed := [name for name in named if name.endswith(".zstd")]:
        raise InputError(f"{path}: {packed[0]} is compressed as a whole; unpack it with zstd -d, and give that file")
    if missing := [name for name in named if not (path / name).is_file()]:
        raise InputError(f"{path}: {first_few(missing)} of its metadata.yaml is not there; copy the whole folder")
    files = tuple(path / name for name in dict.fromkeys(named)) or tuple(_storages_in(path))
    if not files:
        raise InputError(f"{path}: holds no .mcap or .db3 file; give the folder of a rosbag2, or a .bag")
    return files


def _opened(files: Sequence[Path]) -> tuple[list[_BagReader], Callable[[bytes, str], object]]:
    """Readers of files, and what decodes their messages."""
    import rosbags.rosbag1
    import rosbags.rosbag2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    unpacked = _bounded_memory()
    is_first = files[0].suffix.lower() == ROS1
    readers: list[_BagReader] = []
    for file in files:
        reader = cast(_BagReader, (rosbags.rosbag1 if is_first else rosbags.rosbag2).Reader(file))
        reader.open()
        readers.append(reader)
    store = get_typestore(Stores.ROS1_NOETIC if is_first else Stores.LATEST)
    if is_first:  # which knows neither
        for kind in (TRANSFORMS, OLD_TRANSFORMS):
            store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", kind))
        return readers, store.deserialize_ros1

    def decode(raw: bytes, kind: str) -> object:
        return store.deserialize_cdr(unpacked(raw) if raw[:4] == _ZSTD else raw, kind)

    return readers, decode


def _bounded_memory() -> Callable[[bytes], bytes]:
    """Let no chunk grow without end, as the readers' decompressors believe what it says; that of zstd."""
    from bz2 import BZ2Decompressor

    from lz4.frame import LZ4FrameDecompressor
    from rosbags.rosbag1 import reader
    from rosbags.rosbag2 import storage_mcap

    def bounded(kind: Callable[[], BZ2Decompressor]) -> Callable[..., bytes]:
        def decompress(data: bytes, *_: int) -> bytes:
            unpacking = kind()
            found = unpacking.decompress(data, max_length=MOST_BYTES)
            if not unpacking.eof:
                raise DamagedError(f"a chunk is cut off, or has more than {MOST_BYTES // 2**20} MB")
            return found

        return decompress

    lz4, zstd = bounded(LZ4FrameDecompressor), bounded(vars(storage_mcap)["zstd"].ZstdDecompressor)
    storage_mcap.DECOMPRESSORS.update(lz4=lz4, zstd=zstd)
    reader.decompressors.update(lz4=lz4, bz2=bounded(BZ2Decompressor))
    return zstd


def _why(error: Exception) -> str:
    """What a reader says, in a line."""
    if isinstance(error, MemoryError | OverflowError):
        return "it claims more bytes than there are"
    told = printable(cut(str(error).strip().rstrip("."), 120)) or type(error).__name__
    return told if isinstance(error, DamagedError | InputError) else f"it is damaged ({told})"


def camera_info(bag: Bag, name: str | None) -> tuple[str, str]:
    """The text of a topic's first CameraInfo, as `rostopic echo` prints it, and a word if others differ from it.

    Raises:
        InputError: no such topic, or no message of it can be read.
    """
    topic = bag.topic(name, "#TOPIC", CAMERA_INFO)
    texts = Counter(_info_text(message) for _, message in bag.messages([topic]))
    if not texts:
        raise InputError(bag.loss([topic])[0])
    first = next(iter(texts))
    others = texts.total() - texts[first]
    return first, f"{others} of {texts.total()} messages say something else; the first is taken" if others else ""


def _info_text(info: object) -> str:
    numbers = {name: getattr(info, name, None) for name in "KkDd"}
    region = {name: int(attrgetter(f"roi.{name}")(info)) for name in ("x_offset", "y_offset", "width", "height")}
    lines = [f"{name}: {[float(one) for one in values]}" for name, values in numbers.items() if values is not None]
    sizes = [f"{name}: {int(getattr(info, name))}" for name in ("width", "height", "binning_x", "binning_y")]
    model = json.dumps(str(getattr(info, "distortion_model", "")))
    return "\n".join([*sizes, f"distortion_model: {model}", *lines, f"roi: {json.dumps(region)}"]) + "\n"


_STAMP = attrgetter("header.stamp.sec", "header.stamp.nanosec")
_IMAGE = attrgetter("height", "width", "step", "is_bigendian", "encoding", "data")
_PACKED = attrgetter("format", "data")


def stamp_ns(message: object) -> int:
    """The time in a message's header; 0: none is noted."""
    seconds, rest = map(int, _STAMP(message))
    return 10**9 * seconds + rest


_COLOURS = {"bgr": "BGR2GRAY", "rgb": "RGB2GRAY", "bgra": "BGRA2GRAY", "rgba": "RGBA2GRAY"}
_BAYER = {"rggb": "BayerBG2GRAY", "bggr": "BayerRG2GRAY", "gbrg": "BayerGR2GRAY", "grbg": "BayerGB2GRAY"}
"""OpenCV calls a mosaic by the second and third pixel of its second row."""
_LUMINANCE = {"yuv422": 1, "uyvy": 1, "yuv422_yuy2": 0, "yuyv": 0}
"""Where of two bytes the luminance stands."""
_LAYOUT = re.compile(r"(8|16)UC([134])|(mono|bgra?|rgba?|bayer_(?:rggb|bggr|gbrg|grbg))(8|16)")
ENCODINGS = "mono, bgr, rgb, bgra, rgba and bayer of 8 or 16 bits, 8UC1, 16UC1, 8UC3, yuv422"


def pixels_of(message: object) -> Photo:
    """The grey levels of an image message.

    Raises:
        DamagedError: its encoding is not read, or its bytes are not as many as its size needs.
    """
    import cv2

    *sizes, encoding, data = _IMAGE(message)
    height, width, step, is_bigendian = map(int, sizes)
    depth, channels, layout = _layout(encoding)
    if not (height > 0 and width > 0 and height * width <= MAX_PIXELS):
        raise DamagedError(f"has {width} x {height} px; 1 to {MAX_PIXELS // 10**6} million are read")
    row = width * channels * depth
    if step < row or step * height != len(data):
        raise DamagedError(
            f"{width} x {height} px of {encoding} need {row} bytes a row; it has {len(data)} in rows of {step}"
        )
    rows = data.reshape(height, step)[:, :row]
    values = np.ascontiguousarray(rows).view(f"{'>' if is_bigendian else '<'}u{depth}")
    grey = cast(Grey, values.astype(f"u{depth}", copy=False).reshape(height, width, channels))
    remark = ""
    if encoding in _LUMINANCE:
        grey = cast(Grey, np.ascontiguousarray(grey[:, :, _LUMINANCE[encoding]]))
    elif layout in _COLOURS or layout in _BAYER:
        remark = f"grey is made of its {encoding} mosaic, each pixel by its neighbours" if layout in _BAYER else ""
        code = _COLOURS.get(layout) or _BAYER[layout]
        grey = cast(Grey, cv2.cvtColor(np.squeeze(grey), getattr(cv2, f"COLOR_{code}")))
    else:
        grey = grey[:, :, 0]
    return Photo(grey, (remark,) if remark else ())


def _layout(encoding: str) -> tuple[int, int, str]:
    """Bytes of a value, values of a pixel, and what they are."""
    if encoding in _LUMINANCE:
        return 1, 2, encoding
    match = _LAYOUT.fullmatch(encoding)
    if match is None:
        raise DamagedError(f"its encoding {shown(encoding)} is not read; {ENCODINGS} are")
    bits, count, layout, more = match.groups()
    if layout is None:
        return int(bits) // 8, int(count), {"1": "mono", "3": "bgr", "4": "bgra"}[count]
    layout = layout.removeprefix("bayer_")
    return int(more) // 8, len(layout) if layout in _COLOURS else 1, layout


def photo_of_message(message: object, kind: str, columns: int | None = None) -> Photo:
    """The grey levels of a message of an image topic; of a JPEG not many more columns than are asked for.

    Raises:
        DamagedError: it holds none that can be read.
    """
    if kind == IMAGE:
        return pixels_of(message)
    codec, values = _PACKED(message)
    data = values.tobytes()
    is_depth = "compresseddepth" in codec.lower()
    if is_depth or not data.startswith((b"\xff\xd8", b"\x89PNG", b"II", b"MM")):
        raise DamagedError(f"its codec {shown(codec)} is not read; jpeg and png are: republish it as one of them")
    return photo_of(data) if columns is None else Photo(grey_of(preview_of(data, columns).pixels), ())
