from pathlib import Path

import numpy as np
import pytest

from calib.studies.tolerance.draw import run_draws
from calib.studies.tolerance.stored import DrawPool, Keeping
from designer.base.arrays import Array
from designer.base.errors import InputError
from designer.tolerance.model import ErrorModel
from tests.support.tolerance_settings import errors, ico_setting

SEED = 3
FEW = ("scale", "face_tilt")


def kept(path: Path, model: ErrorModel, *, draws: int = 5, seed: int = SEED, jobs: int = 1, resume: bool = False,
         told: list[int] | None = None) -> Array:  # fmt: skip
    """The draws of a study."""
    pool, tell = DrawPool(ico_setting(), model, full=False), (told if told is not None else []).append
    return Keeping(path.parent, jobs, resume=resume).draws(pool, path.name, {}, seed, draws, tell)


def test_draws_are_kept_and_gone_on_with(tmp_path: Path) -> None:
    """Draws from the file are those computed at once, bit for bit, whatever the jobs; only missing ones are done."""
    model, told = errors().only(*FEW), []
    expected = run_draws(ico_setting(), model, SEED, range(5))
    assert expected.shape[1] == 4
    np.testing.assert_array_equal(kept(tmp_path / "s", model, draws=2), expected[:2])
    np.testing.assert_array_equal(kept(tmp_path / "s", model, jobs=2, resume=True, told=told), expected)
    assert told[0] == 2
    np.testing.assert_array_equal(kept(tmp_path / "s", model, draws=3, resume=True), expected[:3])


def test_another_study_is_refused(tmp_path: Path) -> None:
    """Draws of other errors, of an amount that is hardly another, or of another seed do not come into the same file."""
    model = errors().only(*FEW)
    kept(tmp_path / "s", model, draws=1)
    before = (tmp_path / "s").read_bytes()
    with pytest.raises(InputError, match="--resume"):
        kept(tmp_path / "s", model, draws=1)
    for other in (model.only("scale"), model.scaled(1 + 1e-12)):
        with pytest.raises(InputError, match="with errors"):
            kept(tmp_path / "s", other, resume=True)
    with pytest.raises(InputError, match="seed"):
        kept(tmp_path / "s", model, seed=SEED + 1, resume=True)
    assert (tmp_path / "s").read_bytes() == before
