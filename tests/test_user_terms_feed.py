"""User constraints and costs with a feed axis: planned for, and kept by motions that would break them without."""

import numpy as np
import pytest

from ccm_opt.driver.pipeline import solve
from ccm_opt.ik.compiled_terms import compile_terms
from ccm_opt.ik.terms import Constraint, Cost
from ccm_opt.planning.link_space import FedSpace
from ccm_opt.problem import Problem, TipGoal

from .feed_scenes import fed_arm, make_problem, make_room

GOAL = TipGoal(np.array([0.55, 0.25]), heading=0.0)


def problem() -> Problem:
    """Into an empty room, to a place above the hole."""
    return make_problem(fed_arm(), make_room(), GOAL)


@pytest.mark.drawn(20, of="dear tests")
def test_a_constraint_that_the_leader_would_break_is_kept() -> None:
    """No joint bends farther than the constraint has it, though the joints could, and would without it."""
    bend = Constraint("gentle", lambda q: q.joint_angles, lower=-0.2, upper=0.2)
    free = np.abs(solve(problem()).trajectory.positions[:, :-1]).max()
    assert free > 0.21
    held = solve(problem(), constraints=[bend])
    assert np.abs(held.trajectory.positions[:, :-1]).max() <= 0.2 + 1e-6
    assert held.metrics["tip_error_m"] <= problem().tolerances.position


@pytest.mark.drawn(20, of="dear tests")
def test_a_constraint_at_the_goal_decides_how_the_arm_ends() -> None:
    """The middle of the arm ends lower than it would."""
    j = 12
    free = float(solve(problem()).joint_positions[-1, j, 1])
    low = Constraint("low middle", lambda q: q.joint_positions[1, j], upper=free - 0.02, where="goal")
    assert float(solve(problem(), constraints=[low]).joint_positions[-1, j, 1]) <= free - 0.02 + 1e-6


def test_an_equation_holds_with_a_feed() -> None:
    """The last joint stays straight all the way, while the guide tube lets the others out."""
    straight = Constraint("stiff end", lambda q: q.joint_angles[-1], lower=0.0, upper=0.0)
    solution = solve(problem(), constraints=[straight])
    assert np.abs(solution.trajectory.positions[:, fed_arm().links - 1]).max() < 1e-5


@pytest.mark.parametrize("feed", [0.1, 0.7])
def test_slopes_by_poses_are_those_of_differences(feed: float) -> None:
    """Rows and costs know the base's way as a coordinate of the configuration."""
    arm = fed_arm()
    rng = np.random.default_rng(3)
    pose = np.append(rng.normal(0.0, 0.2, arm.links), feed)
    terms = compile_terms(
        arm,
        [Constraint("tip", lambda q: q.tip[0] * q.base_feed, upper=9.0)],
        [Cost("away", lambda q: q.tip[1] ** 2 + q.base_feed**3)],
    )
    step = 1e-6 * np.eye(len(pose))
    slopes = terms.motion_rows.at(pose, 0.5).gap_slopes[0]
    differences = [
        (terms.motion_rows.at(pose + d, 0.5).gaps[0] - terms.motion_rows.at(pose - d, 0.5).gaps[0]) / 2e-6 for d in step
    ]
    assert np.allclose(slopes, differences, atol=1e-7)
    cost = terms.costs[0]
    gradient = cost.second_order(pose, 0.5)[0]
    along = [(cost.values((pose + d)[None], np.zeros(1)) - cost.values((pose - d)[None], np.zeros(1)))[0] for d in step]
    assert np.allclose(gradient, np.array(along) / 2e-6, atol=1e-7)


def test_the_space_of_a_fed_arm_moves_as_its_points_do() -> None:
    """Jacobians by bends and feed agree with differences of the points, and coordinates are found again."""
    arm = fed_arm(base_heading=0.4)
    space = FedSpace.of_arm(arm, 0.3)
    v = np.append(np.random.default_rng(5).normal(0.0, 0.3, arm.links), 4.2)
    q = space.configurations(v)
    assert np.allclose(space.fitted(q), v)
    jacobians = space.jacobians(arm.headings(q))
    for k, d in enumerate(1e-6 * np.eye(len(v))):
        change = np.diff(arm.joint_positions_at(space.configurations(np.stack((v - d, v + d)))), axis=0)[0] / 2e-6
        assert np.allclose(jacobians[..., k], change, atol=1e-7)
