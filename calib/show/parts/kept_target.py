"""`target.json` in a folder of photos: the target as it was used, to draw it and to go on from."""

from pathlib import Path

from designer.base.errors import InputError
from designer.base.files import write_files
from designer.base.own_files import is_ours
from designer.base.words import printable, with_article
from designer.target import FORMAT, TargetGeometry, load_target, target_to_json

TARGET_FILE = "target.json"


def keep_target(folder: Path, target: TargetGeometry, *, is_again: bool) -> tuple[Path, ...]:
    """Write `target.json`; its path, or nothing where somebody's own file has that name and stays.

    Args:
        folder: of the photos.
        target: as it was used.
        is_again: whether the same command left results here before: then the target there came with them, while one
            in another folder was put there by somebody, though this program made it.
    """
    path = folder / TARGET_FILE
    if kept_target(folder, target.geometry_id)[0] is not None:
        return (path,)
    if path.exists() and not (is_again and is_ours(path, FORMAT)):
        return ()
    write_files({path: target_to_json(target).encode()})
    return (path,)


def kept_target(folder: Path, geometry_id: str) -> tuple[TargetGeometry | None, str]:
    """The target of a folder's photos; None if it is not there, and why it is not used if it is."""
    path = folder / TARGET_FILE
    if not path.exists():
        return None, ""
    try:
        target = load_target(path)
    except InputError as error:
        return None, printable(str(error).replace(str(path), TARGET_FILE))
    if target.geometry_id != geometry_id:
        return None, f"{TARGET_FILE}: not the target of these photos, so it is not drawn"
    return target, ""


def target_words(target: TargetGeometry) -> str:
    """What a target is, in a few words."""
    if target.spec is None:
        faces = "1 face" if target.is_planar else f"{target.face_count} faces"
        return f"a target of {faces} and {target.ring_count} rings"
    return with_article(target.spec.words)
