"""The page of a rig: the same in memory and of its folder, with all that was checked, and of odd rigs, too."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calib.app.report import report
from calib.app.rig_page import limits_of, rig_page
from calib.draw.rig_pictures import WORST, pictured
from calib.judge.checks import read_criteria
from calib.judge.folders import RigRun, read_rig_run, write_rig
from calib.judge.halves import NoHalves, RigHalves, RigSplit
from calib.judge.judge import Judged, judge_rig
from calib.observe.calibration_file import Provenance
from calib.rigs.result import MechanismFit, RigCalibration
from designer.base.errors import InputError
from designer.page.blocks import Figure, Page, Steps, View3d
from designer.page.scene import Segments
from designer.page.shell import page_html
from tests.support.pages import blocks_of, findings_of, table_of
from tests.support.rig_views import ring, solved_slowly, stereo_pair

AGREE = RigHalves((RigSplit("by turns", 1.0, 60, 1.0, ()), RigSplit("in order", 0.9, 60, 1.0, ())))
PROVENANCE = Provenance("test 1")


@cache
def found() -> RigCalibration:
    """A ring of four."""
    return solved_slowly(ring(frames=6))


@cache
def judged() -> Judged:
    """The verdict on it."""
    return judge_rig(found(), AGREE, read_criteria())


def page_of(one: RigCalibration, verdict: Judged | None = None) -> Page:
    """Its page."""
    return rig_page(RigRun(one, PROVENANCE, verdict))


def titles(page: Page) -> list[str]:
    return [section.title for section in page.sections]


def test_a_rig_is_judged_again_by_other_limits(tmp_path: Path) -> None:
    """Limits that are given replace the verdict, by the halves that are stored; a broken limit changes nothing."""
    write_rig(tmp_path, found(), PROVENANCE, judged())
    limits = tmp_path / "mine.toml"
    limits.write_text('[residuals]\ngood = "0.001px"\nusable = "0.002px"\n')
    done = report(tmp_path, criteria=str(limits))
    assert done.drawn.headline is not None
    assert done.drawn.headline.level == "bad"
    again = read_rig_run(tmp_path)
    assert again.judged is not None
    assert again.judged.rig_halves == AGREE
    limits.write_text('[baselines]\ngood = "1%"\n')
    before = (tmp_path / "verdict.json").read_bytes()
    with pytest.raises(InputError, match=r"baselines.usable is missing"):
        report(tmp_path, criteria=str(limits))
    assert (tmp_path / "verdict.json").read_bytes() == before


def test_a_verdict_on_another_solution_is_left_out(tmp_path: Path) -> None:
    """A verdict that came from elsewhere is not told of this rig, and the page says what to do."""
    write_rig(tmp_path / "a", found(), PROVENANCE, judged())
    write_rig(tmp_path / "b", replace(found(), seconds=0.2), PROVENANCE, judged())
    (tmp_path / "a" / "verdict.json").write_bytes((tmp_path / "b" / "verdict.json").read_bytes())
    page = rig_page(read_rig_run(tmp_path / "a"))
    assert page.headline is not None
    assert page.headline.word == "not judged"
    assert any("on another solution" in finding.text for finding in findings_of(page))


def test_the_page_has_each_check_and_the_numbers_of_the_pairs() -> None:
    """Checks, tables, graph, scene and steps are there, and the tables say what the evidence holds."""
    verdict = judged()
    page = page_of(found(), verdict)
    told = {finding.title for finding in findings_of(page)}
    assert {check.title for check in verdict.verdict.checks} <= told
    blocks = list(blocks_of(page))
    assert any(isinstance(block, Figure) and block.title == "Frames that two cameras share" for block in blocks)
    pairs, ties = table_of(page, "Pairs"), table_of(page, "What each camera hangs on")
    assert pairs.rows[0][0].text == "front - left"
    assert len(pairs.rows) == 6
    places = table_of(page, "Places in the frame of front").rows
    assert [cell.text for cell in places[0][1:]] == ["0", "0", "0", ""]
    assert all("±" in cell.text for cell in places[2][1:4])
    assert len(ties.rows) == 4
    steps = next(block for block in blocks if isinstance(block, Steps))
    assert any(step.startswith("Hold the target where") for step in steps.items)
    assert "What is not in the numbers" in titles(page)


@pytest.mark.parametrize(("variance", "is_inside"), [(None, False), (0.0, False), (1e-6, True)])
def test_an_exact_target_is_not_said_to_be_in_the_deviations(variance: float | None, is_inside: bool) -> None:
    """Only a covariance that is not zero holds anything of the target; else its scale is in all lengths, and said."""
    covariance = None if variance is None else variance * np.eye(len(found().covariance))
    lines = " ".join(limits_of(RigRun(replace(found(), target_covariance=covariance), PROVENANCE, judged())))
    assert ("is in the standard deviations" in lines) == is_inside
    assert ("taken to be as its file says" in lines) != is_inside


def test_ellipses_are_the_deviations_times_what_is_said() -> None:
    """The largest half axis of the drawn ellipses is the largest deviation of a camera's place, enlarged as told."""
    page = page_of(found())
    view = next(block for block in blocks_of(page) if isinstance(block, View3d))
    layer = next(layer for layer in view.scene.layers if layer.name == "uncertainty of the cameras")
    (lines,) = layer.shapes
    assert isinstance(lines, Segments)
    times = float(next(text for _, text in view.scene.legend if "x" in text and "deviations" in text).split()[-1])
    centers = found().rig.center_mm[1:]
    reach = np.linalg.norm(lines.ends_mm[:, 0, None] - centers[None], axis=2).min(axis=1).max()
    rng, spread = np.random.default_rng(0), []
    for row in range(1, 4):
        rows = found().rig.pose_rows(row)
        step = rng.multivariate_normal(np.zeros(6), found().covariance[rows, rows], 4000)
        pose = found().cam_from_rig[row]
        moved = -(step[:, 3:] + np.cross(step[:, :3], -pose[:3, 3]))  # of the centre, in the camera's axes
        spread.append(np.sqrt(np.linalg.eigvalsh(np.cov(moved.T))[-1]))
    assert reach == pytest.approx(times * max(spread), rel=0.05)


@pytest.mark.parametrize("refined", [True, False])
def test_one_camera_on_a_robot_has_a_page(refined: bool) -> None:
    """Without pairs there are no distances, and what carries it is told: its errors, the worst frame first."""
    pair = solved_slowly(stereo_pair(frames=5), refined=(refined, refined))
    seen, rows = pair.observations, pair.rig.first_row[1]
    error = np.zeros((5, 6))
    error[3, 3:] = (3.0, 0, 4.0)
    alone = replace(
        pair, observations=replace(seen, camera_names=("left",), sightings=seen.sightings[:1], frame=seen.frame[:1]),
        cameras=pair.cameras[:1], cam_from_rig=pair.cam_from_rig[:1], residual_px=pair.residual_px[:1],
        is_outlier=pair.is_outlier[:1], scale=pair.scale[:1], covariance=pair.covariance[:rows, :rows],
        fixed=pair.fixed[:1], reference=-1, rig_frame="flange",
        carrier=MechanismFit("robot, camera in hand", np.eye(4), np.eye(6), 1e-3, 1.0, error, None, ("its height",)),
    )  # fmt: skip
    page = page_of(alone, judge_rig(alone, NoHalves("too few"), read_criteria()))
    assert "Distances and angles" not in titles(page)
    place = table_of(page, "Places in the frame of flange").rows[0]
    assert place[1].value == pytest.approx(alone.rig.center_mm[0, 0])
    worst = table_of(page, "The 5 frames").rows[0]
    assert (worst[0].text, worst[1].value) == ("frame003", pytest.approx(5.0))
    assert any(finding.text == "Its height" for finding in findings_of(page))
    page_html(page)


def test_what_is_not_determined_has_a_page() -> None:
    """Without covariances the page says so and shows where the cameras are, without ellipses."""
    lost = replace(
        found(), status="degenerate", remarks=("all rotations are about one axis",),
        covariance=np.full_like(found().covariance, np.nan),
        frame_covariance=np.full_like(found().frame_covariance, np.nan),
        pose_covariance=tuple(np.full_like(one, np.nan) for one in found().pose_covariance),
    )  # fmt: skip
    page = page_of(lost, judge_rig(lost, NoHalves("no"), read_criteria()))
    assert page.headline is not None
    assert "all rotations are about one axis" in page.headline.sentence
    view = next(block for block in blocks_of(page) if isinstance(block, View3d))
    assert "uncertainty of the cameras" not in {layer.name for layer in view.scene.layers}
    assert "nan" not in page_html(page).decode().split("<script")[0]


def test_a_rig_of_many_cameras_shows_the_worst_photos_and_no_more_than_a_page_takes() -> None:
    """A photo of each camera first, then usual ones, as long as there is room; each as bad as is said."""
    rows = [0, 1, 2, 3] * 4
    seen = found().observations
    many = replace(
        found(), cameras=tuple(found().cameras[row] for row in rows), cam_from_rig=found().cam_from_rig[rows],
        residual_px=tuple((1 + number) * found().residual_px[row] for number, row in enumerate(rows)),
        is_outlier=tuple(found().is_outlier[row] for row in rows), scale=found().scale[rows],
        fixed=tuple(found().fixed[row] for row in rows),
        priors=((),) * 16, pose_covariance=tuple(found().pose_covariance[row] for row in rows),
        covariance=np.zeros((sum(len(found().cameras[row].params) + 6 for row in rows),) * 2),
        observations=replace(
            seen, camera_names=tuple(f"cam{number}" for number in range(16)),
            sightings=tuple(seen.sightings[row] for row in rows), frame=tuple(seen.frame[row] for row in rows),
        ),
    )  # fmt: skip
    chosen = pictured(many)
    assert [one.camera for one in chosen] == list(range(4, 16))
    assert all(one.why == WORST for one in chosen)
    few = pictured(found())
    assert [one.camera for one in few] == [0, 0, 1, 1, 2, 2, 3, 3]
    assert all(worst.row.rmse_px > usual.row.rmse_px for worst, usual in zip(few[::2], few[1::2], strict=True))


def test_a_verdict_of_an_earlier_version_is_read(tmp_path: Path) -> None:
    """Rigs had a file of their own for it, with the halves in a key of their own; judged again it is `verdict.json`."""
    write_rig(tmp_path, found(), PROVENANCE, judged())
    now = json.loads((tmp_path / "verdict.json").read_text())
    earlier = {"format": "ringsolid.rig_verdict", "version": 1, "verdict": now["verdict"], "criteria": now["criteria"],
               "halves": {"splits": now["splits"]}, "next_frames": [], "next_poses": [],
               "solution_sha256": now["observations_sha256"]}  # fmt: skip
    (tmp_path / "verdict.json").unlink()
    (tmp_path / "rig_verdict.json").write_text(json.dumps(earlier))
    run = read_rig_run(tmp_path)
    assert run.faults == ()
    assert run.judged is not None
    assert (run.judged.verdict, run.judged.rig_halves) == (judged().verdict, AGREE)
    report(tmp_path, criteria="standard")
    assert (tmp_path / "verdict.json").exists()
    assert not (tmp_path / "rig_verdict.json").exists()
