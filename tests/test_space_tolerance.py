"""Errors that a plan in space survives: certified ones touch nothing, and larger ones of the worst kind soon do."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.core.arrays import FloatArray
from ccm_opt.io.folder import write_solution
from ccm_opt.problem.solution import Solution, ToleratedError
from ccm_opt.verification.tolerance.error_model import moved_by_joint_errors
from ccm_opt.verification.tolerance.tolerated_errors import tolerated_errors
from tests.arms import limits_at

from .command_runs import CommandLine, brightness
from .space_arms import FEED_OF_TESTS, turned_arm
from .space_folders import solved as fed_plan
from .surface_scenes import slow_gaps

SEEDS = st.integers(0, 2**32 - 1)


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> CommandLine:
    """The command line."""
    return CommandLine(capsys)


@cache
def plan() -> Solution:
    """A motion of an arm with a fixed base between two balls."""
    problem = ccm_opt.make_problem(
        "between",
        arm={"links": 10, "link_length": 0.05, "radius": 0.01, "base": {"position": (0, 0, 0)}, "joint_limit_deg": 60},
        obstacles={
            "near": {"sphere": {"center": (0.3, 0.2, -0.02), "radius": 0.05}},
            "far": {"sphere": {"center": (0.1, 0.25, 0.12), "radius": 0.05}},
        },
        limits={"velocity": 1.0, "acceleration": 4.0},
        goal={"position": (0.2, 0.35, 0.1)},
    )
    return ccm_opt.solve(problem)


@cache
def tolerated() -> dict[str, ToleratedError]:
    """What it survives, by what is wrong."""
    return {error.name: error for error in tolerated_errors(plan().problem, plan().trajectory)}


def gap_of(points: FloatArray) -> float:
    """Least gap of poses, shape (T, links + 1, 3), from everything, by another method than the verifier's."""
    problem = plan().problem
    arm = problem.arm
    first, share = arm.mount_end
    segments = np.stack((points[:, :-1], points[:, 1:]), axis=2)[:, first:]
    segments[:, 0, 0] += share * (segments[:, 0, 1] - segments[:, 0, 0])
    walls = slow_gaps(segments.reshape(-1, 2, 3), problem.workspace.triangle_soup, 0.2)
    return float(walls.min()) - arm.radius - problem.workspace.clearance


def near_the_limit(error: ToleratedError) -> FloatArray:
    """Configurations of the motion about the moment that limits an error, shape (T, c)."""
    trajectory = plan().trajectory
    assert error.time is not None
    number = int(np.searchsorted(trajectory.time, error.time))
    return trajectory.positions[max(number - 3, 0) : number + 3]


@pytest.mark.drawn(20, of="dear tests")
@given(SEEDS)
@settings(max_examples=10, deadline=None)
def test_no_error_of_the_joints_that_is_certified_touches(seed: int) -> None:
    """Whatever the joints are off by, each by no more than is survived, and each moment another way."""
    error = tolerated()["joints"]
    random = np.random.default_rng(seed)
    q = near_the_limit(error)
    off = random.choice([-1.0, 1.0], q.shape) if seed % 2 else random.uniform(-1.0, 1.0, q.shape)
    assert gap_of(plan().problem.arm.joint_positions_at(q + error.size * off)) >= 0.0


def test_the_worst_errors_use_up_most_of_the_room_and_soon_touch() -> None:
    """The bound is no more than a few times too careful: with the signs that it names the arm touches."""
    error = tolerated()["joints"]
    assert 0.0 < error.size < 0.2
    q = near_the_limit(error)
    worst = error.size * np.array(error.worst)
    touches = plan().problem.arm.joint_positions_at
    assert gap_of(touches(q + worst)) < 0.9 * gap_of(touches(q))
    assert min(gap_of(touches(q + k * worst)) for k in np.linspace(1.0, 4.0, 13)) < 0.0


def test_the_other_errors_are_what_moves_the_arm_so_far() -> None:
    """The base's place may be off by the least gap, its direction and the links by less than touches."""
    errors = tolerated()
    assert errors["walls"].size == pytest.approx(plan().metrics["least_wall_clearance_m"], rel=0.02)
    assert errors["base position"].size == errors["walls"].size
    arm = plan().problem.arm
    heading = errors["base heading"]
    points = arm.joint_positions_at(near_the_limit(heading))
    for axis in np.eye(3):
        for sign in (1.0, -1.0):
            assert gap_of(turned(points, arm.base, sign * heading.size * axis)) >= 0.0
    lengths = errors["link lengths"]
    points = arm.joint_positions_at(near_the_limit(lengths))
    for sign in (1.0, -1.0):
        grown = arm.base + (1.0 + sign * lengths.size / arm.link_length) * (points - arm.base)
        assert gap_of(grown) >= 0.0


def turned(points: FloatArray, about: FloatArray, turn: FloatArray) -> FloatArray:
    """Points turned about a place by a rotation vector, by Rodrigues' formula."""
    angle = float(np.linalg.norm(turn))
    axis = turn / angle
    arms = points - about
    across = np.cross(axis, arms)
    return np.asarray(about + arms + np.sin(angle) * across + (1.0 - np.cos(angle)) * np.cross(axis, across))


@given(SEEDS, st.booleans())
@settings(max_examples=40, deadline=None)
def test_errors_move_links_by_no_more_than_their_levers(seed: int, fed: bool) -> None:
    """Of arms anyhow bent and turned, on a feed axis too; joints in the guide tube have no error."""
    random = np.random.default_rng(seed)
    arm = turned_arm(random, 6, feed=FEED_OF_TESTS if fed else None)
    feed = float(random.uniform(*arm.base_range))
    lower, upper = limits_at(arm, feed)
    q = 0.5 * random.uniform(lower, upper)
    q[2 * arm.links :] = feed
    size = float(10.0 ** random.uniform(-4, 0))
    off = size * random.uniform(-1.0, 1.0, len(q))
    off[: 2 * arm.links][(lower == 0.0)[: 2 * arm.links]] = 0.0
    off[2 * arm.links :] *= arm.link_length
    points = arm.joint_positions_at(q)
    away = np.linalg.norm(arm.joint_positions_at(q + off) - points, axis=1)
    moved = moved_by_joint_errors(arm, points, size)
    assert np.all(np.maximum(away[:-1], away[1:]) <= moved + 1e-12)


@pytest.mark.drawn(20, of="dear tests")
def test_the_command_writes_what_a_fed_plan_survives(tmp_path: Path, run: CommandLine) -> None:
    """The table, the record with places in space, and a picture; a motion that touches itself sooner says so."""
    folder = write_solution(fed_plan(), tmp_path)
    done = run("tolerance", folder, "--no-simulation")
    assert done.code == 0
    assert "tolerated errors" in done.out
    record = json.loads((folder / "tolerance.json").read_text())
    names = [error["name"] for error in record["tolerance"]]
    assert names == ["joints", "link lengths", "base heading", "base position", "walls"]
    joints = record["tolerance"][0]
    assert joints["size"] > 0.0
    assert len(joints["worst"]) == 2 * fed_plan().problem.arm.links
    assert len(joints["place"]) == 3
    assert brightness(folder / "tolerance.png") > 0.03
