"""The map of reach: against the annulus of two links, laws of its ranges, its poses, and the command."""

import json
import types
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

import ccm_opt
from ccm_opt.cli.commands import app
from ccm_opt.core.errors import ProblemError
from ccm_opt.core.executors import LocalWorkers
from ccm_opt.diagnosis.reach import spread_directions
from ccm_opt.io.reading import parse_problem
from ccm_opt.planning.tip_reach import ReachQuestion, ReachTask, look_at_cell
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import ReachMap
from ccm_opt.scene.bad_pose import refuse_bad_pose

from .conftest import SMALL_PROBLEM

TWO_LINKS = """\
schema = 1
name = "two links"

[workspace]
bounds = [-1.0, -1.0, 1.0, 1.0]

[arm]
links = 2
link_length = 0.2
radius = 0.01
base = [0.0, 0.0]
base_limit_deg = 200.0
joint_limit_deg = 120.0

[limits]
velocity = 2.0
acceleration = 10.0

[start]
joints_deg = [20.0, 60.0]

[goal]
position = [0.3, 0.1]
"""


@cache
def two_links() -> Problem:
    """Two links of 0.2 m in an empty room; the elbow bends by at most 120°."""
    return parse_problem(TWO_LINKS, "two.toml")


def assert_annulus(found: ReachMap, least: float) -> None:
    """What was found, at least a share of what there is, and what was proved, is what geometry says of two links."""
    x, y = found.axes
    radius = np.hypot(x[None, :], y[:, None])
    nearest = 2.0 * 0.2 * np.cos(np.deg2rad(60.0))
    farthest = 0.4
    assert found.reachable[(radius > nearest + 5e-3) & (radius < farthest - 5e-3)].mean() >= least
    assert not np.any(found.reachable[(radius < nearest - 1e-6) | (radius > farthest + 1e-6)])
    assert np.all(found.proved[(radius < nearest - 1e-6) | (radius > farthest + 1e-6)])
    assert not np.any(found.reachable & found.proved)


@pytest.mark.drawn(20, of="dear tests")
def test_two_links_reach_an_annulus_whatever_the_workers() -> None:
    """In an empty room the tip of two links reaches the annulus between full stretch and full bend, all round.

    With several processes results come in any order, and the map is the same.
    """
    maps = [ccm_opt.reach_map(two_links(), step=0.2, headings=2, workers=each) for each in (1, LocalWorkers(2))]
    assert_annulus(maps[0], 1.0)
    assert np.array_equal(maps[0].reachable, maps[1].reachable)
    assert np.array_equal(maps[0].taken, maps[1].taken)


def test_poses_of_a_cell_are_there_with_their_headings_and_sound() -> None:
    """Every pose of a cell has its tip in the middle and its heading, keeps limits and touches nothing."""
    problem = parse_problem(SMALL_PROBLEM, "small.toml")
    arm = problem.arm
    question = ReachQuestion.about(problem, 0.05, spread_directions(20, 2))
    looker = question.looker
    middle = np.array([0.33, 0.05])
    entered = look_at_cell(question, ReachTask((0, 0), middle, (looker.start,)))
    assert entered.arrived is not None
    turned = look_at_cell(question, ReachTask((0, 0), middle, (entered.arrived,), reached=True))
    assert turned.taken is not None
    assert turned.taken.sum() == len(turned.turned) > 1
    for unknowns in (entered.arrived, *turned.turned):
        pose = looker.stepper.pose(unknowns)
        assert pose.tip == pytest.approx(middle, abs=1e-6)
        refuse_bad_pose(arm, problem.workspace, pose.q, "pose")
    wanted = question.directions[turned.taken]
    for unknowns in turned.turned:
        assert (wanted @ looker.stepper.pose(unknowns).tip_direction).max() == pytest.approx(1.0, abs=1e-9)
    assert turned.gap >= 0.0


@given(st.lists(st.booleans(), min_size=1, max_size=12))
def test_ranges_hold_the_headings_that_were_taken_and_no_other(taken: list[bool]) -> None:
    """A heading lies in a range, whole turns aside, just when it was taken; ranges do not overlap."""
    count = len(taken)
    headings = 0.3 + 2.0 * np.pi * np.arange(count) / count
    cells = np.array(taken).reshape(1, 1, count)
    nothing = np.zeros((1, 1))
    axes, none = (np.zeros(1), np.zeros(1)), np.zeros((0, 2))
    found = ReachMap(
        two_links(),
        0.1,
        axes,
        headings,
        none,
        cells.any(axis=2),
        cells,
        nothing,
        nothing > 0.0,
        0.1,
        {},
    )
    held = np.zeros(count, dtype=int)
    for _, _, first, last in found.heading_ranges:
        for turn in (0.0, 2.0 * np.pi):
            held += (headings + turn >= first - 1e-9) & (headings + turn <= last + 1e-9)
    # A range all round begins and ends at the same heading.
    whole = all(taken)
    assert np.array_equal(held[1:] > 0, np.array(taken)[1:])
    assert held.max(initial=0) <= (2 if whole else 1)
    assert (held[0] > 0) == taken[0]


def test_questions_that_make_no_sense_are_refused() -> None:
    """A grid without cells, and no headings, are bad input."""
    with pytest.raises(ProblemError, match="--step"):
        ccm_opt.reach_map(two_links(), step=0.0)
    with pytest.raises(ProblemError, match="--headings"):
        ccm_opt.reach_map(two_links(), headings=0)


def run(*arguments: object) -> tuple[int, str]:
    """Exit code and everything printed."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return result.exit_code, result.output


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The problem of two links as a file."""
    path = tmp_path / "two.toml"
    path.write_text(TWO_LINKS)
    return path


@pytest.mark.drawn(20, of="dear tests")
def test_the_command_writes_the_map_and_a_picture(file: Path) -> None:
    """``ccm-opt reach`` ends with 0; record and arrays agree, and the picture is there."""
    code, output = run("reach", file, "--step", 0.1, "--headings", 4, "--out", file.parent / "out")
    assert code == 0, output
    folder = file.parent / "out" / "two links"
    assert {each.name for each in folder.iterdir()} == {"reach.json", "reach.npz", "reach.png"}
    record = json.loads((folder / "reach.json").read_text())
    with np.load(folder / "reach.npz") as stored:
        arrays = dict(stored)
    assert record["reached"] == arrays["reachable"].sum()
    assert record["reached"] + record["proved_out_of_reach"] + record["no_pose_found"] == arrays["reachable"].size
    assert arrays["taken"].shape == (*arrays["reachable"].shape, 4)
    assert np.all(np.isfinite(arrays["gap"]) == arrays["reachable"])
    assert (folder / "reach.png").read_bytes().startswith(b"\x89PNG")


def test_cancelled_the_command_leaves_nothing(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C ends with exit code 130, a message, and no folder."""
    stand_in = types.ModuleType("ccm_opt.driver.reach_mapping")

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    stand_in.reach_map = interrupted  # type: ignore[attr-defined]
    monkeypatch.setitem(__import__("sys").modules, "ccm_opt.driver.reach_mapping", stand_in)
    code, output = run("reach", file, "--out", file.parent / "out")
    assert code == 130
    assert "cancelled" in output
    assert not (file.parent / "out").exists()


def test_a_start_that_touches_is_no_plan(file: Path) -> None:
    """An impossible start ends with exit code 3 and its reason."""
    file.write_text(TWO_LINKS.replace("bounds = [-1.0", "bounds = [-0.05").replace("[20.0, 60.0]", "[180.0, 0.0]"))
    code, output = run("reach", file, "--step", 0.2, "--out", file.parent / "out")
    assert code == 3
    assert "start" in output


def test_other_numbers_of_workers_change_no_settings() -> None:
    """A map keeps the problem that it was asked for, goals and all."""
    problem = replace(two_links(), name="kept")
    assert ccm_opt.reach_map(problem, step=0.2, headings=1).problem is problem
