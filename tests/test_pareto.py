"""The trade-off between time and room: which plans are made, which are dominated, which is recommended and written."""

import json
import re
import shutil
from dataclasses import replace
from functools import cache
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from typer.testing import CliRunner

from ccm_opt import load_problem, pareto
from ccm_opt.cli.commands import app
from ccm_opt.core.errors import ProblemError, UnreachableGoal
from ccm_opt.diagnosis.possible_gap import possible_gap
from ccm_opt.driver.clearance_over_time import clearance_over_time
from ccm_opt.driver.pareto import DEFAULT_PARETO, Judgement, ParetoSettings
from ccm_opt.io.reading import parse_problem
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import ParetoPlan, ParetoPlans, Solution
from ccm_opt.viz.paper_figures import pareto_png

from .conftest import PROBLEMS, SMALL_PROBLEM, make_solution

FIGURES = st.lists(st.tuples(st.floats(0.5, 5.0), st.floats(0.0, 0.05)), min_size=1, max_size=6)
"""Durations [s] and least gaps [m] of some plans."""


@cache
def small_plan() -> Solution:
    """A plan of the small problem with its gaps over time."""
    problem = parse_problem(SMALL_PROBLEM, "small.toml")
    solution = make_solution(problem, np.full(problem.arm.links, 0.3))
    return replace(solution, room=clearance_over_time(problem, solution.trajectory, 0.0))


def made_up(duration: float, gap: float) -> ParetoPlan:
    """A plan of which only the duration and the least gap count."""
    solution = small_plan()
    assert solution.room is not None
    trajectory = replace(solution.trajectory, time=duration * solution.trajectory.time)
    room = replace(solution.room, nearest=replace(solution.room.nearest, gap=gap, link=1, obstacle="post"))
    return ParetoPlan(gap, replace(solution, trajectory=trajectory, room=room))


@pytest.mark.planning
@given(figures=FIGURES)
def test_what_is_recommended_is_on_the_front_and_in_time(figures: list[tuple[float, float]]) -> None:
    """The fastest is never dominated but by an equally fast one, and the recommended plan is the roomiest in time."""
    plans = [made_up(duration, gap) for duration, gap in figures]
    judgement = Judgement(plans, 0.04, 1.0, DEFAULT_PARETO)
    judged = [replace(plan, dominated_by=judgement.dominator(plan)) for plan in plans]
    for plan in judged:
        if plan.dominated_by:
            other = plans[plan.dominated_by - 1]
            assert other.duration <= plan.duration * (1.0 + DEFAULT_PARETO.same_time)
            assert min(other.gap, 0.04) >= min(plan.gap, 0.04) - DEFAULT_PARETO.same_gap
    best = judged[judgement.recommended() - 1]
    most = 1.15 * min(plan.duration for plan in plans)
    assert not best.dominated_by
    assert best.duration <= most
    in_time = [plan for plan in judged if plan.duration <= most and not plan.dominated_by]
    assert min(best.gap, 0.04) == max(min(plan.gap, 0.04) for plan in in_time)


def test_a_plan_that_is_slower_with_less_room_is_dominated() -> None:
    """Of three plans the slow one with little room is dominated; equal ones do not dominate each other."""
    plans = [made_up(*figures) for figures in ((1.0, 0.002), (1.1, 0.010), (1.3, 0.004), (1.0, 0.002))]
    judgement = Judgement(plans, 0.04, 1.0, DEFAULT_PARETO)
    assert [judgement.dominator(plan) for plan in plans] == [0, 0, 2, 0]
    assert judgement.recommended() == 2
    assert replace(judgement, trade_off=ParetoSettings(most_time=0.05)).recommended() in {1, 4}
    # Where no more than 1 mm is worth anything, the fastest are as roomy as the others.
    assert replace(judgement, most_gap=0.001).recommended() in {1, 4}


def test_the_energy_is_the_work_of_all_drives(small_solution: Solution) -> None:
    """Under a torque of 2 N m the work is twice the angle that every revolute turns through."""
    joints = replace(small_solution.joints, torques=np.full_like(small_solution.joints.torques, 2.0))
    plan = ParetoPlan(0.0, replace(small_solution, joints=joints))
    turned = np.abs(np.diff(joints.angles, axis=0)).sum()
    assert plan.energy == pytest.approx(2.0 * turned, rel=1e-3)


def test_the_picture_shows_plans_that_there_are_not(small_problem: Problem) -> None:
    """A plan without a solution has a place in the picture, and the picture is one."""
    plans = (made_up(1.0, 0.002), ParetoPlan(0.01, None, "no motion was found"))
    picture = Image.open(BytesIO(pareto_png(ParetoPlans(small_problem, plans, 1, 0.15))))
    assert picture.width > picture.height > 200


def test_planners_that_know_no_wanted_gap_are_refused() -> None:
    """Neither an arm on a feed axis nor the baseline has a trade-off to offer."""
    fed = load_problem(PROBLEMS / "feed-s-duct.toml")
    fork = load_problem(PROBLEMS / "fork.toml")
    climbing = replace(fork, planner=replace(fork.planner, method="hill-climbing"))
    for problem in (fed, climbing):
        with pytest.raises(ProblemError, match="the trade-off needs a fixed base"):
            pareto(problem)


def test_without_any_plan_there_is_a_reason(small_problem: Problem) -> None:
    """Where not even the plan that asks for nothing exists, it is said why."""
    goal = replace(small_problem.goal, position=np.array([0.9, 0.9]))  # type: ignore[type-var]
    with pytest.raises(UnreachableGoal, match="reach"):
        pareto(replace(small_problem, goal=goal), explain=False)


SMALL_IN_SPACE = """
schema = 1
space = 3
name = "post"

[workspace]
bounds = [[-0.1, -0.5, -0.5], [1.0, 0.5, 0.5]]

[[workspace.obstacles]]
name = "post"
cylinder = {{ from = [0.4, {aside}, -0.5], to = [0.4, {aside}, 0.5], radius = 0.05 }}

[arm]
links = 8
link_length = 0.1
radius = 0.02
base = {{ position = [0.0, 0.0, 0.0], direction = [1.0, 0.0, 0.0], up = [0.0, 0.0, 1.0] }}
joint_limit_deg = 60.0

[limits]
velocity = 1.0
acceleration = 5.0

[start]
shape = "straight"

[goal]
position = [0.6, 0.3, {height}]
"""
"""An arm beside a post in space; where the post stands and how high the goal is are put in."""


@pytest.mark.drawn(20, of="dear tests")
@settings(max_examples=1, deadline=None)
@given(aside=st.floats(0.08, 0.2), height=st.floats(-0.2, 0.2))
def test_no_motion_in_space_has_more_room_than_its_bound(aside: float, height: float) -> None:
    """No wanted gap leads to a plan that keeps more than the bound, but for the tolerance of the goal."""
    problem = parse_problem(SMALL_IN_SPACE.format(aside=aside, height=height), "post.toml")
    assert problem.dimension == 3
    found = pareto(problem, explain=False, trade_off=ParetoSettings(shares=(0.5, 1.0)))
    top = 4.0 * problem.default_gap
    for plan in found.plans:
        assert plan.solution is not None
        room = clearance_over_time(problem, plan.solution.trajectory, top)
        bound = possible_gap(problem, room)
        assert bound is not None
        assert min(room.nearest.gap, top) <= bound.value + problem.tolerances.position
        assert plan.wanted_gap <= bound.value + 1e-12
    assert found.best.room is not None
    assert found.plans[found.recommended - 1].duration <= 1.15 * found.fastest


def with_gap(problem: Problem, gap: float) -> Problem:
    """The problem with another wanted gap [m]."""
    return replace(problem, planner=replace(problem.planner, wanted_gap=gap), source="")


# ---------------------------------------------------------------- through the command line


def run(*arguments: object) -> tuple[int, str]:
    """Exit code and everything printed."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    return result.exit_code, result.output


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An arm beside a post in space."""
    made = tmp_path_factory.mktemp("problems") / "post.toml"
    made.write_text(SMALL_IN_SPACE.format(aside=0.12, height=0.1))
    return made


@pytest.fixture(scope="module")
def forked(file: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The folder with the plans of a problem, and what was printed."""
    out = tmp_path_factory.mktemp("runs")
    code, output = run("solve", "--pareto", file, "--out", out)
    assert code == 0, output
    return out / file.stem, output


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_five_plans_lead_from_the_fastest_to_the_roomiest(forked: tuple[Path, str]) -> None:
    """More room costs more time; every plan keeps nine tenths of what it wants, and none asks for what nobody has."""
    folder, output = forked
    record = json.loads((folder / "pareto.json").read_text())
    plans = record["plans"]
    assert len(plans) == 5
    gaps = [plan["nearest"]["gap"] for plan in plans]
    wanted = [plan["wanted_gap"] for plan in plans]
    assert wanted == sorted(wanted)
    assert wanted[0] == 0.0
    assert all(gap > 0.9 * want for gap, want in zip(gaps, wanted, strict=True))
    assert gaps[-1] > gaps[0] + 0.005
    assert plans[-1]["duration"] > plans[0]["duration"]
    best = plans[record["recommended"] - 1]
    assert best["duration"] <= (1.0 + record["most_time"]) * min(plan["duration"] for plan in plans)
    assert f"plan {best['number']}, recommended:" in output
    for plan in plans:
        assert f"{plan['duration']:.3f}" in output


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_every_plan_can_be_checked_from_its_files(forked: tuple[Path, str]) -> None:
    """Each plan's folder passes the verifier by itself, and the problem's folder holds the recommended one."""
    folder, _ = forked
    record = json.loads((folder / "pareto.json").read_text())
    for plan in record["plans"]:
        code, output = run("check", folder / plan["folder"])
        assert code == 0, output
        printed = re.search(r"least gap (\S+) m", output)
        assert printed is not None
        assert float(printed[1]) == pytest.approx(plan["nearest"]["gap"], rel=0.01)
    with np.load(folder / "pareto" / str(record["recommended"]) / "solution.npz") as arrays:
        chosen = arrays["bend_angles"]
    with np.load(folder / "solution.npz") as arrays:
        np.testing.assert_array_equal(arrays["bend_angles"], chosen)
    solution = json.loads((folder / "solution.json").read_text())
    assert solution["room"]["price"] == pytest.approx(record["plans"][record["recommended"] - 1]["price"])


@pytest.mark.planning
def test_every_plan_has_a_page_that_leads_to_the_others(forked: tuple[Path, str]) -> None:
    """From every page each other plan is one link away, and files that a page names are beside it."""
    folder, _ = forked
    recommended = json.loads((folder / "pareto.json").read_text())["recommended"]
    inner = [folder / "pareto" / str(number) / "report.html" for number in range(1, 6)]
    for page in (folder / "report.html", *inner):
        links = re.findall(r'href="([^"#:]+)"', page.read_text())
        assert all((page.parent / link).exists() for link in links)
        reached = {(page.parent / link).resolve() for link in links if link.endswith("report.html")}
        own = inner[recommended - 1] if page.parent == folder else page
        assert reached == {other.resolve() for other in inner if other != own}


@pytest.mark.planning
def test_a_single_plan_takes_the_place_of_several(file: Path, forked: tuple[Path, str], tmp_path: Path) -> None:
    """A later solve leaves none of the five plans behind, and keeps what the user put beside them."""
    folder = tmp_path / forked[0].name
    shutil.copytree(forked[0], folder)
    (folder / "notes.txt").write_text("mine")
    code, output = run("solve", file, "--out", folder.parent, "--no-pictures")
    assert code == 0, output
    assert not (folder / "pareto").exists()
    assert not (folder / "pareto.json").exists()
    assert (folder / "notes.txt").read_text() == "mine"
