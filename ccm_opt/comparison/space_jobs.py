"""The shipped problems in space with starts and goals a little elsewhere, and arms of any number of links."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from ccm_opt.comparison.space_arms import with_links
from ccm_opt.errors import ProblemError
from ccm_opt.files.problem_file import load_problem
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.drive_limits import Limits
from ccm_opt.jointed.space_arm import SpaceArm
from ccm_opt.jointed.space_kinematics import joint_positions
from ccm_opt.space.distances.surface_tree import SurfaceTree
from ccm_opt.space.problem import SpaceJointPose, SpaceProblem, SpaceTipGoal


@dataclass(frozen=True)
class Disturbance:
    """How far the ends of a shipped problem are moved; all of it is taste, some of the room that there is.

    Attributes:
        base: shift of the base across its direction, at most [m].
        fed: how far the arm is fed in at the start, at most [m].
        goal: shift of the goal, at most [m].
        turn: of the goal's direction, at most [rad].
        room: gap that the straight arm at the start and the last link at the goal keep at least [m].
    """

    base: float
    fed: float
    goal: float
    turn: float
    room: float


JOBS: Mapping[str, Disturbance] = {
    "elbow": Disturbance(base=0.01, fed=0.1, goal=0.03, turn=0.25, room=0.004),
    "wing-box": Disturbance(base=0.02, fed=0.05, goal=0.02, turn=0.25, room=0.004),
    "blade-row": Disturbance(base=0.003, fed=0.1, goal=0.01, turn=0.15, room=0.002),
}
"""By the name of the shipped problem."""
MOST_DRAWS = 1000
"""After so many ends that touch something the disturbance is too large for the scene."""


def disturbed_job(seed: int, job: str, links: int, folder: Path, name: str) -> SpaceProblem:
    """A shipped problem whose base, start and goal are moved at random; ends that leave no room are drawn again.

    Args:
        seed: of the draws.
        job: name of the shipped problem.
        links: of the arm.
        folder: of the shipped problems in space.
        name: of the problem.

    Raises:
        ProblemError: no ends with room were drawn.
    """
    problem, tree = _shipped(folder / f"{job}.toml")
    goal = problem.goal
    if not isinstance(goal, SpaceTipGoal) or goal.direction is None:
        raise ProblemError(f"the goal of {job} is no place and direction of the tip")
    moved = JOBS[job]
    rng = np.random.default_rng(seed)
    whole = problem.arm
    for _ in range(MOST_DRAWS):
        base = whole.base + moved.base * _across(rng, whole.direction)
        arm = with_links(replace(whole, base=base), links)
        start = SpaceJointPose(np.zeros((links, 2)), arm.base_range[0] + float(rng.uniform(0.0, moved.fed)))
        place = goal.position + moved.goal * _in_ball(rng)
        direction = goal.direction + np.tan(moved.turn) * _in_ball(rng)
        direction /= np.linalg.norm(direction)
        # Of the usual length whatever the number of links, so that a seed has the same ends for all.
        last = np.stack((place - whole.link_length * direction, place))[None]
        kept = arm.radius + problem.workspace.clearance + moved.room
        if float(tree.distances(last, kept).min()) >= kept and _stands_free(tree, arm, start, kept):
            tip = replace(goal, position=place, direction=direction)
            limits = _limits(problem.limits, links)
            return replace(problem, name=name, arm=arm, start=start, goal=tip, limits=limits, source="")
    raise ProblemError(f"no start and goal near those of {job} leave {moved.room} m of room")


@cache
def _shipped(file: Path) -> tuple[SpaceProblem, SurfaceTree]:
    problem = load_problem(file)
    if not isinstance(problem, SpaceProblem):
        raise ProblemError(f"{file} is no problem in space")
    return problem, SurfaceTree.of(problem.workspace.soup)


def _stands_free(tree: SurfaceTree, arm: SpaceArm, start: SpaceJointPose, kept: float) -> bool:
    """Whether the arm beyond its mount keeps a distance at the start."""
    points = joint_positions(arm, start.configuration(arm))
    along = points[0] + (arm.mount_length + arm.radius) * arm.direction
    return float(tree.distances(np.stack((along, points[-1]))[None], kept).min()) >= kept


def _limits(limits: Limits, links: int) -> Limits:
    """The limits of an arm of another number of links; those of the shipped problems are alike for all."""

    def all_alike(values: FloatArray) -> FloatArray:
        return np.full(3 * links, float(values[0]))

    torque = None if limits.torque is None else all_alike(limits.torque)
    jerk = None if limits.jerk is None else all_alike(limits.jerk)
    velocity = all_alike(limits.velocity)
    return replace(limits, velocity=velocity, acceleration=all_alike(limits.acceleration), torque=torque, jerk=jerk)


def _in_ball(rng: np.random.Generator) -> FloatArray:
    """A place in the unit ball, all alike likely, shape (3,)."""
    way = rng.normal(size=3)
    return np.asarray(rng.uniform() ** (1.0 / 3.0) * way / np.linalg.norm(way))


def _across(rng: np.random.Generator, direction: FloatArray) -> FloatArray:
    """A place in the unit disc across a direction, shape (3,)."""
    place = _in_ball(rng)
    return np.asarray(place - (place @ direction) * direction)
