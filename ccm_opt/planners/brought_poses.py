"""Poses of the arm at a goal for the tip that no route leads to: random poses brought onto it by Newton's method."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.arm import Arm
from ccm_opt.motion.connect.goal_draws import GoalDraws
from ccm_opt.motion.connect.sampled_check import SampledCheck
from ccm_opt.motion.connect.target_draws import TargetDraws
from ccm_opt.motion.ends import Ends
from ccm_opt.motion.link_space import KNOTS, NOMINAL_LINKS, LinkSpace
from ccm_opt.planners.curve_settings import DEFAULT_CURVE_PLANNER, CurvePlannerSettings
from ccm_opt.planners.goal_members import GoalMember
from ccm_opt.problem import Problem


def brought_poses(
    problem: Problem,
    arm: Arm,
    ends: Ends,
    members: tuple[GoalMember, ...],
    settings: CurvePlannerSettings = DEFAULT_CURVE_PLANNER,
) -> Iterator[FloatArray]:
    """Link headings of random poses with the tip on members of the goal that touch nothing for all that samples show.

    Args:
        problem: with the walls, and a seed.
        arm: that is to get there.
        ends: with the goal.
        members: of the goal, that have a route.
        settings: numbers.

    Yields:
        Poses of shape (links,) [rad]; of members in turn.
    """
    connect = settings.motion.connect
    rng = np.random.default_rng(problem.planner.seed)
    space, _ = LinkSpace.through(arm, ends.start, NOMINAL_LINKS, clamped=ends.clamped)
    share = settings.motion.step.limit_share
    shapes = TargetDraws.within(space, [ends.start], KNOTS + 1, share, connect)
    check = SampledCheck.of(arm, problem.workspace, connect.sampling)
    draws = [
        GoalDraws(shapes, replace(ends.goal, position=each.position, heading=each.heading, room=(0.0, 0.0)), check,
                  connect.goals).poses(rng)
        for each in members
    ]  # fmt: skip
    for _ in range(settings.brought_rounds):
        for drawn in draws:
            yield from next(drawn)
