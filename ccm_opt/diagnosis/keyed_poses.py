"""The ends of a problem as the checks see them: whole-arm poses and goals of the tip, each with its key."""

from collections.abc import Iterator
from dataclasses import dataclass

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.jointed.mapping import map_curve
from ccm_opt.problem import CurvePose, JointPose, Problem, TipGoal, Tolerances


@dataclass(frozen=True)
class WholePose:
    """A pose of the whole arm.

    Attributes:
        name: what messages call it.
        key: of the problem file.
        headings: of the links, shape (links,) [rad].
        feed: position of the base on its feed axis [m].
    """

    name: str
    key: str
    headings: FloatArray
    feed: float


@dataclass(frozen=True)
class TipPlace:
    """A goal for the tip.

    Attributes:
        name: what messages call it.
        key: of the problem file.
        goal: where the tip has to be.
        tolerances: how near counts.
    """

    name: str
    key: str
    goal: TipGoal
    tolerances: Tolerances


def whole_poses(problem: Problem) -> Iterator[WholePose]:
    """The start, then every goal that says where all links are."""
    yield _whole(problem, "start", "start", problem.start)
    for name, key, goal, _ in _goals(problem):
        if not isinstance(goal, TipGoal):
            yield _whole(problem, name, key, goal)


def tip_places(problem: Problem) -> Iterator[TipPlace]:
    """Every goal for the tip alone."""
    for name, key, goal, tolerances in _goals(problem):
        if isinstance(goal, TipGoal):
            yield TipPlace(name, f"{key}.position", goal, tolerances)


def _goals(problem: Problem) -> Iterator[tuple[str, str, TipGoal | JointPose | CurvePose, Tolerances]]:
    for k, stop in enumerate(problem.stops):
        yield f"stop {k + 1}", f"goal[{k}]", stop.goal, stop.tolerances
    last = f"goal[{len(problem.stops)}]" if problem.stops else "goal"
    yield "goal", last, problem.goal, problem.tolerances


def _whole(problem: Problem, name: str, key: str, pose: JointPose | CurvePose) -> WholePose:
    if isinstance(pose, JointPose):
        headings = problem.arm.headings(pose.bends)
    else:
        headings = map_curve(problem.arm, pose.configuration, problem.planner.mapping)
    return WholePose(name, key, headings, pose.feed)
