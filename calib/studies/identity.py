"""What makes a study this study: seed, settings and inputs; and the programs that computed it."""

import hashlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

from calib.core.types import Observations
from designer.base.errors import InputError
from designer.base.words import shown

PROGRAMS = ("ringsolid", "numpy", "numba", "scipy")
"""Whose versions decide the last bits of a sample."""

Pairs = tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class StudyIdentity:
    """All that a sample's result depends on, but for the case's name and size and the sample's number."""

    seed: int
    settings: Pairs  # name and value, by name; not how many samples or which sizes: there may be more of them later
    inputs: Pairs  # name of a file and SHA-256 of its content, by name

    def rows(self) -> Iterator[tuple[str, str, str]]:
        """Kind, name and value, as they are stored."""
        yield "seed", "seed", str(self.seed)
        yield from (("setting", name, value) for name, value in self.settings)
        yield from (("input", name, value) for name, value in self.inputs)

    @staticmethod
    def from_rows(rows: Sequence[tuple[object, ...]]) -> "StudyIdentity | None":
        """The identity that was stored; None if that is none."""
        kept: dict[str, list[tuple[str, str]]] = {"seed": [], "setting": [], "input": []}
        for kind, name, value in rows:
            if not (isinstance(kind, str) and kind in kept and isinstance(name, str) and isinstance(value, str)):
                return None
            kept[kind].append((name, value))
        try:
            ((_, seed),) = kept["seed"]
            return StudyIdentity(int(seed), tuple(sorted(kept["setting"])), tuple(sorted(kept["input"])))
        except ValueError:
            return None

    def difference(self, other: "StudyIdentity") -> str:
        """In what the study asked for differs from this one, with the remedy; "" if in nothing."""
        if self.seed != other.seed:
            return f"is a study of seed {self.seed}, not {other.seed}; give --seed {self.seed}, or choose another -o"
        name, here, there = _first_difference(self.settings, other.settings)
        if name and (here is None or there is None):
            return f"is a study {'without' if here is None else 'with'} {name}: of another kind; choose another -o"
        if name:
            return (
                f"is a study with {name} {shown(here)}, not {shown(there)}; give the same options, or choose another -o"
            )
        name, here, there = _first_difference(self.inputs, other.inputs)
        if not name:
            return ""
        if here is None or there is None:
            return f"is a study {'without' if here is None else 'with'} {name}; give the same files, or another -o"
        return f"{name} has changed since the study began; give the file as it was, or choose another -o"


def identity_of(seed: int, settings: Mapping[str, str], inputs: Mapping[str, Path | str]) -> StudyIdentity:
    """The identity of a study.

    Args:
        seed: of all samples.
        settings: what else decides a sample's result, by name.
        inputs: the files that are read, or digests, by what they are (such as "target"), so that they may be moved.
    """
    digests = ((name, one if isinstance(one, str) else sha256_of(one)) for name, one in sorted(inputs.items()))
    return StudyIdentity(seed, tuple(sorted(settings.items())), tuple(digests))


def photos_read(observations: Observations, detections: object, **others: object) -> dict[str, Path | str]:
    """A person's files, as inputs; in place of observations that come from none, the digest of what it would hold."""
    named = {"detections": detections, **others}
    files: dict[str, Path | str] = {
        name: Path(one) for name, one in named.items() if isinstance(one, str | os.PathLike)
    }
    return files if "detections" in files else {"detections": digest_of(observations), **files}


def sha256_of(path: Path) -> str:
    """The SHA-256 of a file, as hexadecimal digits."""
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}; check the path") from None


def digest_of(observations: Observations) -> str:
    """The SHA-256 of observations."""
    content = hashlib.sha256()
    covariance = np.zeros(0) if observations.cov_px2 is None else observations.cov_px2
    size, place = np.array(observations.image_size), observations.points.position_mm[observations.point]
    for array in (size, observations.view, observations.center_px, covariance, place):
        content.update(array.tobytes())
    return content.hexdigest()


def program_versions() -> Pairs:
    """Names and versions of the programs that compute samples."""
    return tuple((name, _version(name)) for name in PROGRAMS)


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # run from its sources
        return "unknown"


def _first_difference(here: Pairs, there: Pairs) -> tuple[str, str | None, str | None]:
    """The first name with another value, and the values; "" if there is none."""
    ours, theirs = dict(here), dict(there)
    for name in sorted(ours.keys() | theirs.keys()):
        if ours.get(name) != theirs.get(name):
            return name, ours.get(name), theirs.get(name)
    return "", None, None
