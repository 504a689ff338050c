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
from scipy.interpolate import BSpline

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Diagnosis, MotionNotFound, NoPlanFound
from ccm_opt.core.length_words import short_length
from ccm_opt.core.progress import Stages
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.planning.ending import ended_by_nlp
from ccm_opt.planning.ends import refuse_ends
from ccm_opt.planning.lifting import lifted_motion, nominal_task
from ccm_opt.planning.motion import SpaceMotion
from ccm_opt.planning.passed_places import first_missed
from ccm_opt.planning.settings import SpaceCertificateSettings, SpaceMotionSettings
from ccm_opt.planning.smooth_path import PATH_SAMPLES, smooth_path
from ccm_opt.planning.space_optimise import optimise
from ccm_opt.planning.space_search import find_motion
from ccm_opt.planning.space_task import SpaceTask, coarse_problem, space_task
from ccm_opt.planning.tracking import tracked
from ccm_opt.problem import JointPose, Problem
from ccm_opt.problem.solution import JointPath, SpaceGoalPoseRecord
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
    poses = [problem.start, *([problem.goal] if isinstance(problem.goal, JointPose) else [])]
    bent = np.any(np.abs([pose.configuration(arm)[: 2 * count] for pose in poses]) >= STRAIGHT)
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


_Planned: TypeAlias = tuple[tuple[SpaceMotion, ...], SpaceGoalPoseRecord | None]
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


def joint_path(task: SpaceTask, *motions: SpaceMotion, legs: bool = False) -> JointPath:
    """The smooth, certified path through joint space along the first of some motions that has one.

    Args:
        task: what was asked.
        motions: certified.
        legs: whether the arm will move on straight legs between the keyframes, and not along the path.

    Raises:
        MotionNotFound: no smooth path near the motion can be certified.
    """
    missed = None
    for motion in motions:
        path = smooth_path(motion, task)
        missed = None if path is None else _missed_on(task, path.spline)
        if path is not None and missed is None:
            keyframes = motion.configurations
            if task.arm.base_axes and not legs:
                # Drawn in the unknowns, the path of a fed arm may pass configurations of the motion by.
                keyframes = np.asarray(path.spline(np.linspace(0.0, 1.0, len(keyframes))))
            return JointPath(path.spline, keyframes, (), motion.candidate, spare=path.spare)
    if missed is not None:
        raise MotionNotFound(missed)
    if task.user is None or not task.user.terms.hard:
        raise MotionNotFound(Diagnosis("the motion leaves no room for a smooth path", "motion"))
    names = " and ".join(f"'{name}'" for name in task.user.names)
    reason = f"a motion was found, but no smooth path near it that keeps constraint {names} between its keyframes"
    advice = ["give the constraint some width between its bounds, or make it soft"]
    if task.user.has_equations and task.arm.base_axes:
        advice.append("leave arm.feed out: equations that are not linear hold for arms with a fixed base")
    raise MotionNotFound(Diagnosis(reason, "constraints", tuple(advice)))


def _missed_on(task: SpaceTask, spline: BSpline) -> Diagnosis | None:
    """Which place the tip does not pass on a path, in words; None where it passes all."""
    if not task.via:
        return None
    spans = len(spline.t) - 2 * spline.k - 1
    u = np.linspace(0.0, 1.0, spans * PATH_SAMPLES + 1)
    tips = task.arm.joint_positions_at(np.asarray(spline(u)))[:, -1]
    missed = first_missed(tips, np.stack(task.via), task.via_reach)
    if missed is None:
        return None
    number, away = missed
    reason = (
        f"the tip comes within {short_length(away)} of goal.via {number + 1}, "
        f"{short_length(away - task.via_reach)} too far off to pass it"
    )
    return Diagnosis(reason, "motion", ("move the place to where an arm as long and stiff as this can pass it",))
