"""Bags as robots write them, by the writers of rosbags."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from calib.core.se3 import quaternion_wxyz

Kind = Literal["bag", "mcap", "db3"]
KINDS: tuple[Kind, ...] = ("bag", "mcap", "db3")
STORES = {True: get_typestore(Stores.ROS1_NOETIC), False: get_typestore(Stores.LATEST)}
STORES[True].register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
START_NS = 1_700_000_000 * 10**9


@dataclass(frozen=True)
class Said:
    """A message: its topic, type, when it was recorded, and its values by their names, nested."""

    topic: str
    kind: str
    log_ns: int
    values: Mapping[str, object]


def write_bag(path: Path, said: Iterable[Said], *, packed: str = "") -> Path:
    """A bag with messages; a .bag file, or a folder NAME.mcap or NAME.db3 of a rosbag2; what it holds is at the path.

    Args:
        path: its ending tells the kind.
        said: its messages.
        packed: how chunks, or "message" for each message, are compressed.
    """
    is_first = path.suffix == ".bag"
    store = STORES[is_first]
    if is_first:
        writer = Writer1(path)
        if packed:
            writer.set_compression(Writer1.CompressionFormat[packed.upper()])
    else:
        plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
        if packed:
            writer.set_compression(
                CompressionMode.MESSAGE if packed == "message" else CompressionMode.STORAGE, CompressionFormat.ZSTD
            )
    with writer:
        topics = {}
        for one in said:
            if one.topic not in topics:
                topics[one.topic] = writer.add_connection(one.topic, one.kind, typestore=store)
            message = built(store.types, one.kind, one.values)
            raw = (store.serialize_ros1 if is_first else store.serialize_cdr)(message, one.kind)
            writer.write(topics[one.topic], one.log_ns, raw)
    return path


def file_of(path: Path) -> Path:
    """The one file with messages of a bag."""
    return next(path.glob("*.[md][cb]*")) if path.is_dir() else path


def built(types: Mapping[str, type], kind: str, values: Mapping[str, object]) -> object:
    """A message of a type, with zeros for what is not told."""
    cls = types[kind]
    parts = {}
    for name, declared in cls.__annotations__.items():
        if name == "__msgtype__":
            continue
        value = values.get(name)
        nested = str(declared).strip("'").replace("__", "/")
        if nested in types:
            value = built(types, nested, value or {})
        elif isinstance(value, list) and value and isinstance(value[0], tuple):
            value = [built(types, inner, one) for inner, one in value]
        elif value is None:
            value = {"str": "", "int": 0, "float": 0.0, "bool": False}.get(str(declared).strip("'"))
            value = np.zeros(ARRAYS.get(name, 0), np.float64) if value is None else value
        parts[name] = value
    return cls(**parts)


ARRAYS = {"k": 9, "K": 9, "r": 9, "R": 9, "p": 12, "P": 12}


def header(stamp_ns: int, frame: str = "cam") -> dict[str, object]:
    """A header's values."""
    return {"stamp": {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}, "frame_id": frame}


def image(
    topic: str,
    stamp_ns: int,
    pixels: np.ndarray,
    encoding: str = "mono8",
    *,
    log_ns: int | None = None,
    **values: object,
) -> Said:
    """A sensor_msgs/Image of an array (H, W) or (H, W, C), as it lies in memory."""
    height, width = pixels.shape[:2]
    raw = np.frombuffer(pixels.tobytes(), np.uint8)
    told = {"header": header(stamp_ns), "height": height, "width": width, "encoding": encoding,
            "is_bigendian": int(pixels.dtype.byteorder == ">"), "step": len(raw) // height,
            "data": raw} | values  # fmt: skip
    return Said(topic, "sensor_msgs/msg/Image", stamp_ns if log_ns is None else log_ns, told)


def compressed(topic: str, stamp_ns: int, pixels: np.ndarray, codec: str = "png", told: str | None = None) -> Said:
    """A sensor_msgs/CompressedImage."""
    data = cv2.imencode(f".{codec}", pixels)[1].ravel()
    values = {"header": header(stamp_ns), "format": told or f"mono8; {codec} compressed mono8", "data": data}
    return Said(topic, "sensor_msgs/msg/CompressedImage", stamp_ns, values)


def transforms(topic: str, stamp_ns: int, poses: Mapping[tuple[str, str], np.ndarray]) -> Said:
    """A tf2_msgs/TFMessage of (parent, child): parent_from_child in mm."""
    each = [
        ("geometry_msgs/msg/TransformStamped",
         {"header": header(stamp_ns, parent), "child_frame_id": child, "transform": transform(pose)})
        for (parent, child), pose in poses.items()
    ]  # fmt: skip
    return Said(topic, "tf2_msgs/msg/TFMessage", stamp_ns, {"transforms": each})


def transform(pose: np.ndarray) -> dict[str, object]:
    """A geometry_msgs/Transform of a pose in mm."""
    w, x, y, z = quaternion_wxyz(pose[:3, :3]).tolist()
    return {
        "translation": dict(zip("xyz", (pose[:3, 3] / 1000).tolist(), strict=True)),
        "rotation": {"x": x, "y": y, "z": z, "w": w},
    }


def camera_info(
    topic: str, stamp_ns: int, size: tuple[int, int], k: Sequence[float], d: Sequence[float], **values: object
) -> Said:
    """A sensor_msgs/CameraInfo."""
    told = {"header": header(stamp_ns), "width": size[0], "height": size[1], "distortion_model": "plumb_bob",
            "k": np.array(k, float), "d": np.array(d, float)} | values  # fmt: skip
    return Said(topic, "sensor_msgs/msg/CameraInfo", stamp_ns, told)


def pose_stamped(topic: str, stamp_ns: int, pose: np.ndarray) -> Said:
    """A geometry_msgs/PoseStamped of a pose in mm."""
    move = transform(pose)
    values = {"header": header(stamp_ns, "base_link")}
    return Said(topic, "geometry_msgs/msg/PoseStamped", stamp_ns,
                values | {"pose": {"position": move["translation"], "orientation": move["rotation"]}})  # fmt: skip
