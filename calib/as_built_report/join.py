"""Several detections files of one camera as one."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from calib.inputs.dataset import Dataset


def joined(sets: Sequence[Dataset], names: Sequence[str]) -> Dataset:
    """The photos of several files; those with a name that comes again get their file's name before it.

    Args:
        sets: of one layout.
        names: of their files.
    """
    count = Counter(name for one in sets for name in one.view_names)
    renamed = [
        f"{number}-{file}/{name}" if count[name] > 1 else name
        for number, (one, file) in enumerate(zip(sets, names, strict=True), start=1)
        for name in one.view_names
    ]
    first = np.cumsum([0, *(len(one.view_names) for one in sets)])
    return Dataset(
        sets[0].layout_id, sets[0].geometry_id, tuple(renamed),
        tuple(size for one in sets for size in one.image_sizes),
        np.concatenate([one.view + start for one, start in zip(sets, first[:-1], strict=True)]),
        np.concatenate([one.ring for one in sets]),
        np.concatenate([one.center_px for one in sets]),
        np.concatenate([one.cov_px2 for one in sets]),
    )  # fmt: skip
