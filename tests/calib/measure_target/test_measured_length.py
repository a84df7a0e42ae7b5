"""`calib measure` with a length and no photos, and lengths that nobody seems to have measured."""

from dataclasses import replace
from pathlib import Path

import pytest

from calib.measure_target.lengths import length_in
from designer.target import TargetGeometry, load_target, target_to_json
from tests.support.as_built_scenes import solid
from tests.support.command_line import Answer, calib, refused, summary_of
from tests.support.perturbed_targets import board


@pytest.fixture(autouse=True)
def target(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> TargetGeometry:
    """A target to measure, in the current folder."""
    monkeypatch.chdir(tmp_path)
    Path("ico.target.json").write_text(target_to_json(solid()))
    return solid()


def rescaled(length: str, *more: str) -> Answer:
    """Rescale the target to a length."""
    return calib("measure", "ico.target.json", "--measured-length", length, "-o", "out/ico.target.json", *more)


def test_the_next_print_comes_out_as_designed(target: TargetGeometry) -> None:
    """Made with the compensation that is told, the same printer's length is the design's: (1 + c) (1 + m) = 1."""
    design_mm, made_with, printer = length_in(target, "edge"), 0.2, 0.995
    reading = design_mm * (1 + made_with / 100) * printer
    summary = summary_of(rescaled(f"edge:{reading!r}mm", f"--shrink-compensation={made_with}%", "--json"))
    percent = summary["answer"]["next_shrink_compensation_percent"]
    assert (1 + percent / 100) * printer == pytest.approx(1)
    answer = rescaled(f"edge:{reading!r}mm", f"--shrink-compensation={made_with}%")
    assert f"design ... --shrink-compensation {percent:.3f}%" in answer.out
    assert "made with 0.2%" in answer.out


def test_a_size_within_the_reading_needs_no_correction(target: TargetGeometry) -> None:
    """A deviation below what the caliper tells gives no new compensation, and keeps the one that there was."""
    length = f"edge:{length_in(target, 'edge') + 0.02}mm+-0.02mm"
    assert "The size needs no correction." in rescaled(length).out
    said = rescaled(length, "--shrink-compensation", "0.3%").out
    assert "The size needs no correction: keep --shrink-compensation 0.3%." in said


def test_the_next_step_is_a_line_to_type() -> None:
    """The next command names the file that was written, which is a target of the size that was given."""
    summary = summary_of(rescaled("edge:100.3mm", "--json"))
    assert summary["next"][0].startswith("calib run out/ico.target.json photos -o camera ")
    assert length_in(load_target(Path("out/ico.target.json")), "edge") == pytest.approx(100.3)


@pytest.mark.parametrize(("off_mm", "is_doubted"), [(0.0, True), (0.004, True), (-0.004, True), (0.006, False)])
def test_a_length_that_is_the_designs_is_doubted(target: TargetGeometry, off_mm: float, *, is_doubted: bool) -> None:
    """To 0.005 mm the design's value: that is said, for people and programs, and refuses nothing."""
    length = f"face-to-face:{length_in(target, 'face-to-face') + off_mm}mm"
    answer = rescaled(length, "--json")
    doubts = [one for one in summary_of(answer)["remarks"] if "is it a reading?" in one]
    assert (answer.code, len(doubts)) == (0, is_doubted)
    assert ("is the design's value to 0.005 mm: is it a reading?" in answer.err) == is_doubted


@pytest.mark.parametrize(
    ("made", "factor", "said"),
    [("fdm-dual", 1.005, ""), ("fdm-dual", 1.03, "check the reading"), ("sheet-print", 1.005, "check the reading"),
     ("fdm-dual", 1.19, "no print is off by more than 10 %")],
)  # fmt: skip
def test_a_length_that_no_print_has_is_not_taken_unasked(
    target: TargetGeometry, made: str, factor: float, said: str
) -> None:
    """Beyond four standard deviations of its way of making a length is asked about, beyond a tenth it is refused."""
    answer = rescaled(f"edge:{factor * length_in(target, 'edge')}mm", "--made", made)
    assert answer.code == (2 if "no print" in said else 0)
    assert ("check" in answer.out + answer.err) == bool(said)
    assert said in answer.out + answer.err


def test_a_sheet_is_corrected_in_the_printers_dialog() -> None:
    """Paper has no shrinkage compensation, slicer or bed: what is advised is the size to print at."""
    sheet = replace(board(), build="sheet")
    Path("sheet.target.json").write_text(target_to_json(sheet))
    name = "ring 0 to ring 5"
    length = f"{name}:{1.004 * length_in(sheet, name)}mm+-0.01mm"
    said = calib("measure", "sheet.target.json", "--measured-length", length, "-o", "out/sheet.target.json").out
    assert "Print it at 99.602 % of its size." in said
    assert "design ..." not in said


def test_a_place_for_a_reading_is_refused() -> None:
    """A command copied from the page as it stands certifies nothing."""
    said = refused("measure", "ico.target.json", "--measured-length", "edge:READINGmm+-0.02mm", "-o", "m.target.json")
    assert "put your reading in place of 'READINGmm'" in said
    assert not Path("m.target.json").exists()
