"""Square markers that carry a number, as ChArUco boards and AprilGrids have them: read, and held against a layout.

A number that is read may be of a cover, of another board, or wrong. Two markers agree where each lies as the other's
own four corners say; a face is the largest set of markers that agree, and a marker that lies on its lattice with
another number than the layout has there speaks against the layout.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.core import homography
from calib.detector.marks import FoundFace
from calib.detector.marks.marker_points import MarkerLayout, named_points
from calib.detector.place import nearest_rows
from designer.base.arrays import Array, Flags, Rows
from designer.base.words import counted
from designer.marks.dictionaries import MARKERS, TAG_TURN, marker_cells

READ_PIXELS = 2_000_000
"""Markers are read in photos reduced to about this size, and only if that is not enough in larger ones ..."""
MOST_PIXELS = 9_000_000
"""... up to this."""
SHORTEST_PX = 8.0
"""Side of the smallest markers that are looked for."""
MOST_MARKERS = 1500
REACH, ALIKE = 3.2, 0.45
"""Markers up to so many steps of the lattice apart are compared; they agree within that share of a side."""
ON_LATTICE, NEAR_LATTICE = 0.2, 2.5
"""In steps: how near a place of the lattice, and how near its markers, one stands on it."""
SPEAKS_AGAINST = 1 / 8
"""Share of those that agree, by which more on their lattice that do not refuse the layout."""
LESSER = 1 / 3
"""A second board of so large a share of the first one's markers leaves open which of them is meant."""
INVERTED = "inverted: the image shows the board white on black; its grey levels were exchanged for the search"
MIRRORED = "mirrored: the image shows the board in a mirror, or was flipped; flip it back and detect again"
LEAST_OF_ANOTHER = 4
"""So many markers of another dictionary are no chance."""
LEAST_PRINTED = 3
SEARCHES, BESIDE, CELL_PX, LIKE_ITSELF = 3, 1.6, 6, 0.8
"""Rounds, steps, samples of a cell, and the correlation with a marker's picture: another has .74 at most."""
SOME, MOST_QUADS = 50, 600
"""A dictionary's markers, and quadrangles in a photo, beyond which other dictionaries are not tried."""
WHY_PIXELS = 700_000


@dataclass(frozen=True, eq=False)
class Markers:
    """N markers that were read."""

    number: Rows  # (N,)
    corner_px: Array  # (N, 4, 2) clockwise from the marker's own upper left one, as OpenCV draws it

    def take(self, rows: NDArray[np.generic]) -> "Markers":
        """Some of them."""
        return Markers(self.number[rows], self.corner_px[rows])


@dataclass(frozen=True)
class MarkedFace:
    """Its layout as told, and those that its makers or a slip may have made of it, with what is to be said then."""

    told: MarkerLayout
    others: Callable[[Markers], Iterator[tuple[MarkerLayout, str]]]  # that the markers seen may be of


def read_markers(
    pixels: NDArray[np.uint8],
    dictionary: str,
    border_bits: int,
    factor: int = 1,
    most: int | None = None,
    *,
    is_fine: bool = False,
) -> Markers:
    """The markers of a dictionary, or of its first ones, in an image that is reduced by a factor first.

    Their corners are good to a pixel or two; if asked for, to some tenths.
    """
    detector = _detector(pixels.shape, factor, dictionary, border_bits, most, is_fine=is_fine)
    corners, numbers, _ = detector.detectMarkers(_reduced(pixels, factor))
    if numbers is None or not len(numbers):
        return Markers(np.zeros(0, dtype=np.int64), np.zeros((0, 4, 2)))
    corner = (np.array(corners, dtype=np.float64).reshape(-1, 4, 2) + 0.5) * factor - 0.5
    found = Markers(np.asarray(numbers, dtype=np.int64).reshape(-1), corner)
    return found.take(np.argsort(-_sides(corner), kind="stable")[:MOST_MARKERS])


def _detector(
    shape: tuple[int, ...], factor: int, dictionary: str, border_bits: int, most: int | None, *, is_fine: bool = False
) -> cv2.aruco.ArucoDetector:
    parameters = cv2.aruco.DetectorParameters()
    if is_fine:
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        # Squares that touch a tag cut its corners off: by more than a third of a cell.
        parameters.relativeCornerRefinmentWinSize = 0.7
    parameters.markerBorderBits = border_bits
    parameters.minMarkerPerimeterRate = 4 * SHORTEST_PX * factor / max(shape)
    known = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    known.bytesList = known.bytesList[:most]
    return cv2.aruco.ArucoDetector(known, parameters)


def _quads(pixels: NDArray[np.uint8]) -> int:
    """How many quadrangles there are that no marker is made of."""
    return len(_detector(pixels.shape, 1, "DICT_4X4_50", 1, 1).detectMarkers(pixels)[2])


def _reduced(pixels: NDArray[np.uint8], factor: int) -> NDArray[np.uint8]:
    if factor == 1:
        return pixels
    size = pixels.shape[1] // factor, pixels.shape[0] // factor
    return np.asarray(cv2.resize(pixels[: size[1] * factor, : size[0] * factor], size, interpolation=cv2.INTER_AREA))


def _sides(quad: Array) -> Array:
    """Mean sides of quadrangles.  # (N, 4, 2) -> (N,)"""
    return np.asarray(np.linalg.norm(quad - np.roll(quad, 1, axis=1), axis=2).mean(axis=1))


@dataclass(frozen=True, eq=False)
class Agreement:
    """Which of the markers that were read agree on one place of a layout."""

    markers: Markers
    rows: Rows  # of the markers that agree
    against: Rows  # on their lattice, with another number than the layout has there
    second: int  # how many agree on another place of the same layout
    is_plane: bool  # those that agree do not stand in one row, or all that there are do

    @property
    def is_sound(self) -> bool:
        """Whether the markers are of this layout."""
        return self.is_plane and len(self.rows) > 1 and len(self.against) <= SPEAKS_AGAINST * len(self.rows)


def agreement(markers: Markers, layout: MarkerLayout) -> Agreement:
    """The largest set of markers that agree on where the layout lies."""
    own = np.flatnonzero((markers.number >= layout.first) & (markers.number < layout.first + len(layout.quad_mm)))
    none = np.zeros(0, dtype=np.int64)
    if len(own) < 2:
        return Agreement(markers, own, none, 0, is_plane=False)
    quad, corner = layout.quad_mm[markers.number[own] - layout.first], markers.corner_px[own]
    group = _groups(quad, corner, REACH * layout.step_mm)
    names, sizes = np.unique(group, return_counts=True)
    order = names[np.argsort(-sizes, kind="stable")]
    inside = _widened(quad, corner, markers.number[own], group == order[0])
    # A second board repeats numbers: parts of the first one that a cover cut off do not.
    taken = markers.number[own][inside]
    twice = [np.isin(markers.number[own][(group == one) & ~inside], taken).sum() for one in order[1:]]
    rows = own[inside]
    middle = quad[inside].mean(axis=1)
    is_plane = bool((np.ptp(middle, axis=0) > 0.5 * layout.step_mm).all())
    is_plane |= bool((np.ptp(layout.quad_mm.mean(axis=1), axis=0) < 0.5 * layout.step_mm).any())
    return Agreement(
        markers, rows, _against(markers, rows, quad[inside], layout.step_mm), int(max(twice, default=0)), is_plane
    )


def _groups(quad: Array, corner: Array, reach_mm: float) -> Rows:
    """A number for each marker, the same for markers that agree, one with the next.  # (N,)"""
    middle = quad.mean(axis=1)
    near = np.linalg.norm(middle[:, None] - middle[None], axis=2)
    a, b = np.nonzero((near > 0) & (near < reach_mm))
    maps = np.array([cv2.getPerspectiveTransform(q.astype(np.float32), c.astype(np.float32))
                     for q, c in zip(quad, corner, strict=True)])  # fmt: skip
    off = np.zeros((len(a), 4))
    for k in range(4):
        off[:, k] = np.linalg.norm(homography.apply(maps[a], quad[b, k]) - corner[b, k], axis=1)
    fits = np.zeros((len(quad), len(quad)), dtype=np.bool_)
    with np.errstate(invalid="ignore"):
        fits[a, b] = off.max(axis=1) < ALIKE * _sides(corner)[b]
    # A small or slanted marker says little of its neighbours: one of the two is enough.
    fits |= fits.T
    group = np.arange(len(quad))
    while True:
        lowest = np.minimum(group, np.where(fits, group[None], len(group)).min(axis=1))
        if np.array_equal(lowest, group):
            return group
        group = lowest


def _widened(quad: Array, corner: Array, number: Rows, inside: Flags) -> Flags:
    """With the markers that lie where those inside say, also beyond a gap.  # (N,)"""
    while True:
        rows, rest = np.flatnonzero(inside), np.flatnonzero(~inside & ~np.isin(number, number[inside]))
        if not len(rest):
            return inside
        near = nearest_rows(quad[rest].mean(axis=1), quad[rows].mean(axis=1), 4)
        more = []
        for one, nearest in zip(rest, rows[near], strict=True):
            there = homography.apply(homography.direct(_flat(quad[nearest]), _flat(corner[nearest])), quad[one])
            if np.linalg.norm(there - corner[one], axis=1).max() < ALIKE * _sides(corner[one : one + 1])[0]:
                more.append(one)
        if not more:
            return inside
        _, first = np.unique(number[more], return_index=True)
        inside = inside.copy()
        inside[np.array(more)[first]] = True


def _flat(quad: Array) -> Array:
    return np.ascontiguousarray(quad.reshape(-1, 2))


def _against(markers: Markers, rows: Rows, quad: Array, step_mm: float) -> Rows:
    """Markers on the lattice of those that agree, but with other numbers than these say."""
    rest = np.setdiff1d(np.arange(len(markers.number)), rows)
    found = []
    for one in rest:
        away = np.linalg.norm(markers.corner_px[rows].mean(axis=1) - markers.corner_px[one].mean(axis=0), axis=1)
        near = np.argsort(away, kind="stable")[:4]
        back = homography.direct(_flat(markers.corner_px[rows[near]]), _flat(quad[near]))
        offset = homography.apply(back, markers.corner_px[one]) - quad[near[0]]
        step = np.round(offset.mean(axis=0) / step_mm)
        off = np.abs(offset - step * step_mm).max() / step_mm
        if off < ON_LATTICE and 0 < np.abs(step).max() < NEAR_LATTICE:
            found.append(one)
    return np.array(found, dtype=np.int64)


def find_marked(pixels: NDArray[np.uint8], faces: Sequence[MarkedFace]) -> tuple[FoundFace, ...]:
    """A record of each face of which something is to be told; see `marks.Finder`."""
    twice = _alike(faces)
    if twice is not None:
        return (
            _nothing(twice[1], f"faces {twice[0]} and {twice[1]} carry the same markers: which is seen is not told"),
        )
    found = _find_as_is(pixels, faces)
    if found:
        return found
    # Why there is nothing is looked for in a small picture: of the fields of a video few show the board.
    small = _reduced(pixels, max(1, int(np.ceil((pixels.size / WHY_PIXELS) ** 0.5))))
    if min(small.shape) < 4 * SHORTEST_PX or _quads(small) > MOST_QUADS:
        return ()
    if any(len(one.row) for one in _find_as_is(np.ascontiguousarray(small[:, ::-1]), faces)):
        return (_nothing(0, MIRRORED),)
    if any(len(one.row) for one in _find_as_is(np.asarray(cv2.bitwise_not(small)), faces)):
        found = _find_as_is(np.asarray(cv2.bitwise_not(pixels)), faces)
        return tuple(replace(one, remarks=(INVERTED, *one.remarks)) for one in found)
    return tuple(_nothing(0, said) for said in _other_dictionaries(small, faces[0].told))


def _alike(faces: Sequence[MarkedFace]) -> tuple[int, int] | None:
    """Two faces that share markers."""
    told = [marked.told for marked in faces]
    for b, two in enumerate(told):
        for a, one in enumerate(told[:b]):
            is_one_kind = (one.dictionary, one.border_bits) == (two.dictionary, two.border_bits)
            if is_one_kind and one.first < two.first + len(two.quad_mm) and two.first < one.first + len(one.quad_mm):
                return a, b
    return None


def _nothing(face: int, *remarks: str) -> FoundFace:
    return FoundFace(face, np.zeros(0, dtype=np.int64), np.zeros((0, 2)), remarks)


def factors(shape: tuple[int, ...]) -> Iterator[int]:
    """Whole factors by which a photo is reduced, one after the other."""
    whole = shape[0] * shape[1]
    factor = 1
    while whole > READ_PIXELS * factor * factor:
        factor += 1
    yield factor
    while factor > 1 and whole <= MOST_PIXELS * (factor - 1) ** 2:
        factor = max(factor // 2, 1)
        yield factor


def _find_as_is(pixels: NDArray[np.uint8], faces: Sequence[MarkedFace]) -> tuple[FoundFace, ...]:
    """In the image as it is: smaller markers are looked for only where none is sound."""
    records: list[FoundFace] = []
    for factor in factors(pixels.shape) if min(pixels.shape) >= 4 * SHORTEST_PX else ():
        told = [marked.told for marked in faces]
        kinds = {(one.dictionary, one.border_bits) for one in told}
        # Some more than there are, to see that a board is larger: all of a thousand would take ten times as long.
        most = SOME + 2 * max(one.first + len(one.quad_mm) for one in told)
        read = {kind: read_markers(pixels, *kind, factor, most) for kind in kinds}
        best = [_agreement_in(pixels, read[one.dictionary, one.border_bits], one) for one in told]
        sound = [face for face, one in enumerate(best) if one.is_sound]
        # A face that is not in view is nothing to speak of where another is.
        odd = {face: _as_printed(faces[face], best[face]) for face in sound or range(len(faces))}
        records = [_named(pixels, face, told[face], best[face]) for face in sound if not odd[face]]
        if any(len(one.row) for one in records):
            break
        records = records or [_nothing(face, words) for face, words in odd.items() if words]
    return tuple(records)


def _agreement_in(pixels: NDArray[np.uint8], markers: Markers, layout: MarkerLayout) -> Agreement:
    """`agreement`; of few markers or those of one row, with those around them that OpenCV overlooked."""
    best = agreement(markers, layout)
    if best.is_plane or not len(best.rows) or len(best.against) > 1:
        return best
    for _ in range(SEARCHES):
        more = _beside(pixels, best.markers.take(best.rows), layout)
        if not len(more.number):
            break
        both = Markers(
            np.concatenate([best.markers.number, more.number]), np.concatenate([best.markers.corner_px, more.corner_px])
        )
        best = agreement(both, layout)
    return best


def _beside(pixels: NDArray[np.uint8], known: Markers, layout: MarkerLayout) -> Markers:
    """Markers next to known ones that look as they must there."""
    own = known.number - layout.first
    middle = layout.quad_mm.mean(axis=1)
    left = np.setdiff1d(np.arange(len(middle)), own)
    away = np.linalg.norm(middle[left][:, None] - middle[own][None], axis=2).min(axis=1) if len(left) else np.zeros(0)
    left = left[away < BESIDE * layout.step_mm]
    found, corner = [], []
    for one, near in zip(left, nearest_rows(middle[left], middle[own], 4), strict=True):
        there = homography.direct(_flat(layout.quad_mm[own[near]]), _flat(known.corner_px[near]))
        quad = homography.apply(there, layout.quad_mm[one])
        if not ((quad > 0) & (quad < np.array(pixels.shape[::-1]) - 1)).all():
            continue
        black = marker_cells(layout.dictionary, layout.first + int(one), layout.border_bits)
        ideal = np.where(black, 0, 255).astype(np.uint8).repeat(CELL_PX, axis=0).repeat(CELL_PX, axis=1)
        side = len(ideal)
        square = np.array([[0, 0], [side, 0], [side, side], [0, side]], dtype=np.float32) + CELL_PX - 0.5
        flat = cv2.getPerspectiveTransform(quad.astype(np.float32), square)
        patch = cv2.warpPerspective(pixels, flat, (side + 2 * CELL_PX, side + 2 * CELL_PX))
        likeness = cv2.matchTemplate(patch, ideal, cv2.TM_CCOEFF_NORMED)
        v, u = np.unravel_index(np.argmax(likeness), likeness.shape)
        if likeness[v, u] > LIKE_ITSELF:
            found.append(layout.first + int(one))
            back = homography.direct(square.astype(np.float64), quad)
            corner.append(homography.apply(back, square + np.array([u, v]) - float(CELL_PX)))
    return Markers(np.array(found, dtype=np.int64), np.array(corner).reshape(-1, 4, 2))


def _named(pixels: NDArray[np.uint8], face: int, told: MarkerLayout, best: Agreement) -> FoundFace:
    """The points of a face."""
    if best.second > LESSER * len(best.rows):
        return _nothing(face, f"two boards with the {told.holds} of {told.dictionary} are in view: cover one")
    remarks = ("of two boards with the same markers the larger was taken",) if best.second > 1 else ()
    known_mm = _flat(told.quad_mm[best.markers.number[best.rows] - told.first])
    known_px = _flat(best.markers.corner_px[best.rows])
    rows, near_px = named_points(pixels, told, known_mm, known_px)
    unlike = () if len(rows) else (f"{len(best.rows)} markers of {told.dictionary} are seen, but {told.unlike}",)
    return FoundFace(face, rows, near_px, (*remarks, *unlike))


def _as_printed(marked: MarkedFace, best: Agreement) -> str:
    """How markers that were seen are laid out, if not as told; "": no layout explains more of them."""
    if len(best.markers.number) < LEAST_PRINTED or (best.is_sound and not len(best.against)):
        return ""
    # Of a wide board the other pattern is the same but for a column: where most agree, all have to agree better.
    most, found = len(best.rows) - (0 if best.is_sound else len(best.against)), ""
    for layout, words in marked.others(best.markers):
        trial = agreement(best.markers, layout)
        if trial.is_sound and len(trial.rows) > most:
            most, found = len(trial.rows), words
    return found


def _other_dictionaries(pixels: NDArray[np.uint8], told: MarkerLayout) -> Iterator[str]:
    """Which dictionary's markers a photo shows, if not those of the target."""
    best = LEAST_OF_ANOTHER - 1, "", 1
    for name in MARKERS:
        for bits in {told.border_bits, 1, 2} if TAG_TURN in name else {1}:
            if (_stem(name), bits) == (_stem(told.dictionary), told.border_bits):
                continue
            # The first markers tell a dictionary; all of them would take ten times as long.
            count = len(np.unique(read_markers(pixels, name, bits, most=SOME).number))
            if count > best[0]:
                best = count, name, bits
    if best[1]:
        whole = max((name for name in MARKERS if _stem(name) == _stem(best[1])), key=MARKERS.__getitem__)
        number = np.unique(read_markers(pixels, whole, best[2]).number)
        name = next(one for one in MARKERS if _stem(one) == _stem(whole) and MARKERS[one] > number[-1])
        border = (f" with borders of {counted(bits, 'cell')}" for bits in (told.border_bits, best[2]))
        mine, other = ("", "") if best[2] == told.border_bits else border
        yield (
            f"of {told.dictionary}{mine} no marker is seen; of {name}{other} there are {len(number)}, {number[0]} to "
            f"{number[-1]}: make the target with the dictionary and borders that were printed"
        )


def _stem(name: str) -> str:
    """What dictionaries that begin alike have in common, such as DICT_5X5_."""
    return name[:9] if "X" in name[:7] else name
