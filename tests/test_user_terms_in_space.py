"""Users' constraints and costs during whole motions of arms in space, through the library and the command line."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import ccm_opt
from ccm_opt import Constraint, Cost, Interval
from ccm_opt.cli.commands import app
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import MotionNotFound, NoPlanFound, ProblemError, UnreachableGoal
from ccm_opt.io.reading import parse_problem
from ccm_opt.problem import Problem, Stop, TipGoal
from ccm_opt.problem.solution import Solution

POST = """
schema = 1
space = 3
name = "post"
[workspace]
[[workspace.obstacles]]
name = "ball"
sphere = { center = [0.5, 0.15, 0.1], radius = 0.08 }
[arm]
links = 12
link_length = 0.083333
radius = 0.015
base = { position = [0.0, 0.0, 0.0], direction = [1.0, 0.0, 0.0], up = [0.0, 0.0, 1.0] }
joint_limit_deg = 50.0
[limits]
velocity = 1.0
acceleration = 5.0
[start]
shape = "straight"
[goal]
position = [0.5, 0.45, 0.2]
direction = [0.0, 1.0, 0.0]
[simulation]
step = 0.005
"""
FEED = "joint_limit_deg = 50.0\nfeed = { range = [0.0, 0.3] }"


@cache
def post(*, fed: bool = False) -> Problem:
    """An arm of a metre beside a ball, its goal to the left and above; fed, it is pushed out of a tube too."""
    text = POST
    if fed:
        text = text.replace("joint_limit_deg = 50.0", FEED).replace("[0.0, 0.0, 0.0], dir", "[-0.3, 0.0, 0.0], dir")
        text = text.replace("velocity = 1.0", "velocity = 1.0\nfeed_velocity = 0.2", 1)
        text = text.replace("acceleration = 5.0", "acceleration = 5.0\nfeed_acceleration = 1.0", 1)
    problem = parse_problem(text)
    assert problem.dimension == 3
    return problem


@cache
def free_motion() -> Solution:
    """The motion that nothing constrains."""
    return ccm_opt.solve(post())


def tips(solution: Solution) -> FloatArray:
    """Places of the tip at the samples, by the kinematics, shape (T, 3) [m]."""
    return np.asarray(solution.problem.arm.joint_positions_at(solution.trajectory.positions)[:, -1])


def residual(solution: Solution, name: str) -> float:
    """By how much a constraint is passed at worst, by the record; negative with room to spare."""
    return next(check.worst for check in solution.checks if check.name == f"constraint {name}")


@pytest.mark.drawn(4, of="terms in space")
def test_a_constraint_that_the_free_motion_breaks_is_kept_all_the_way() -> None:
    """It binds, holds at every sample by kinematics of another kind, and is recorded with its margin and place."""
    free = tips(free_motion())
    along = (free[-1] - free[0]) / np.linalg.norm(free[-1] - free[0])
    aside = free - free[0] - np.outer((free - free[0]) @ along, along)
    # The tip swings out beside the straight way; that it is free to do by half.
    out = aside[int(np.argmax(np.linalg.norm(aside, axis=1)))]
    bound = 0.5 * float(np.linalg.norm(out))
    normal = out / np.linalg.norm(out)
    bulge = Constraint("bulge", lambda q: sum(normal[k] * (q.tip[k] - free[0, k]) for k in range(3)), upper=bound)
    solution = ccm_opt.solve(post(), constraints=[bulge])
    assert bound < float(np.max((free - free[0]) @ normal))
    assert float(np.max((tips(solution) - free[0]) @ normal)) <= bound + 1e-6
    check = next(check for check in solution.checks if check.name == "constraint bulge")
    assert check.passed
    assert -0.5 < check.worst <= 1e-6
    assert "t = " in check.where
    assert solution.metrics["residual_bulge"] <= 1e-6


@pytest.mark.drawn(4, of="terms in space")
@pytest.mark.parametrize("fed", [False, True])
def test_a_constraint_on_direction_and_middle_is_kept(fed: bool) -> None:
    """A vector of entries, on the way and at the goal, with a fixed base and with one that is fed."""

    def entries(q: Any) -> Any:
        return ccm_opt_vertcat(q.tip_direction[0], q.joint_positions[2, 4])

    solution = ccm_opt.solve(post(fed=fed), constraints=[Constraint("both", entries, lower=[-0.03, -0.002])])
    positions = solution.trajectory.positions
    arm = solution.problem.arm
    assert float(np.min(arm.link_rotations(positions)[:, -1, 0, 0])) >= -0.03 - 1e-6
    assert float(np.min(arm.joint_positions_at(positions)[:, 4, 2])) >= -0.002 - 1e-6


def ccm_opt_vertcat(*entries: Any) -> Any:
    """A column, as users make it."""
    import casadi as ca

    return ca.vertcat(*entries)


@pytest.mark.drawn(4, of="terms in space")
@pytest.mark.parametrize("fed", [False, True])
def test_a_constraint_of_an_interval_is_kept_there_alone(fed: bool) -> None:
    """From u = 0.4 to 0.7 the tip is higher than it has to be before and behind."""
    high = Constraint("high", lambda q: q.tip[2], lower=0.24, where=Interval(0.4, 0.7))
    solution = ccm_opt.solve(post(fed=fed), constraints=[high])
    assert residual(solution, "high") <= 1e-6
    height = tips(solution)[:, 2]
    assert float(np.max(height)) >= 0.24 - 1e-6
    assert abs(float(height[-1]) - 0.2) < 2e-3


@pytest.mark.drawn(4, of="terms in space")
@pytest.mark.parametrize(
    ("gap", "where"),
    [
        (lambda q: q.joint_positions[2, 6] - 0.19, Interval(0.41, 0.64)),
        (lambda q: q.tip[2] - 0.21, Interval(0.55, 0.82)),
    ],
)
def test_what_a_first_round_gains_is_kept_where_fewer_keyframes_break_an_interval(gap: Any, where: Interval) -> None:
    """Motions whose many keyframes cannot be thinned a second time are optimised all the same: 9.6 s and 7 s before."""
    solution = ccm_opt.solve(post(fed=True), constraints=[Constraint("lifted", gap, lower=0.0, where=where)])
    assert residual(solution, "lifted") <= 1e-6
    assert solution.trajectory.duration < 5.0


@pytest.mark.drawn(4, of="terms in space")
def test_a_constraint_that_moves_with_the_path_parameter_is_kept() -> None:
    """The tip rises with u between two planes that do."""
    rising = Constraint("rising", lambda q: q.tip[2] - 0.2 * q.path_parameter, lower=-0.02, upper=0.02)
    assert residual(ccm_opt.solve(post(), constraints=[rising]), "rising") <= 1e-6


@pytest.mark.drawn(4, of="terms in space")
def test_equations_hold_between_keyframes_too() -> None:
    """The tip stays level and in a plane that no spline of bends lies in by itself, to 1e-6 at every sample."""

    def level_in_plane(q: Any) -> Any:
        return ccm_opt_vertcat(q.tip_direction[2], q.tip[2] - q.tip[1] * 0.2 / 0.45)

    solution = ccm_opt.solve(post(), constraints=[Constraint("level", level_in_plane, lower=0.0, upper=0.0)])
    there = tips(solution)
    assert float(np.max(np.abs(there[:, 2] - there[:, 1] * 0.2 / 0.45))) <= 1e-6
    directions = solution.problem.arm.link_rotations(solution.trajectory.positions)[:, -1, 2, 0]
    assert float(np.max(np.abs(directions))) <= 1e-6


@pytest.mark.drawn(4, of="terms in space")
def test_a_cost_and_a_soft_constraint_shape_the_motion() -> None:
    """What is made dear becomes less, and cost_share says that the whole weight was used."""
    height = float(np.mean(tips(free_motion())[:, 2]))
    cost = Cost("height", lambda q: q.tip[2] ** 2, weight=200.0)
    solution = ccm_opt.solve(post(), costs=[cost])
    assert float(np.mean(tips(solution)[:, 2])) < height
    assert solution.metrics["cost_share"] == 1.0
    assert "cost_height" in solution.metrics
    wish = Constraint("wish", lambda q: q.tip[2], upper=0.0, soft=True, weight=400.0)
    softly = ccm_opt.solve(post(), constraints=[wish])
    assert float(np.mean(tips(softly)[:, 2])) < height
    assert softly.metrics["residual_wish"] == pytest.approx(0.2, abs=2e-3)


def test_what_contradicts_the_start_or_stands_in_the_way_is_named() -> None:
    """Bad input is a ``ProblemError``; a constraint that no motion keeps is named in the diagnosis, with a proof."""

    def far(q: Any) -> Any:
        # Of the last joint as well, so that nothing is proved before the search.
        return q.tip[0] + 1e-9 * q.joint_positions[0, 11]

    with pytest.raises(ProblemError, match=r"'right' contradicts the start: it is violated by 0\.1"):
        ccm_opt.solve(post(), constraints=[Constraint("right", lambda q: q.tip[1], upper=-0.1)])
    with pytest.raises(
        UnreachableGoal, match=r"'far' cannot hold at the goal: violated by 0\.1 with the tip at the goal"
    ) as caught:
        ccm_opt.solve(post(), constraints=[Constraint("far", lambda q: q.tip[0], lower=0.6)])
    assert caught.value.diagnosis.findings[0].kind == "constraint"
    with pytest.raises(UnreachableGoal, match=r"'back' cannot hold at the goal"):
        ccm_opt.solve(post(), constraints=[Constraint("back", lambda q: q.tip_direction[1], upper=0.5, where="goal")])
    hurried = replace(post(), planner=replace(post().planner, time_limit=2.0))
    with pytest.raises(NoPlanFound, match="'far'"):
        ccm_opt.solve(hurried, constraints=[Constraint("far", far, lower=0.6)], explain=False)


@pytest.mark.drawn(4, of="terms in space")
def test_equations_that_a_fed_arm_cannot_keep_are_named() -> None:
    """An equation that is not linear in bends and feed is met at keyframes alone, and so no plan."""
    level = Constraint("level", lambda q: q.tip_direction[2], lower=0.0, upper=0.0)
    with pytest.raises(NoPlanFound, match=r"keeps constraint 'level' between its keyframes(.|\n)*arm\.feed"):
        ccm_opt.solve(post(fed=True), constraints=[level], explain=False)


@pytest.mark.drawn(4, of="terms in space")
def test_constraints_hold_for_every_leg_of_goals_in_sequence() -> None:
    """One check a goal; what applies at the goal applies at the end of each."""
    stop = Stop(TipGoal(np.array([0.75, 0.3, 0.1])), post().tolerances, 0.2)
    two = replace(post(), stops=(stop,))
    terms = [
        Constraint("above", lambda q: q.tip[2], lower=-0.01),
        Constraint("left at the ends", lambda q: q.tip[1], lower=0.25, where="goal"),
    ]
    solution = ccm_opt.solve(two, constraints=terms, costs=[Cost("height", lambda q: q.tip[2] ** 2)])
    names = {check.name for check in solution.checks if check.name.startswith("constraint")}
    assert names == {f"constraint {term.name}, goal {k}" for term in terms for k in (1, 2)}
    assert float(np.min(tips(solution)[:, 2])) >= -0.01 - 1e-6


@pytest.mark.drawn(4, of="terms in space")
def test_a_speed_is_held_against_the_finished_motion() -> None:
    """A constraint on the tip's velocity refuses a motion that is faster, and passes one that is not."""
    fastest = Constraint("speed", lambda q: q.tip_velocity.T @ q.tip_velocity, upper=100.0)
    assert residual(ccm_opt.solve(post(), constraints=[fastest]), "speed") < 0.0
    slow = replace(fastest, upper=1e-4)
    with pytest.raises(MotionNotFound, match="speed"):
        ccm_opt.solve(post(), constraints=[slow], explain=False)


@pytest.mark.drawn(4, of="terms in space")
def test_the_command_line_takes_terms_in_space_and_checks_them_again(tmp_path: Path) -> None:
    """``solve --constraint --cost`` plans with them, ``check --constraint`` judges the written samples by them."""
    (tmp_path / "post.toml").write_text(POST)
    (tmp_path / "mine.py").write_text(
        "import ccm_opt\n"
        "@ccm_opt.constraint(lower=-0.01)\n"
        "def above(q):\n    return q.tip[2]\n"
        "@ccm_opt.constraint(upper=0.01)\n"
        "def below(q):\n    return q.tip[2]\n"
        "@ccm_opt.cost(weight=5.0)\n"
        "def height(q):\n    return q.tip[2] ** 2\n"
    )
    mine = str(tmp_path / "mine.py")
    asked = ["--constraint", f"{mine}:above", "--cost", f"{mine}:height", "--no-pictures", "--out", str(tmp_path)]
    solved = CliRunner().invoke(app, ["solve", str(tmp_path / "post.toml"), *asked])
    assert solved.exit_code == 0, solved.output
    assert "above" in solved.output
    folder = str(tmp_path / "post")
    again = CliRunner().invoke(app, ["check", folder, "--constraint", f"{mine}:above", "--json"])
    assert again.exit_code == 0, again.output
    assert "constraint above" in again.output
    refused = CliRunner().invoke(app, ["check", folder, "--constraint", f"{mine}:below"])
    assert refused.exit_code == 3, refused.output
