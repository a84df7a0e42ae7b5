"""Two rigs of the same cameras compared."""

from dataclasses import dataclass
from os import fspath

from calib.app.inputs import Place, opened_rig, rig_named
from calib.cameras.rig import Rig
from calib.interop.rigs.reading import OpenedRig
from calib.rigs.compared import RigDifference, compare_rigs
from designer.base.errors import InputError


@dataclass(frozen=True, eq=False)
class ComparedRigs:
    """What came of a comparison: `compared.difference.placed.rms_mm`."""

    names: tuple[str, str]
    opened: tuple[OpenedRig, OpenedRig]
    difference: RigDifference


def diff_rigs(a: Rig | Place, b: Rig | Place) -> ComparedRigs | None:
    """Compare two rigs: `diff_rigs("rig.json", "camchain.yaml").difference.pairs`; None: they are cameras.

    Args:
        a: a rig, a file of any kind that `calib.load_rig` reads, or a folder.
        b: another of the same cameras, which are known by their names.

    Raises:
        InputError: a file that cannot be read, one rig and one camera, or rigs that share no two cameras.
    """
    rigs = [opened_rig(one) if isinstance(one, Rig) else rig_named(one) for one in (a, b)]
    names = tuple("a rig" if isinstance(one, Rig) else fspath(one) for one in (a, b))
    first, second = rigs
    if first is None and second is None:
        return None
    if first is None or second is None:
        rig, camera = (names[0], names[1]) if second is None else (names[1], names[0])
        known = next(one for one in rigs if one is not None).read.rig.names
        raise InputError(f"{rig}: is a rig, {camera} none; name one of its cameras, as in {rig}#{known[0]}")
    return ComparedRigs((names[0], names[1]), (first, second), compare_rigs(first.read.rig, second.read.rig))
