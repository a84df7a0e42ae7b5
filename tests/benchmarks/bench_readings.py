"""Robots' poses that are not what their files say: how often what they are is named, and never anything else.

Run from the repository's root: `python -m tests.benchmarks.bench_readings [--rigs 200] [--files 8]`. Each random robot
has files of its poses in which some of these are other than the columns say: the unit, the order of a quaternion or of
Euler angles, degrees or radians, matrices row by row or column by column, the sense, the row, the handedness of the
frames. Of one robot in two a fifth of the poses is wrong. Goals: 95 % of what differs is named, alone; 0 wrong names.
"""

import argparse
import re
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from calib.core.se3 import invert, make_pose
from calib.rigs.robot_readings import why_wrong
from designer.base.arrays import Array
from designer.base.errors import InputError
from tests.support.robot_files import Written, read, robot, wobbling

NAMES = {
    "ZYX": "zyx-intrinsic (kuka)", "xyz": "xyz-extrinsic (fanuc, rpy)", "XYZ": "xyz-intrinsic (staubli)",
    "ZYZ": "zyz-intrinsic (kawasaki)",
}  # fmt: skip
ANGLES = {"a,b,c": "ZYX", "w,p,r": "xyz", "roll,pitch,yaw": "xyz", "o,a,t": "ZYZ", "rx,ry,rz": "vector"}
"""Columns, and what their angles are if nothing is said; in capitals: intrinsic."""
OTHERS = ("ZYX", "xyz", "XYZ", "ZYZ", "zyx", "XZY", "YXZ", "zxy", "ZXZ", "vector")
UNITS = {"cm": 10.0, "m": 1e3, "in": 25.4}
LOOKS = re.compile(r"(?:these look like |, or )(.*?) \(turns off by [^)]*\)")


def differs(rng: np.random.Generator, share: float = 0.3) -> bool:
    """Whether something is other than it is said."""
    return bool(rng.uniform() < share)


def written(rng: np.random.Generator, rotation: Array) -> tuple[str, Array, list[str]]:
    """Columns of rotations, their numbers, and what of them is other than the columns say."""
    turned = Rotation.from_matrix(rotation)
    kind = rng.choice(["quaternion", "matrix", "angles", "angles"])
    if kind == "quaternion":
        is_w_first, is_other = differs(rng, 0.5), differs(rng, 0.4)
        value = np.roll(turned.as_quat(), int(is_w_first ^ is_other), axis=1)
        columns = "qw,qx,qy,qz" if is_w_first else "qx,qy,qz,qw"
        return columns, value, [f"quaternions w {'last' if is_w_first else 'first'}"] if is_other else []
    if kind == "matrix":
        is_other = differs(rng)
        matrix = rotation.swapaxes(-1, -2) if is_other else rotation
        columns = ",".join(f"r{i}{j}" for i in range(3) for j in range(3))
        looks = ["rotations written the other way, as transposed matrices"] if is_other else []
        return columns, matrix.reshape(-1, 9), looks
    names = str(rng.choice(list(ANGLES)))
    said = ANGLES[names]
    true = str(rng.choice(OTHERS)) if differs(rng, 0.5) else said
    value = turned.as_rotvec() if true == "vector" else turned.as_euler(true)
    looks = [] if true == said else [of_angles(true)]
    unit, is_other = str(rng.choice(["deg", "rad"])), differs(rng, 0.15)
    if is_other:
        looks.append(f"angles in {'deg' if unit == 'rad' else 'rad'}")
    columns = ",".join(f"{name}_{unit}" for name in names.split(","))
    return columns, np.rad2deg(value) if (unit == "deg") ^ is_other else value, looks


def of_angles(axes: str) -> str:
    """What they are called."""
    if axes == "vector":
        return "rotation vectors"
    return f"Euler angles {NAMES.get(axes, axes.lower() + ('-intrinsic' if axes.isupper() else '-extrinsic'))}"


def file_of(rng: np.random.Generator, base_from_flange: Array) -> tuple[Written, str]:
    """A file of poses, and what it is but for what its columns say; "" if it is that."""
    is_inverted = differs(rng)
    pose = invert(base_from_flange) if is_inverted else base_from_flange
    is_left = differs(rng)
    if is_left:
        mirror = np.diag([1.0, -1.0, 1.0]) if differs(rng, 0.5) else np.eye(3)[[0, 2, 1]]
        pose = make_pose(mirror @ pose[:, :3, :3] @ mirror.T, pose[:, :3, 3] @ mirror.T)
    shift = int(rng.choice([-1, 1])) if differs(rng) else 0
    pose = np.roll(pose, shift, axis=0)
    columns, value, looks = written(rng, pose[:, :3, :3])
    unit = str(rng.choice(list(UNITS))) if differs(rng) else "mm"
    looks += ["flange_from_base"] if is_inverted else []
    looks += [f"poses that stand a row too {'late' if shift > 0 else 'early'}"] if shift else []
    looks += ["poses in a left-handed frame"] if is_left else []
    looks += [f"positions in {unit} that are taken for mm"] if unit != "mm" else []
    return (columns, pose[:, :3, 3] / UNITS.get(unit, 1.0), value), "; ".join(looks)


def judged(why: str, said: str) -> str:
    """What came of a file."""
    if not why:
        return "wrong: nothing named" if said else "as said, nothing named"
    names = LOOKS.findall(why)
    names = [re.sub(r" or target's points in \w+ that are taken for mm", "", one) for one in names]
    if not names:
        return "wrong: refused what is right" if not said else "refused without a name"
    if said not in names:
        return "wrong name"
    return "named, alone" if len(names) == 1 else "named, among others"


def main(arguments: Sequence[str] | None = None) -> None:
    """All robots."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--rigs", type=int, default=200)
    parser.add_argument("--files", type=int, default=8)
    asked = parser.parse_args(arguments)
    count, begin = Counter[str](), time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(asked.rigs):
            is_camera_in_hand = seed % 2 == 0
            seen, base_from_flange = robot(seed, is_camera_in_hand=is_camera_in_hand)
            if seed % 4 < 2:
                lost = np.arange(len(seen)) % 5 == 2
                seen[lost] = seen[lost] @ wobbling(np.random.default_rng(seed), int(lost.sum()), 0.5, 60.0)
            for file in range(asked.files):
                content, said = file_of(np.random.default_rng([seed, file]), base_from_flange)
                try:
                    poses = read(content, Path(folder))
                except InputError:
                    count["refused when read"] += 1
                    continue
                why = why_wrong(seen, poses, np.arange(len(seen)), is_camera_in_hand=is_camera_in_hand)
                came = judged(why, said)
                count[came] += 1
                if came.startswith("wrong") or came == "refused without a name":
                    print(f"{seed}.{file}: {content[0]}: {said or 'as said'}: {came}: {why}")
    for came, times in count.most_common():
        print(f"{times:6} {came}")
    print(f"{asked.rigs} robots, {asked.files} files each; {time.process_time() - begin:.0f} s of processor time")


if __name__ == "__main__":
    main()
