"""Random numbers by name, and which views a bootstrap sample is made of: a function of seed, case and number alone."""

import hashlib

import numpy as np
from numpy.typing import NDArray


def keyed_generator(name: str) -> np.random.Generator:
    """The random numbers of what has this name: the same in whatever order, process or part of a run they are drawn.

    They come from Philox (Salmon et al. 2011), a generator whose streams are told apart by a key: a digest of the name.
    """
    key = np.frombuffer(hashlib.sha256(name.encode()).digest()[:16], dtype="<u8")
    return np.random.Generator(np.random.Philox(key=key))


def draw_counts(seed: int, case: str, number: int, size: int, pool: int) -> NDArray[np.int64]:
    """How often each view is drawn, of `size` draws with replacement (Efron 1979).  # (V,)

    Args:
        seed: of the study.
        case: the name of what is sampled.
        number: of the sample.
        size: how many views to draw.
        pool: how many views there are.
    """
    drawn = keyed_generator(f"{seed}\n{number}\n{case}").integers(pool, size=size)
    return np.bincount(drawn, minlength=pool).astype(np.int64, copy=False)
