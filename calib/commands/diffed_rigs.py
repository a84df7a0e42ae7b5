"""What `calib diff` says of two rigs."""

from typing import TYPE_CHECKING, cast

from designer.base.answer import Summary, Value
from designer.base.words import printable

if TYPE_CHECKING:
    from calib.api.diffing_rigs import ComparedRigs


def tell_compared_rigs(compared: "ComparedRigs") -> Summary:
    """Print what differs, and answer with the same."""
    from calib.rigs.compared import RigDifference
    from calib.show.rig.difference import MOST_ROWS, cameras_table, pairs_table, placed_words
    from designer.base.codec import encode
    from designer.page.terminal import say_table

    difference = compared.difference
    say_table(pairs_table(difference))
    if len(difference.pairs) > MOST_ROWS:
        print(f"and {len(difference.pairs) - MOST_ROWS} pairs that differ less")
    if difference.placed is not None:
        say_table(cameras_table(difference.placed.cameras))
    print(placed_words(difference))
    remarks = []
    for mark, name, one, only in zip("AB", compared.names, compared.opened, difference.only, strict=True):
        print(f"{mark}  {printable(name)}: {one.format.title}, {len(one.read.rig.names)} cameras")
        lines = [*one.read.remarks, *((f"alone has {', '.join(only)}",) if only else ())]
        for line in lines:
            print(f"   {printable(line)}")
        remarks += [f"{printable(name)}: {printable(line)}" for line in lines]
    files: dict[str, Value] = {
        mark: {"file": name, "format": one.format.name}
        for mark, name, one in zip("ab", compared.names, compared.opened, strict=True)
    }
    return Summary({**files, **cast("dict[str, Value]", encode(RigDifference, difference))}, remarks=tuple(remarks))
