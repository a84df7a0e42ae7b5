"""The command `design`. What it is made of loads when it begins."""

from designer.base.interrupts import hold_interrupts

TYPE_CHECKING = False
if TYPE_CHECKING:
    import typer


def app() -> "typer.Typer":
    """All commands."""
    from designer import commands

    return commands.app


def main() -> None:
    """Run the command line."""
    hold_interrupts()
    from designer.base.command import run

    run(app())


if __name__ == "__main__":
    main()
