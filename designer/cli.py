"""The command `design`. What it is made of loads when it begins."""

from designer.base.interrupts import hold_interrupts

TYPE_CHECKING = False
if TYPE_CHECKING:
    import typer

LINES = {
    "make": "Make a template or a TOML file.",
    "templates": "List the templates for targets, printers and manufacturing errors.",
    "check": "Check a design against a printer's rules.",
    "convert": "Write a target's points for another tool.",
}
"""What the list of commands says of each, as its docstring begins; a kind of target says it by itself."""
MODULES = {"templates": "templates", "check": "check", "convert": "convert"}
"""Those of `designer.app` in which a command is a function of its name; all others make a target."""
ABOUT = (
    "Design camera-calibration targets: from one size to files that print in two filaments.\n\n"
    "Begin with: design ico --edge 100mm"
)


def place_of(name: str) -> str:
    """Where the function of a command is: "module:function"."""
    return f"designer.app.{MODULES.get(name, 'make')}:{name}"


def app() -> "typer.Typer":
    """All commands."""
    from designer.base.command import Later, new_app
    from designer.spec.kind import KINDS

    own = {name: Later(place_of(name), help=LINES.get(name, "")) for name in dict.fromkeys((*KINDS, *LINES))}
    studies = {
        name: Later(f"calib.app.{name}:{name}") for name in ("choose", "tolerance", "ways")
    }  # the steps that calibrate
    return new_app("design", ABOUT, {**own, **studies})


def main() -> None:
    """Run the command line."""
    hold_interrupts()
    from designer.base.command import run

    run(app())


if __name__ == "__main__":
    main()
