"""The planner in space: search, optimisation, smooth path.

The default mount is as long as the arm's radius. Where such an arm stands square on a floor, the disc at the end of the
mount just touches it, and any turn of the base would press its rim in. The first joints are left straight then; the arm
bends beyond them.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import NoPlanFound
from ccm_opt.core.progress import Stages
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.planning.ending import ended_by_nlp
from ccm_opt.planning.ends import refuse_ends
from ccm_opt.planning.lifting import lifted_motion, nominal_task
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.settings import SpaceCertificateSettings, SpaceMotionSettings
from ccm_opt.planning.smooth_path import joint_path
from ccm_opt.planning.space_optimise import optimise
from ccm_opt.planning.space_search import find_motion
from ccm_opt.planning.space_task import SpaceTask, coarse_problem, space_task
from ccm_opt.planning.tracking import tracked
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import GoalPoseRecord, JointPath
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS
from ccm_opt.scene.distances.surface_tree import SurfaceTree

STRAIGHT = 1e-9
"""Bends up to which joints count as straight [rad]."""
_SQUARE = 1e-6
"""One less the cosine of the angle to a wall's normal up to which the end of the mount stands square on it."""


def with_clamped_base(problem: Problem, tree: SurfaceTree) -> Problem:
    """The problem for an arm whose first joints stay straight and belong to the mount, where it stands flush on a wall.

    Args:
        problem: with one goal.
        tree: of its surfaces.
    """
    count = clamped_joints(problem, tree)
    arm = problem.arm
    clamped = replace(arm, mount_length=count * arm.link_length, clamped_joints=count)
    return replace(problem, arm=clamped) if count else problem


def clamped_joints(problem: Problem, tree: SurfaceTree) -> int:
    """How many joints from the base a wall at the end of the mount holds straight; 0 where there is none."""
    arm = problem.arm
    first, share = arm.mount_end
    count = max(1, int(np.ceil(first + share - STRAIGHT)))
    ends = [q for pose in (problem.start, problem.goal) if (q := pose.whole(arm)) is not None]
    bent = np.any(np.abs(np.stack(ends)[:, : 2 * count]) >= STRAIGHT)
    if arm.base_axes or share >= 1.0 - STRAIGHT or count >= arm.links or bent:
        return 0
    points = arm.joint_positions_at(problem.start.configuration(arm))
    along = points[first + 1] - points[first]
    end = points[first] + share * along
    # What a motion has to spare beyond contact is not there: no certificate would let the base turn.
    spare = SpaceCertificateSettings().spare * arm.length / NOMINAL_LINKS
    reach = arm.radius + problem.workspace.clearance + spare
    near = tree.nearest(np.stack((end, end))[None], reach)
    if near.owner[0] < 0 or near.gap[0] >= reach:
        return 0
    # Held only by what lies square behind it.
    away = end - near.point[0]
    square = away @ along >= (1.0 - _SQUARE) * np.linalg.norm(along) * np.linalg.norm(away)
    return count if square else 0


def told_of_clamped_base(failure: NoPlanFound, problem: Problem) -> NoPlanFound:
    """The failure with what would let the first joint bend among its advice, where the base is clamped."""
    if not problem.arm.clamped_joints:
        return failure
    found = failure.diagnosis
    own = "raise arm.mount_length: the arm stands flush on a wall, so that the base cannot turn"
    return type(failure)(replace(found, advice=(own, *found.advice)))


_Planned: TypeAlias = tuple[tuple[SpaceMotion, ...], GoalPoseRecord | None]
PLANNING_SHARE = 0.8
"""Of the time limit that planning may take; the rest is for timing, simulation and reasons."""


@dataclass(frozen=True)
class SpacePlanner:
    """Plans motions of arms in space.

    Attributes:
        stages: names and times the stages.
        settings: numbers of the search.
        terms: the user's constraints and costs; None where there are none.
        refuse: raises where it is proved that a problem has no plan; asked where no way of the tip leads to the goal.
    """

    stages: Stages = field(default_factory=Stages)
    settings: SpaceMotionSettings = field(default_factory=SpaceMotionSettings)
    terms: UserTerms | None = None
    refuse: Callable[[Problem], None] = field(default=lambda _: None)

    def plan(self, problem: Problem) -> JointPath:
        """Plan a certified motion to the problem's goal.

        Raises:
            ProblemError: the start breaks a limit.
            NoPlanFound: with the reason and what would help.
        """
        deadline = Deadline.after(PLANNING_SHARE * problem.planner.time_limit)
        with self.stages("free space"):
            tree = SurfaceTree.of(problem.workspace.soup)
            problem = with_clamped_base(problem, tree)
            task = space_task(problem, tree, deadline, self.settings, self.terms)
            refuse_ends(problem, task)
            task = replace(task, refuse=partial(self.refuse, problem))
        try:
            motions, end = self._lifted(problem, task) or self._planned(problem, task)
        except NoPlanFound as none:
            raise told_of_clamped_base(none, problem) from none
        with self.stages("smooth path"):
            path = joint_path(task, *motions, legs=problem.planner.retiming == "paul")
        return replace(path, goal_pose=end)

    def _planned(self, problem: Problem, task: SpaceTask) -> _Planned:
        """The optimised motion, and the one that was found, whose path may have room where the shorter one has none.

        With them comes what the NLP said about where they end, or None.
        """
        with self.stages("motion"):
            found = find_motion(task)
        with self.stages("configuration"):
            ending = ended_by_nlp(problem, task, found)
            motion = tracked(task, ending.motion)
        with self.stages("optimisation"):
            motions = (optimise(motion, ending.task), found if motion.u is None else motion)
        return motions, ending.record

    def _lifted(self, problem: Problem, task: SpaceTask) -> _Planned | None:
        """The motion of an arm of many links, planned for few; None where the arm has few, or that does not pass."""
        few = nominal_task(task)
        if few is None:
            return None
        try:
            motions, end = self._planned(coarse_problem(problem, few), replace(few, refuse=lambda: None))
        except NoPlanFound:
            return None
        with self.stages("lifting"):
            lifted = lifted_motion(task, motions[0])
        return None if lifted is None else ((lifted,), end)
