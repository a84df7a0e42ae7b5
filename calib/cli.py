"""The command `calib`."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from designer.errors import InputError

app = typer.Typer(name="calib", help="Use calibration targets.", rich_markup_mode=None, pretty_exceptions_enable=False)


@app.callback()
def _commands() -> None:
    """Use the calibration targets that `design` makes."""


@app.command()
def target(file: Annotated[Path, typer.Argument(help="a target file (NAME.target.json)")]) -> None:
    """Read a target file as detector and calibrator will, and say what it holds."""
    from designer.target import bounding_radius_mm, load_target

    geometry = load_target(file)
    dots = int(geometry.is_dot.sum())
    kind = "made elsewhere" if geometry.spec is None else geometry.spec.kind
    marked = (
        "codes on its faces"
        if geometry.face_count > 1
        else "an origin mark"
        if dots
        else "no marks: orientation ambiguous"
    )
    print(f"{file}: {kind}, {geometry.source} geometry, {geometry.face_count} faces, {marked}")
    print(f"  rings {geometry.ring_count - dots}, dots {dots}")
    print(f"  radius of the target {bounding_radius_mm(geometry):.3f} mm")
    print(f"  layout id {geometry.layout_id}, geometry id {geometry.geometry_id}")


def main() -> None:
    """Run the command line; bad input ends in one line on standard error and exit code 2."""
    try:
        code = app(sys.argv[1:] or ["--help"], standalone_mode=False)
    except (typer.TyperException, InputError) as error:
        message = error.format_message() if isinstance(error, typer.TyperException) else str(error)
        print(f"error: {' '.join(message.split())}", file=sys.stderr)
        code = 2
    sys.exit(code or 0)


if __name__ == "__main__":
    main()
