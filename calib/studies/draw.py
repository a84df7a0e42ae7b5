"""Which views a bootstrap sample is made of: a function of seed, case and number alone."""

import hashlib

import numpy as np
from numpy.typing import NDArray


def draw_counts(seed: int, case: str, number: int, size: int, pool: int) -> NDArray[np.int64]:
    """How often each view is drawn, of `size` draws with replacement (Efron 1979).  # (V,)

    The draws come from Philox (Salmon et al. 2011), a generator whose streams are told apart by a key. The key is a
    digest of what names the sample, so a sample is the same in whatever order, process or part of a run it is drawn.

    Args:
        seed: of the study.
        case: the name of what is sampled.
        number: of the sample.
        size: how many views to draw.
        pool: how many views there are.
    """
    name = f"{seed}\n{number}\n{case}".encode()
    key = np.frombuffer(hashlib.sha256(name).digest()[:16], dtype="<u8")
    drawn = np.random.Generator(np.random.Philox(key=key)).integers(pool, size=size)
    return np.bincount(drawn, minlength=pool).astype(np.int64, copy=False)
