"""Robots' bags, written by rosbags' own writers and read without ROS."""

import builtins
import struct
import sys
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.images.bag import IMAGES, Bag, is_bag, photo_of_message, pixels_of, stamp_ns
from calib.images.headers import DamagedError
from designer.base.errors import InputError
from tests.support.bags import KINDS, START_NS, STORES, Said, built, compressed, file_of, image, transforms, write_bag

RNG = np.random.default_rng(3)
GREY = RNG.integers(0, 256, (24, 32), dtype=np.uint8)
COLOUR = RNG.integers(0, 256, (24, 32, 3), dtype=np.uint8)
DEEP = RNG.integers(0, 2**16, (24, 32), dtype=np.uint16)
PACKED = {"bag": ("", "lz4", "bz2"), "mcap": ("", "storage", "message"), "db3": ("", "message")}


def said(count: int = 4) -> list[Said]:
    """Images of two topics, and transforms."""
    return [
        one
        for k in range(count)
        for one in (
            image("/left/image_raw", START_NS + k * 10**8, GREY + np.uint8(k), log_ns=START_NS + k * 10**8 + 10**6),
            compressed("/right/image_raw/compressed", START_NS + k * 10**8, GREY + np.uint8(k)),
            transforms("/tf", START_NS + k * 10**8, {("base", "tool0"): np.eye(4)}),
        )
    ]


def read_whole(bag: Bag) -> list[np.ndarray]:
    """Each image, read by itself, last first."""
    kinds = {topic.name: topic.type for topic in bag.topics}
    places = [(place, stamp_ns(message)) for place, message in bag.messages(bag.of_types(*IMAGES))]
    for place, stamp in places:
        assert 0 <= place.log_ns - stamp <= 10**6
    return [
        photo_of_message(bag.read(place, kinds[place.topic]), kinds[place.topic]).pixels for place, _ in places[::-1]
    ]


@pytest.mark.parametrize(("kind", "packed"), [(kind, one) for kind in KINDS for one in PACKED[kind]])
def test_images_are_read_bit_for_bit_whatever_the_bag(kind: str, packed: str, tmp_path: Path) -> None:
    """rosbag1, and rosbag2 with its metadata, without it, and as a lone file; plain and compressed."""
    path = write_bag(tmp_path / f"run.{kind}", said(), packed=packed)
    places = {path, file_of(path)}
    if path.is_dir():
        bare = tmp_path / "bare"
        bare.mkdir()
        (bare / file_of(path).name).write_bytes(file_of(path).read_bytes())
        places.add(bare)
    for place in places:
        assert is_bag(place)
        bag = Bag(place)
        found = read_whole(bag)
        for k, pair in enumerate(zip(found[::2], found[1::2], strict=True)):
            for pixels in pair:
                np.testing.assert_array_equal(pixels, GREY + np.uint8(3 - k))
        assert len(found) == 8
        assert bag.loss(bag.topics) == ()


def test_the_files_of_a_split_recording_are_one(tmp_path: Path) -> None:
    """In the order of their recording, whatever they are called, each image read from its own."""
    early, late = (write_bag(tmp_path / f"{name}.db3", part) for name, part in (("z", said()[:6]), ("a", said()[6:])))
    split = tmp_path / "split"
    split.mkdir()
    for one in (early, late):
        (split / file_of(one).name).write_bytes(file_of(one).read_bytes())
    bag = Bag(split)
    assert [topic.count for topic in bag.of_types(*IMAGES)] == [4, 4]
    assert [int(one[0, 0]) for one in read_whole(bag)] == [
        int(GREY[0, 0] + np.uint8(k)) for k in (3, 3, 2, 2, 1, 1, 0, 0)
    ]


@pytest.mark.parametrize(
    ("encoding", "pixels", "expected"),
    [
        ("mono8", GREY, GREY),
        ("8UC1", GREY, GREY),
        ("mono16", DEEP, DEEP),
        ("16UC1", DEEP.astype(">u2"), DEEP),
        ("bgr8", COLOUR, cv2.cvtColor(COLOUR, cv2.COLOR_BGR2GRAY)),
        ("8UC3", COLOUR, cv2.cvtColor(COLOUR, cv2.COLOR_BGR2GRAY)),
        ("rgb8", COLOUR, cv2.cvtColor(COLOUR, cv2.COLOR_RGB2GRAY)),
        ("rgba8", np.dstack([COLOUR, GREY]), cv2.cvtColor(COLOUR, cv2.COLOR_RGB2GRAY)),
        ("bgra8", np.dstack([COLOUR, GREY]), cv2.cvtColor(COLOUR, cv2.COLOR_BGR2GRAY)),
        ("yuv422", np.dstack([DEEP.astype(np.uint8), GREY]), GREY),
        ("yuv422_yuy2", np.dstack([GREY, DEEP.astype(np.uint8)]), GREY),
    ],
)
def test_an_encoding_means_what_its_name_says(encoding: str, pixels: np.ndarray, expected: np.ndarray) -> None:
    """Channels, depth and byte order; rows may be longer than their pixels."""
    message = image("/a", 1, pixels, encoding)
    padded = np.pad(message.values["data"].reshape(24, -1), ((0, 0), (0, 5)))
    values = message.values | {"data": padded.ravel(), "step": padded.shape[1]}
    for one in (message.values, values):
        found = pixels_of(built(STORES[False].types, message.kind, one)).pixels
        assert found.dtype == expected.dtype
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("deep", [8, 16])
@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_a_mosaic_of_a_coloured_scene_gives_its_grey(pattern: str, deep: int) -> None:
    """Of an even colour the grey is that of the colour; another order of the letters would give another."""
    level = {"r": 200, "g": 100, "b": 40}
    tile = np.array([level[letter] for letter in pattern]).reshape(2, 2) * (1 if deep == 8 else 257)
    pixels = np.tile(tile, (6, 8)).astype(f"u{deep // 8}")
    photo = pixels_of(
        built(STORES[False].types, "sensor_msgs/msg/Image", image("/a", 1, pixels, f"bayer_{pattern}{deep}").values)
    )
    grey = (0.299 * 200 + 0.587 * 100 + 0.114 * 40) * (1 if deep == 8 else 257)
    np.testing.assert_allclose(photo.pixels[2:-2, 2:-2], grey, rtol=0.01)
    assert "mosaic" in photo.remarks[0]


@pytest.mark.parametrize(
    ("message", "line"),
    [
        (image("/a", 1, GREY, "32FC1"), "its encoding '32FC1' is not read"),
        (image("/a", 1, GREY, step=16), "need 32 bytes a row; it has 768 in rows of 16"),
        (image("/a", 1, GREY, height=100_000, width=1_000_000), "has 1000000 x 100000 px; 1 to 250 million"),
        (image("/a", 1, GREY, height=10_000, width=10_000, step=10_000), "need 10000 bytes a row; it has 768"),
        (compressed("/a", 1, GREY, told="16UC1; compressedDepth png"), "its codec '16UC1; compressedDepth png' is not"),
        (Said("/a", "sensor_msgs/msg/CompressedImage", 1, {"format": "h264", "data": GREY.ravel()}), "codec 'h264'"),
    ],
)
def test_what_is_no_image_is_refused_in_a_line(message: Said, line: str) -> None:
    """An unknown encoding or codec, and bytes that do not fit the size, however large that claims to be."""
    with pytest.raises(DamagedError, match=line):
        photo_of_message(built(STORES[False].types, message.kind, message.values), message.kind)


def test_a_topic_that_is_not_there_lists_those_that_are(tmp_path: Path) -> None:
    """With types and counts; the only one needs no name, one of another type is said to be."""
    bag = Bag(write_bag(tmp_path / "run.mcap", said()))
    listed = r"/left/image_raw \(sensor_msgs/Image, 4\), /right/image_raw/compressed \(sensor_msgs/CompressedImage, 4\)"
    with pytest.raises(InputError, match=rf"several topics of type Image, name one with --topic; there are {listed}"):
        bag.topic(None, "--topic", *IMAGES)
    with pytest.raises(InputError, match=rf"--topic '/cam': no such topic; there are {listed}"):
        bag.topic("/cam", "--topic", *IMAGES)
    with pytest.raises(InputError, match=r"--topic '/tf': is of type tf2_msgs/msg/TFMessage; there are /left"):
        bag.topic("/tf", "--topic", *IMAGES)
    assert bag.topic("left/image_raw", "--topic", *IMAGES).count == 4
    blind = Bag(write_bag(tmp_path / "blind.bag", said()[2::3]))
    with pytest.raises(InputError, match=r"no messages of type Image; there are /tf \(tf2_msgs/TFMessage, 4\)"):
        blind.topic(None, "--topic", *IMAGES)


def test_a_folder_without_a_file_of_its_list_names_it(tmp_path: Path) -> None:
    """And one that is compressed as a whole says how it is unpacked."""
    path = write_bag(tmp_path / "run.db3", said())
    file_of(path).rename(tmp_path / "elsewhere.db3")
    with pytest.raises(InputError, match=r"run.db3.db3 of its metadata.yaml is not there; copy the whole folder"):
        Bag(path)
    (path / "metadata.yaml").write_text("  relative_file_paths:\n    - run_0.db3.zstd\n")
    with pytest.raises(InputError, match=r"run_0.db3.zstd is compressed as a whole; unpack it with zstd -d"):
        Bag(path)


def test_without_the_extra_a_line_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And nothing else is said."""
    path = write_bag(tmp_path / "run.bag", said(1))
    kept = builtins.__import__

    def without(name: str, *args: object, **given: object) -> object:
        if name.startswith("rosbags"):
            raise ModuleNotFoundError(name, name=name)
        return kept(name, *args, **given)

    for name in [one for one in sys.modules if one.partition(".")[0] == "rosbags"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"need an extra: pip install 'ringsolid\[ros\]'"):
        Bag(path)


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_bags_give_a_line_or_say_what_is_lost(kind: str, tmp_path: Path) -> None:
    """Bytes turned at random, and bags that end too soon: all images, or a line for what is not there."""
    rng = np.random.default_rng(5)
    whole = file_of(
        write_bag(tmp_path / f"run.{kind}", said(), packed="" if kind == "db3" else PACKED[kind][1])
    ).read_bytes()
    outcomes = set()
    for turn in range(24):
        data = bytearray(whole)
        for at in rng.integers(0, len(data), [1, 8, 64][turn % 3]):
            data[at] = int(rng.integers(256))
        place = tmp_path / f"bad{turn}.{kind}"
        place.write_bytes(data[: int(rng.integers(1, len(data)))] if turn % 4 == 3 else data)
        told = []
        try:
            bag = Bag(place)
            kinds = {topic.name: topic.type for topic in bag.topics}
            places = [one for one, _ in bag.messages(bag.of_types(*IMAGES))]
            told += bag.loss(bag.topics)
            for one in places:
                photo_of_message(bag.read(one, kinds[one.topic]), kinds[one.topic])
            assert len(places) == 8 or told
        except (InputError, DamagedError) as error:
            told.append(str(error))
        assert not any("\n" in line for line in told)
        outcomes.add(bool(told))
    assert outcomes == {True, False}


def test_an_mcap_without_chunks_is_read_where_its_messages_stand(tmp_path: Path) -> None:
    """As the preset "fastwrite" of rosbag2 writes it: an image is not looked for from the file's beginning."""
    from rosbags.rosbag2.storage_mcap import write_record, write_string

    store, out = STORES[False], BytesIO()
    out.write(b"\x89MCAP0\r\n")

    def record(op: int, *parts: bytes | str) -> None:
        body = BytesIO()
        for part in parts:
            write_string(body, part) if isinstance(part, str) else body.write(part)
        write_record(out, op, body)

    record(1, "ros2", "test")
    record(3, b"\1\0", "sensor_msgs/msg/Image", "", "")
    record(4, b"\1\0", b"\1\0", "/cam", "cdr", bytes(4))
    for k in range(40):
        one = image("/cam", START_NS + k, np.full((24, 32), k, np.uint8))
        raw = store.serialize_cdr(built(store.types, one.kind, one.values), one.kind)
        record(5, struct.pack("<HIQQ", 1, 0, one.log_ns, one.log_ns), bytes(raw))
    record(2, bytes(20))
    place = tmp_path / "run.mcap"
    place.write_bytes(out.getvalue() + b"\x89MCAP0\r\n")
    bag = Bag(place)
    assert bag.topics[0].count == 40
    places = [one for one, _ in bag.messages(bag.topics)]
    reader = bag._readers[0]
    reader.messages = None  # type: ignore[assignment]
    for k in range(39, -1, -1):
        assert (photo_of_message(bag.read(places[k], bag.topics[0].type), bag.topics[0].type).pixels == k).all()


def test_one_bad_chunk_costs_its_images_alone(tmp_path: Path) -> None:
    """Those before and behind it are read, and the loss is told with its cause."""
    big = [image("/cam", START_NS + k * 10**8, np.full((1200, 1000), k, np.uint8)) for k in range(6)]  # a chunk each
    place = file_of(write_bag(tmp_path / "run.mcap", big, packed="storage"))
    data = bytearray(place.read_bytes())
    starts = [at for at in range(len(data)) if data[at : at + 4] == b"\x28\xb5\x2f\xfd"]
    data[starts[2] + 8] ^= 0xFF
    place.write_bytes(data)
    bag = Bag(place)
    levels = [int(pixels[0, 0]) for pixels in read_whole(bag)]
    assert 3 <= len(levels) < 6
    assert {0, 1, 5} <= set(levels)
    (line,) = bag.loss(bag.of_types(*IMAGES))
    assert f"{6 - len(levels)} of 6 messages of /cam cannot be read and are left out" in line


def test_a_chunk_that_unpacks_without_end_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever size it claims: memory stays bounded."""
    monkeypatch.setattr("calib.images.bag.MOST_BYTES", 2**20)
    bomb = [image("/cam", START_NS, np.zeros((2000, 2000), np.uint8))]
    for kind, packed in (("bag", "bz2"), ("bag", "lz4"), ("mcap", "storage"), ("mcap", "message")):
        place = file_of(write_bag(tmp_path / f"{packed}.{kind}", bomb, packed=packed))
        assert place.stat().st_size < 200_000
        bag = Bag(place)
        assert list(bag.messages(bag.topics)) == []
        assert "has more than 1 MB" in bag.loss(bag.topics)[0]


def test_a_record_that_claims_100_gb_is_a_line(tmp_path: Path) -> None:
    """Of an MCAP file's summary: nothing is set aside for it."""
    place = file_of(write_bag(tmp_path / "run.mcap", said()))
    data = bytearray(place.read_bytes())
    (summary,) = struct.unpack_from("<Q", data, len(data) - 28)
    struct.pack_into("<Q", data, summary + 1, 100 * 10**9)
    place.write_bytes(data)
    with pytest.raises(
        InputError, match=r"cannot be read as a bag: .*; copy it again, or mend its index with mcap recover"
    ):
        Bag(place)
