"""The best poses of the arm at a goal for the tip, from a pose there and from others: the goal-pose NLP."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.polyline import unit_vector
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.goal_poses import GoalPoses, bounded
from ccm_opt.ik.pose_settings import PoseSettings
from ccm_opt.ik.pose_solver import ArmPose
from ccm_opt.ik.pose_task import PoseTask
from ccm_opt.planning.ends import Ends
from ccm_opt.planning.goal import GoalPose
from ccm_opt.planning.joint_regions import joint_regions
from ccm_opt.planning.link_space import LinkSpace
from ccm_opt.planning.pose_draws import PoseDraws, PoseDrawSettings, landmarks, same_class
from ccm_opt.planning.pose_energy import EnergyWeights, PoseEnergy
from ccm_opt.problem import JointPose, Problem
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.contact_finder import ContactFinder

_CLOSE_ENOUGH = 0.03
"""A pose that costs no more than this share above what it would cost without walls is not improved upon (taste)."""
_UNKNOWN_COST = 20.0
"""Poses drawn cost less than this where no pose is known, in units of the objective (taste: more than having no room
costs)."""
_FURTHER_ROUNDS = 3
"""Most further solutions for one pose, the regions drawn anew about it (measured: as before)."""


@dataclass(frozen=True, eq=False)
class PoseCandidate:
    """A pose at the goal that the motion may end in.

    Attributes:
        pose: feasible.
        same_class: whether it has the whole turns, and passes the obstacles on the sides, of the pose that the search
            arrived at; then interpolation mostly reaches it. Another class has to be looked for by the search.
    """

    pose: ArmPose
    same_class: bool


@dataclass(frozen=True, eq=False)
class GoalPoseSearch(GoalPoses):
    """Finds good poses at the goal of one problem.

    Attributes:
        problem: with a goal for the tip.
        ends: its ends as planning takes them.
        near: link headings of the pose to stay near, shape (links,) [rad]: where the motion would end by itself, or
            where it starts.
        terms: the user's constraints and costs, or None.
        settings: of the NLP.
        draw_settings: of the poses that are drawn to start it from.
    """

    problem: Problem
    ends: Ends
    near: FloatArray
    terms: UserTerms | None = None
    settings: PoseSettings = field(default_factory=PoseSettings)
    draw_settings: PoseDrawSettings = field(default_factory=PoseDrawSettings)

    def candidates(self, start: FloatArray, deadline: Deadline | None = None) -> tuple[PoseCandidate, ...]:
        """Good poses of several classes, by the NLP from a pose at the goal and from cheap random poses there.

        First the NLP is solved from the pose given. Where that leaves more than a few per cent above what the pose
        would cost without walls, poses at the goal that cross nothing and promise to be cheaper are drawn over all
        classes and whole turns (see ``pose_draws``), and it is solved from the cheapest of them. What is found is
        solved again in regions drawn anew as long as that pays. In clutter the first candidate is within 5 % of the
        best of 50 random starts in nine of ten scenes.

        Args:
            start: link headings of the pose that the search arrived at, shape (links,) [rad].
            deadline: no further pose is begun after it.

        Returns:
            Feasible poses, at most one a class, the best first. Where the best is of another class than ``start``, the
            best of that class follows among the others, if it has one; an empty tuple when nothing is feasible.
        """
        own = self._feasible_pose(start)
        found = [] if own is None else [own]
        known = _UNKNOWN_COST if own is None else own.answer.cost
        draws = self._draws(start)
        cheapest = draws.cheapest_below(known)
        enough = (1.0 + _CLOSE_ENOUGH) * min((pose.cost for pose in cheapest), default=np.inf)
        if known > enough:
            found += self._from_drawn(draws.about(cheapest, known), known, enough, deadline)

        # The best is worth further rounds, and so is the one that can be reached most easily.
        classes = self._one_a_class(start, found)
        refined = []
        for place, candidate in enumerate(classes):
            worth = place == 0 or candidate.same_class
            refined.append(self._refined(candidate.pose, enough, deadline) if worth else candidate.pose)
        return self._one_a_class(start, refined)

    def _from_drawn(self, drawn: FloatArray, known: float, enough: float, deadline: Deadline | None) -> list[ArmPose]:
        """Feasible solutions from drawn poses, the cheapest first, of different classes where there are several.

        Args:
            drawn: link headings, shape (m, links) [rad].
            known: cost of the best pose known.
            enough: cost at which no better pose is looked for.
            deadline: of the search.
        """
        settings = self.draw_settings
        tried: list[FloatArray] = []
        found: list[ArmPose] = []
        for start in drawn:
            if self.gap(start) == -np.inf:
                continue  # no regions lie about links that cross something
            late = deadline is not None and deadline.passed()
            if len(tried) == settings.drawn_solutions or known <= enough or late:
                break
            if any(self._alike(start, other) for other in tried):
                continue
            tried.append(start)
            pose = self._feasible_pose(start)
            if pose is not None:
                found.append(pose)
                known = min(known, pose.answer.cost)
        return found

    def _one_a_class(self, start: FloatArray, poses: list[ArmPose]) -> tuple[PoseCandidate, ...]:
        """The best pose of every class, the best first."""
        kept: list[ArmPose] = []
        for pose in sorted(poses, key=lambda pose: pose.answer.cost):
            if not any(self._alike(pose.headings, other.headings) for other in kept):
                kept.append(pose)
        return tuple(PoseCandidate(pose, self._alike(pose.headings, start)) for pose in kept)

    def _alike(self, first: FloatArray, second: FloatArray) -> bool:
        return same_class(self.problem.arm, self._landmarks, first, second)

    @cached_property
    def _landmarks(self) -> FloatArray:
        return landmarks(self.problem.workspace)

    def _refined(self, pose: ArmPose, enough: float, deadline: Deadline | None) -> ArmPose:
        """A pose solved for again in regions drawn anew about it, as long as that pays."""
        best = pose
        for _ in range(_FURTHER_ROUNDS):
            if not bounded(best) or best.answer.cost <= enough or (deadline is not None and deadline.passed()):
                break
            again = self._feasible_pose(best.headings)
            if again is None or again.answer.cost >= best.answer.cost:
                break
            gain = 1.0 - again.answer.cost / best.answer.cost
            best = again
            if gain < self.settings.worthwhile:
                break
        return best

    def _feasible_pose(self, start: FloatArray) -> ArmPose | None:
        """The solution from a start, None where it is not feasible."""
        pose = self.solved(start)
        return pose if self.feasible(pose) else None

    def _draws(self, start: FloatArray) -> PoseDraws:
        """Of cheap poses at the goal."""
        space, _ = LinkSpace.through(self.problem.arm, start, clamped=self.ends.clamped)
        weights = self.settings.weights_of(("bending", "distance"), self.problem.planner.weights)
        energy = PoseEnergy.of(space, self.near, EnergyWeights(*weights.tolist()))
        goal = self._member_near(start)
        seed = self.problem.planner.seed
        walls = self.problem.workspace.wall_segments
        return PoseDraws(energy, walls, goal.position, goal.heading, self.near, start, seed, self.draw_settings)

    def _member_near(self, headings: FloatArray) -> GoalPose:
        """Of a goal that is a set the member at or nearest to a pose, shape (links,) [rad]; else the goal itself."""
        goal = self.ends.goal
        if not goal.is_set:
            return goal
        points = self.problem.arm.joint_positions(headings)
        return goal.nearest_member(points[-1], unit_vector(headings[-1]))

    def solved(self, start: FloatArray, seed: FloatArray | None = None) -> ArmPose:
        """One solution of the NLP, feasible or not, with regions about the pose that it starts from.

        Args:
            start: link headings of the pose to start from, shape (links,) [rad].
            seed: does not matter in the plane.
        """
        # Searches that follow one another begin from the same poses.
        key = start.tobytes()
        if key not in self._known:
            self._known[key] = super().solved(start, seed)
        return self._known[key]

    @cached_property
    def _known(self) -> dict[bytes, ArmPose]:
        """Solutions by the headings that they begin from."""
        return {}

    def strays(self, pose: ArmPose) -> bool:
        """Whether a link has strayed beyond what its region was drawn for, and met something there."""
        return self.gap(pose.headings) < pose.gap - self.allowed

    def at(self, pose: ArmPose) -> FloatArray:
        """The headings of its links."""
        return pose.headings

    def task(self, start: FloatArray, seed: FloatArray, drawn_with: PoseSettings) -> PoseTask:
        """What is asked from a start, its regions drawn about it."""
        del seed
        arm = self.problem.arm
        workspace = self.problem.workspace
        goal = self.ends.goal
        return PoseTask(
            arm,
            goal.position,
            goal.direction,
            near=arm.bends(self.near),
            start=arm.bends(start),
            regions=joint_regions(arm, workspace, start, drawn_with, workspace.wall_segments),
            wanted_gap=self.wanted_gap,
            clamped=self.ends.clamped,
            room=goal.room,
            **self.forces,
        )

    def gap(self, at: FloatArray) -> float:
        """Least gap of a pose beyond radius and clearance [m]; not told apart beyond the reach of regions."""
        points = self.problem.arm.joint_positions(at)
        if self._finder.crosses(points):
            return -np.inf
        return float(self._finder.find(points).gap.min(initial=self._finder.reach))

    def nearest(self, headings: FloatArray) -> str:
        """What of a pose is nearest to anything, and its gap beyond radius and clearance, in words."""
        points = self.problem.arm.joint_positions(headings)
        if self._finder.crosses(points):
            return "it crosses a wall, or itself"
        return self._finder.describe(self._finder.find(points))

    @cached_property
    def _finder(self) -> ContactFinder:
        """Of gaps beyond radius and clearance; flattens the walls once."""
        arm = self.problem.arm
        workspace = self.problem.workspace
        reach = self.settings.reach * arm.length
        return ContactFinder(arm, workspace.flat_walls, workspace.clearance, 0.0, reach)


def for_arm(problem: Problem, arm: Arm) -> Problem:
    """The problem for an arm in place of its own: the same one clamped, or one as long with fewer links."""
    if arm.links == problem.arm.links:
        return replace(problem, arm=arm)
    fewer = arm.links
    limits = problem.limits
    # Of the limits the pose needs torques alone: a joint bears what the joint at its place on the real arm bears.
    places = np.minimum(np.arange(3 * fewer) // 3 * problem.arm.links // fewer, problem.arm.links - 1)
    at = 3 * places + np.arange(3 * fewer) % 3
    resampled = replace(
        limits,
        velocity=limits.velocity[at],
        acceleration=limits.acceleration[at],
        torque=None if limits.torque is None else limits.torque[at],
        jerk=None if limits.jerk is None else limits.jerk[at],
    )
    return replace(problem, arm=arm, limits=resampled, start=JointPose(np.zeros(fewer)))
