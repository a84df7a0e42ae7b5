"""What a person may choose about measuring a print."""

from dataclasses import dataclass, field

from calib.solver.options import SolveOptions
from designer.tolerance.made import Made


@dataclass(frozen=True)
class AsBuiltOptions:
    """Which deviations from the nominal target are allowed, and how large they are expected to be.

    The expectations are standard deviations of normal priors with mean zero. None: what the way of making gives, and
    more where the photos show more; of a target that is no design, so wide that only what the photos do not tell is
    held.
    """

    made: Made | None = None  # the way of making; None: the usual one of how the target was built
    ring_sigma_mm: tuple[float, float] | None = (0.05, 0.02)  # of a ring's centre in its plane, normal to it; None: 0
    ring_sigma_from_photos: bool = True  # start from these, then take what the rings' offsets turn out to be
    face_sigma_rad: float | None = None
    face_sigma_mm: float | None = None
    bow: bool | None = None  # each face may be bent; None: only if there is one face
    bow_sigma_mm: float | None = None  # at the face's rim
    affine: bool = True  # the whole print may be scaled and skewed
    strain_sigma: float | None = None
    solve: SolveOptions = field(default_factory=SolveOptions)  # weights, fixed and shared parameters of the cameras

    @property
    def has_free_rings(self) -> bool:
        """Whether each ring has its own offset."""
        return self.ring_sigma_mm is not None and max(self.ring_sigma_mm) > 0
