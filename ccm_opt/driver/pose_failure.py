"""Outcomes of a search for a pose at a goal from several initial poses, and reasons why no pose was found."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import ConfigurationNotFound, Diagnosis, NoPlanFound, UnreachableGoal
from ccm_opt.core.length_words import short_length
from ccm_opt.diagnosis.checks import failed
from ccm_opt.diagnosis.ranking import rank_findings
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.ik.goal_poses import GoalPoses
from ccm_opt.ik.pose_solver import ArmPose
from ccm_opt.ik.terms import TERM_TOLERANCE
from ccm_opt.planning.ends import GapsAtSamples, resolve_ends
from ccm_opt.planning.goal_pose import poses_at_goal
from ccm_opt.planning.own_units import OwnUnits
from ccm_opt.planning.pose_beginnings import PoseBeginning, along_routes
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import PoseOutcome
from ccm_opt.robot.arm import Arm
from ccm_opt.scene.bad_pose import clearance_advice

_ELASTIC_WEIGHTS = (10.0, 1e2, 1e3, 1e5)
"""Successive penalty weights in the search for the pose of minimum violation [1/rad²]. Each multiplies half the
squared violation of a user's constraint, converted to radians by the constraint's derivative with respect to the link
angles. Measured: the solver fails if it starts with the last weight, with which violations are exact to a
thousandth."""
_ELASTIC_SHARE = 0.02
"""Fraction of a pose's worst violation, all converted to radians, below which other violations are ignored.
Heuristic."""

_NUMBERED = re.compile(r"^(link|joint) (\d+)")
"""Pattern of the names of rows of the nonlinear program that belong to a link or joint."""


@dataclass(frozen=True, eq=False)
class PoseTry:
    """Poses found from one initial pose by solving the nonlinear program (NLP) for poses at the goal.

    Attributes:
        beginning: the initial pose.
        goal_poses: the NLP.
        poses: successive solutions of the NLP, each started from the one before; empty without an initial pose.
    """

    beginning: PoseBeginning
    goal_poses: GoalPoses
    poses: tuple[ArmPose, ...] = ()

    @property
    def best(self) -> int | None:
        """Index of the feasible pose of minimum cost; None if no pose is feasible."""
        feasible = [k for k, pose in enumerate(self.poses) if self.goal_poses.feasible(pose)]
        return min(feasible, key=lambda k: self.poses[k].answer.cost, default=None)

    @property
    def cost(self) -> float:
        """Cost of the best feasible pose; infinite if no pose is feasible."""
        return np.inf if self.best is None else self.poses[self.best].answer.cost

    def begun(self, number: int) -> FloatArray:
        """Return the configuration from which the solution with index ``number`` was started, shape (c,) [rad, m]."""
        return np.asarray(self.poses[number - 1].q if number else self.beginning.q)

    @property
    def outcome(self) -> PoseOutcome:
        """Outcome of the search from this initial pose, for the user."""
        if self.best is None:
            return PoseOutcome(self.beginning.name, reason=self.reason)
        pose = self.poses[self.best]
        return PoseOutcome(self.beginning.name, pose.answer.cost, pose.gap)

    @property
    def reason(self) -> str:
        """Violations or contact of the pose nearest to feasibility, in words."""
        if not self.poses:
            return "" if self.beginning.missing is None else self.beginning.missing.reason
        pose = min(self.poses, key=lambda pose: pose.answer.violation)
        if pose.answer.violation > self.goal_poses.settings.feasible:
            worst = list(pose.answer.broken.items())[:3]
            return f"it violates {', '.join(_row_words(name, by, self.goal_poses) for name, by in worst)}"
        return f"it is in contact: {GapsAtSamples.nearest_words(self.goal_poses.problem, pose.q)}"


def improved_poses(goal_poses: GoalPoses, beginning: PoseBeginning, deadline: Deadline | None = None) -> PoseTry:
    """Return the poses at the goal found from one initial pose.

    Args:
        goal_poses: the nonlinear program for poses at the goal.
        beginning: the initial pose.
        deadline: time limit; None for no limit.
    """
    return PoseTry(beginning, goal_poses, () if beginning.q is None else goal_poses.improved(beginning.q, deadline))


def no_pose(goal_poses: GoalPoses, tries: Sequence[PoseTry]) -> ConfigurationNotFound:
    """Return an error that states why no pose at the goal was found.

    Args:
        goal_poses: the nonlinear program for poses at the goal.
        tries: poses found from all initial poses, none of them feasible.
    """
    problem = goal_poses.problem
    findings = rank_findings(failed(problem))
    missed = {} if findings else least_violations(tries)
    evidence: dict[str, object] = {
        "tried": [f"{each.beginning.name}: {each.reason}" for each in tries],
        "missed_constraints": missed,
    }
    if findings:
        return ConfigurationNotFound(Diagnosis(findings[0].reason, "configuration", (), evidence, findings))
    if missed:
        softer = ("change the bounds or the goal", "make the constraint soft")
        return ConfigurationNotFound(Diagnosis(describe_violations(missed), "configuration", softer, evidence))
    nearest = min((each for each in tries if each.poses), key=_violation, default=None)
    missing = next((each.beginning.missing for each in tries if each.beginning.missing is not None), None)
    reason = f"no goal pose was found from {len(tries)} starting poses"
    advice = _advice(problem)
    if nearest is not None:
        reason += f"; the closest ({nearest.beginning.name}): {nearest.reason}"
    elif missing is not None:
        reason += f"; {tries[0].beginning.name}: {missing.reason}"
        evidence |= missing.evidence
        advice = tuple(dict.fromkeys((*missing.advice, *advice)))
    return ConfigurationNotFound(Diagnosis(reason, "configuration", advice, evidence))


def _advice(problem: Problem) -> tuple[str, ...]:
    """Return advice to the user that may help to find a pose at the goal."""
    more = "raise planner.routes" if problem.dimension == 2 else "raise planner.time_limit"
    room = clearance_advice(problem.arm.radius, problem.workspace.clearance, key=problem.arm.key("radius"))
    free = () if getattr(problem.goal, "direction", None) is None else ("leave the goal's direction free",)
    return (more, *room, f"raise {problem.arm.key('joint_limit_deg')}", *free)


def with_constraint_first(
    failure: NoPlanFound, problem: Problem, terms: UserTerms | None, settings: Settings = DEFAULT_SETTINGS
) -> NoPlanFound:
    """Return a planning error whose reason first names the user's constraints that no pose found at the goal satisfies.

    The error is returned unchanged in all other cases, for example if a pose satisfies all constraints.

    Args:
        failure: the error.
        problem: the problem as posed.
        terms: the user's constraints and costs.
        settings: settings of all stages of planning.
    """
    constrained = terms is not None and bool(terms.hard_at_goal) and not problem.arm.base_axes and not problem.stops
    if not constrained or isinstance(failure, UnreachableGoal) or problem.goal.whole(problem.arm) is not None:
        return failure
    scaled = OwnUnits(problem.arm.length).scaled(problem)
    ends = resolve_ends(scaled)
    goal_poses = poses_at_goal(scaled, ends, ends.start, terms, settings.curve.goal_pose)
    tries = [improved_poses(goal_poses, each) for each in along_routes(scaled, ends)]
    missed = {} if any(each.best is not None for each in tries) else least_violations(tries)
    if not missed:
        return failure
    old = failure.diagnosis
    evidence = {**old.evidence, "missed_constraints": missed}
    advice = ("change the bounds of the constraint, or the goal", *old.advice)
    reason = f"{describe_violations(missed)}; {old.reason}"
    return type(failure)(replace(old, reason=reason, evidence=evidence, advice=advice))


def describe_violations(missed: dict[str, float]) -> str:
    """Return a sentence about constraints violated at the goal, without proof, given the violations by name."""
    first = "; ".join(f"constraint '{name}', which the closest violates by {miss:.4g}" for name, miss in missed.items())
    return f"no goal pose was found that satisfies {first} (not proved: another pose may)"


def least_violations(tries: Sequence[PoseTry]) -> dict[str, float]:
    """Return the violations of the user's hard constraints in the pose of minimum violation, by name, largest first.

    The nonlinear program is solved again from all initial poses with these constraints made soft. The pose that
    violates the fewest of them is chosen. The result is empty if no pose is found even so, because other constraints,
    such as clearance, are infeasible.
    """
    found = [misses for each in tries if each.poses and (misses := _goal_violations(each)) is not None]
    # The pose that violates the fewest constraints names those that cannot be satisfied.
    best = min(found, key=lambda misses: (len(misses), sum(misses.values())), default={})
    return dict(sorted(best.items(), key=lambda item: -item[1]))


def _goal_violations(each: PoseTry) -> dict[str, float] | None:
    """Return the violations of hard constraints in the pose found from one initial pose with these made soft.

    The result is None if no pose is found, or the user gave no hard constraints for the goal.
    """
    terms = each.goal_poses.terms
    if terms is None or not terms.hard_at_goal:
        return None
    q = each.begun(0)
    found = None
    for weight in _ELASTIC_WEIGHTS:
        softened = terms.softened(q, weight)
        pose = replace(each.goal_poses, terms=softened).best(q)
        if pose is None:
            break
        q = pose.q
        found = _worst_violations(terms, softened, q)
    return found


def _worst_violations(terms: UserTerms, softened: UserTerms, q: FloatArray) -> dict[str, float]:
    """Return the violations of hard constraints in a pose, by name.

    Violations below the fraction ``_ELASTIC_SHARE`` of the worst are left out.

    Args:
        terms: the user's constraints and costs.
        softened: the constraints as soft ones, whose weights convert violations of different units to radians.
        q: configuration with c coordinates, shape (c,) [rad, m].
    """
    misses = terms.residuals_at_goal(q)
    weights = {item.constraint.name: item.constraint.weight for item in softened.constraints}
    missed = {
        item.constraint.name: misses[item.constraint.name]
        for item in terms.hard_at_goal
        if not misses[item.constraint.name] <= TERM_TOLERANCE
    }
    # Units differ, so violations are compared as turns of the whole arm. Penalties leave small violations of
    # constraints that could hold.
    turns = {name: np.sqrt(weights[name]) * miss for name, miss in missed.items()}
    least = _ELASTIC_SHARE * max(turns.values(), default=0.0)
    return {name: miss for name, miss in missed.items() if not turns[name] < least}


def _violation(each: PoseTry) -> float:
    return min((pose.answer.violation for pose in each.poses), default=np.inf)


def own_row(name: str, arm: Arm) -> str:
    """Return the name of a row of the nonlinear program with its link or joint as messages of the arm call it."""

    def called(found: re.Match[str]) -> str:
        return (arm.link_name if found[1] == "link" else arm.joint_name)(int(found[2]) - 1)

    return _NUMBERED.sub(called, name)


def _row_words(name: str, violation: float, goal_poses: GoalPoses) -> str:
    """Return a violated constraint of the nonlinear program in words, given its name and the amount of violation."""
    arm = goal_poses.problem.arm
    what, _, rest = own_row(name, arm).partition(": ")
    if what == "user":
        return f"constraint '{rest}' by {violation:.4g}"
    if "bend" in rest:
        return f"the limit of {what} by {np.rad2deg(violation):.3g}°"
    if "torque" in rest:
        return f"the torque of {what} by {100.0 * violation:.3g} %"
    if "region" in rest:
        return f"the free region of {what} by {short_length(arm.length * violation)}"
    return f"{name} ({violation:.2g})"
