"""Short names of arrays' types; what an array holds and its shape stand where it is named."""

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array: TypeAlias = NDArray[np.float64]
Rows: TypeAlias = NDArray[np.int64]
Flags: TypeAlias = NDArray[np.bool_]
Image: TypeAlias = NDArray[np.uint8]
