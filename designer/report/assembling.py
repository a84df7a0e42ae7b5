"""The page's section on a solid in parts: its plates, its pieces, and the steps from printer to measured target."""

from collections.abc import Sequence

from designer.formats.folder import OutputFile
from designer.make.assembly import Assembly
from designer.make.mounts import Mount
from designer.page.blocks import Block, Command, Fold, Leaf, Section, Steps, Table, View3d, text_table
from designer.produce import Design
from designer.report.assembly_pictures import exploded_scene
from designer.report.costs import grams
from designer.report.making import colour_words
from designer.report.measuring import example_length
from designer.report.plates import plate_figures, plate_folds, plate_table

_LIES = {
    "cap": "open side down", "bowl": "open side down", "core": "open side down", "lid": "seat up", "ring": "flat",
    "socket": "pit up",
}  # fmt: skip


def assembling_section(design: Design, assembly: Assembly, files: Sequence[OutputFile]) -> Section:
    """How to print and assemble it."""
    count, inked = len(design.target.target_from_face), sum(plate.is_two_filament for plate in design.plates)
    lead = (
        f"{count} flat tiles on {inked} plate{'s' * (inked > 1)} in two filaments, a core in one; each tile fits one "
        "seat in one orientation, and each can be printed again alone."
    )
    view = View3d(
        "Taken apart",
        exploded_scene(design, assembly),
        f"{count} numbered tiles around a core; the colour of their backs tells the plate that they are printed on.",
        caption="The number of a tile is engraved on its back and in its seat.",
    )
    blocks: tuple[Block, ...] = (
        view,
        plate_table(design),
        Fold("1. Print the plates", (_settings(design, assembly), *plate_figures(design)), is_open=True),
        *plate_folds(design, [file.name for file in files]),
        Fold("2. Look at the tiles", (_checks(assembly),), is_open=True),
        Fold("3. Assemble", (_core_table(design, assembly), _steps(design, assembly)), is_open=True),
        Fold("4. Measure it", _measuring(design), is_open=True),
    )
    return Section("Making it", blocks, lead)


def _settings(design: Design, assembly: Assembly) -> Table:
    """What holds in every slicer."""
    printing, printer, sizes = design.job.printing, design.job.printing.printer, assembly.sizes
    if sizes.ink_side == "down":
        lying = (
            "printed face down, as the files have it: the ink is in the first layers, as flat as the bed, and as "
            "glossy as a smooth one. A textured sheet mats it, but rings then have its grain; else mat the face after "
            "printing, or --ink-side up"
        )
    else:
        lying = (
            "printed face up, as the files have it: the ink is in the last layers, matt, with the lines of the top "
            "layer to be seen and less flat than the bed; --ink-side down gives smooth faces that shine"
        )
    rows = {
        "printer": f"{printer.name}, nozzle {printer.nozzle_mm:g} mm",
        "how tiles lie": lying,
        "filament 1": f"body and core, {colour_words(printing.body_colour)}; the core may be of any colour",
        "filament 2": f"ink, {colour_words(printing.ink_colour)}",
        "surface": "matt plastic for both: on glossy plastic lamps are mirrored, and glare hides the edges of rings",
        "dry filament": "dry it by its maker's table: moist filament strings, and pits the black",
        "layer height": f"{printer.layer_height_mm:g} mm, the first layer too: the ink is "
        f"{printing.inlay_mm / printer.layer_height_mm:.3g} layers deep, a tile {sizes.thickness_mm:g} mm",
        "line width": f"{printer.line_width_mm:g} mm",
        "walls, infill": f"{printer.machine.shells.words()}",
        "supports": "off, for tiles and core",
        "brim": "off for tiles, if they hold: it would have to be cut off the edge that meets the neighbour",
        "ironing": "off: it drags ink over white",
        "outline": "XY and elephant-foot compensation at 0: the edge on the bed has a chamfer of "
        f"{sizes.chamfer_mm:g} mm for the foot, and neighbours are {sizes.clearance_mm:g} mm apart",
        "prime tower": "on, in the free corner that the pictures show; only the layers with ink change filament",
    }
    return text_table("Settings in every slicer", ("setting", "value"), rows.items(), visible_rows=len(rows))


def _checks(assembly: Assembly) -> Steps:
    """What to do with tiles off the bed."""
    gloss = (
        "If the face shines, mat it: a thin coat of matt clear varnish, or wet abrasive of grit 1000 or finer; try it "
        "on one tile.",
    )
    return Steps((
        "Let the bed cool before you take them off: a tile that is bent warm stays bent.",
        "Lay a steel rule across each face, along its three heights or both diagonals: light that shows through in the "
        "middle or at the ends is a bow; print a tile again that shows more than 0.1 mm, half a "
        "layer, as the error template fdm-tiles assumes.",
        "Strings and blobs at the edge or on the back keep a tile off its seat: cut them off.",
        *(gloss if assembly.sizes.ink_side == "down" else ()),
    ))  # fmt: skip


def _core_table(design: Design, assembly: Assembly) -> Table:
    """The pieces of the core: how they lie, and their weight if solid walls and sparse infill are as set."""
    takes = {plate.name: estimate for plate, estimate in zip(design.plates, design.estimate.plates, strict=True)}
    stem = "stem up" if assembly.mounted is not None and assembly.mounted.mount.up_is_in else "stem down"
    rows = []
    for plate in design.plates:
        if plate.is_two_filament:
            continue
        together = sum(piece.part.body.volume_mm3 for piece in plate.pieces)
        for piece in plate.pieces:
            corners = piece.part.body.vertices_mm @ piece.bed_from_part[:3, :3].T
            size = " x ".join(f"{length:.0f}" for length in (corners.max(axis=0) - corners.min(axis=0)))
            part = next((one for one in assembly.core if one.name == piece.name), None)
            seats = "" if part is None else ", ".join(map(str, part.seats))
            alone = len(plate.pieces) == 1
            share = takes[plate.name].body_g * piece.part.body.volume_mm3 / together
            rows.append((
                piece.name, _LIES.get(piece.name, stem), f"{size} mm",
                grams(share) if alone else f"about {grams(share)}", seats,
            ))  # fmt: skip
    heads = ("piece", "how it lies", "size", "weight", "seats")
    return text_table("Pieces of the core", heads, rows)


def _steps(design: Design, assembly: Assembly) -> Steps:
    """From pieces to a solid."""
    sizes, split = assembly.sizes, {part.name: part for part in assembly.core}
    key = (
        "Its pins go into the seat's holes in one orientation only; a tile that does not go in flat belongs elsewhere."
        if sizes.has_pins
        else f"Cut {3 * len(assembly.tiles)} pegs of {sizes.peg_length_mm - 0.5:.1f} mm from filament of 1.75 mm, "
        "three a tile; with them in its back a tile goes into one seat in one orientation only."
    )
    upper = split.get("cap") or split.get("lid")
    order = [
        *(f for part in assembly.core if part is not upper for f in part.seats),
        *(() if upper is None else upper.seats),
    ]
    steps = [
        f"Put all tiles on dry first, by their numbers. {key}",
        "Each must touch the three pads of its seat and not rock, and neighbours must not touch each other along a "
        "seam. If one is too high, clean pads and holes; push it out from inside, through the hole in the seat's "
        "middle.",
        "Glue: a thin film of slow glue (epoxy, or a flexible one) around the hole of the seat, none on the pads; the "
        f"gap for it is {sizes.glue_gap_mm:g} mm. Press the tile on its pads until it holds; wipe off what comes out "
        "of the seams.",
        f"Order: {', '.join(map(str, order[:-1]))} and {order[-1]}. Any other will do: each can be put in last.",
    ]
    if "ring" in split:
        steps.append(
            "Glue the ring into the cap, its gap over the rib in there, and put the cap on the bowl, whose rib lets "
            "it in one way. A few drops of glue hold it; without, it comes off again with its tiles."
        )
    if "lid" in split and upper is not None:
        steps.append(
            f"Put the lid into the core before tile {upper.seats[0]}: the tile lies on the rim around it, and holds it."
        )
    if assembly.mounted is not None:
        steps.insert(0, _mounting(assembly.mounted.mount, has_socket="socket" in split))
    return Steps((*steps, "Let the glue harden for a day before you measure: it shrinks."))


def _mounting(mount: Mount, *, has_socket: bool) -> str:
    """How the post gets into the core, before tiles close the view of it."""
    socket = (
        "Glue the socket into the bowl from inside: its slopes lie against those about the hole at the corner, its pit "
        "looks out. "
        if has_socket
        else ""
    )
    return (
        f"{socket}The post ({mount.title}) takes {mount.needs}: {mount.source}. {mount.how} Glue the post into the pit."
    )


def _measuring(design: Design) -> tuple[Leaf, ...]:
    """The commands at the end."""
    target = f"{design.job.name}.target.json"
    reading = example_length(design)
    return (
        Steps((
            "Take 40 photos or more all around, sharp, in even light, five tiles or more in each; and one length with "
            "a caliper, as told below. In simulations of an icosahedron 15 photos left a tenth of the tiles unknown, "
            "40 none.",
            "calib measure finds how each tile really sits, and names those that are worth taking off again. Its "
            "target file is the one to calibrate with: put your reading in.",
        )),
        Command(f"calib run {target} photos -o camera", "the camera, and where the rings were seen"),
        Command(
            f'calib measure {target} camera/detections.csv --photos photos --length "{reading}" -o measured/{target}',
            "how each tile sits, and the target as built",
        ),
    )  # fmt: skip
