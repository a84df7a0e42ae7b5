"""What the pools of a comparison have in common."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from calib.core.threads import one_thread
from calib.studies.compare.scene import ComparedScene
from calib.studies.sample import SampleResult


@dataclass(frozen=True, eq=False)
class ScenePool(ABC):
    """Samples of one scene, as `calib.studies.workers.SamplePool`."""

    kind: ClassVar[str]  # of the values that a sample has beside the errors
    values: ClassVar[tuple[str, ...]]  # their names
    scene: ComparedScene

    @property
    def view_count(self) -> int:
        """Photos of a set."""
        return self.scene.views

    @property
    def model(self) -> str:
        """The kind of values."""
        return self.kind

    @property
    def value_count(self) -> int:
        """How many."""
        return len(self.values)

    @property
    def covariance(self) -> NDArray[np.float64]:
        """They have none."""
        return np.zeros((0, 0))

    @one_thread
    def run(self, case: str, size: int, seed: int, numbers: range) -> list[SampleResult]:
        """The samples of some numbers."""
        del case, size
        return [self.sample(seed, number) for number in numbers]

    @abstractmethod
    def sample(self, seed: int, number: int) -> SampleResult:
        """One sample; what is random hangs on scene, seed and number alone."""
