"""Builds a solution from a verified plan.

Nothing that is measured or simulated here can invalidate a plan. A simulation that cannot be run yields a verdict; a
defect of this package in a measurement is logged with its traceback, and the result of that measurement is missing.
"""

import logging
import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from importlib.metadata import version
from itertools import combinations
from types import MappingProxyType
from typing import TypeVar

import numpy as np
import shapely

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import CancelledWithPlan
from ccm_opt.core.progress import Stages
from ccm_opt.diagnosis.possible_gap import possible_gap
from ccm_opt.driver.clearance_over_time import clearance_over_time
from ccm_opt.driver.closed_loop import not_simulated, simulate_and_check
from ccm_opt.driver.metrics import metrics
from ccm_opt.driver.robustness import tolerance_at_once
from ccm_opt.driver.settings import DEFAULT_SETTINGS, Settings
from ccm_opt.driver.verified_plan import VerifiedPlan
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import (
    Check,
    ClearanceRecord,
    JointTrajectory,
    PossibleGap,
    SimulatedMotion,
    Solution,
    SurvivedError,
)
from ccm_opt.scene.workspace import Obstacle
from ccm_opt.verification.verifier import left_unchecked

Result = TypeVar("Result")

logger = logging.getLogger(__name__)


def gap_between_walls(problem: Problem, points: FloatArray, most: float) -> PossibleGap | None:
    """Return the gap of an arm midway between the two closest walls that a pose passes between.

    Where the axis crosses the shortest line between two walls, it is at most half that line's length from one of them.
    So no motion that leads between the two has a larger gap.

    Args:
        problem: problem with the walls.
        points: joints and tip of the pose, shape (links + 1, 2) [m].
        most: upper limit of interesting gaps [m]; larger gaps give None.

    Returns:
        The bound with the names of the walls; None where the pose does not pass between walls that close together.
    """
    arm = problem.arm
    body = arm.radius + problem.workspace.clearance
    link, share = arm.mount_end
    exposed = np.vstack((points[link] + share * (points[link + 1] - points[link]), points[link + 1 :]))
    axis = shapely.LineString(exposed)
    # Midway between walls closer than this, the gap is below `most`.
    reach = 2.0 * (body + most)
    near = [wall for wall in problem.workspace.walls if shapely.distance(wall.core, axis) - wall.rounding < reach]
    found = [
        PossibleGap(0.5 * apart - body, "passage", (one.name, other.name))
        for one, other in combinations(near, 2)
        if 0.0 < (apart := _apart(one, other, axis)) < reach
    ]
    return min(found, key=lambda bound: bound.value, default=None)


def _apart(one: Obstacle, other: Obstacle, axis: shapely.LineString) -> float:
    """Return the distance between two walls if the arm's axis crosses their shortest connecting line, else inf [m]."""
    line = shapely.shortest_line(one.core, other.core)
    if not shapely.intersects(line, axis):
        return float(np.inf)
    return float(shapely.length(line)) - one.rounding - other.rounding


def clearance_record(
    problem: Problem,
    trajectory: JointTrajectory,
    checks: Sequence[Check],
    settings: Settings = DEFAULT_SETTINGS,
) -> ClearanceRecord:
    """Return the record of the clearance that a verified motion keeps.

    Args:
        problem: the problem as posed.
        trajectory: the motion.
        checks: checks of the verifier, which hold the least gaps.
        settings: settings of all stages.
    """
    room = clearance_over_time(problem, trajectory, problem.wanted_gap, checks, settings.room, settings.verification)
    if room.wanted == 0.0:
        return room
    if not room.short:
        # The motion keeps the preferred clearance, so the preferred clearance is possible.
        return replace(room, possible=PossibleGap(room.wanted, "wanted gap"))
    if problem.dimension == 3:
        # Flooding the workspace for the widest way takes as long as planning.
        return room
    bounds = list(_passage_bounds(problem, trajectory, room))
    general = possible_gap(problem, room)
    if general is not None:
        bounds.append(general)
    return replace(room, possible=min(bounds, key=lambda bound: bound.value, default=None))


def _passage_bounds(problem: Problem, trajectory: JointTrajectory, room: ClearanceRecord) -> Iterator[PossibleGap]:
    """Yield an upper bound of the wall gap at each passage with less than the preferred clearance."""
    for part in room.short:
        if part.cause != "passage":
            continue
        pose = np.array([np.interp(part.nearest.time, trajectory.time, column) for column in trajectory.positions.T])
        bound = gap_between_walls(problem, problem.arm.joint_positions_at(pose), room.wanted)
        if bound is not None:
            yield bound


PACKAGES = ("ccm-opt", "casadi", "daqp", "numpy", "piqp", "scipy", "shapely", "toppra")
"""Packages that a result depends on."""


@cache
def versions() -> Mapping[str, str]:
    """Return the versions of Python and of the packages that a result depends on."""
    return {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}}


def draft_solution(
    problem: Problem,
    plan: VerifiedPlan,
    stages: Stages,
    simulated: SimulatedMotion | None = None,
    figures: Mapping[str, float] = MappingProxyType({}),
    room: ClearanceRecord | None = None,
    tolerance: tuple[SurvivedError, ...] = (),
) -> Solution:
    """Return the solution for a verified plan, from the results known so far.

    Args:
        problem: the problem as posed.
        plan: a motion that passes every check.
        stages: CPU time of every stage.
        simulated: motion of the simulated arm; None if it was not simulated.
        figures: further figures of merit, of the simulation and the costs.
        room: clearance that the motion keeps; None where it was not measured.
        tolerance: errors that the motion survives.
    """
    if simulated is None:
        simulated = not_simulated(plan.trajectory, plan.joints, problem.simulation.step, "skipped")
    own = metrics(problem, plan.path, plan.trajectory, plan.joints, simulated, plan.checks)
    return Solution(
        problem=problem,
        path=plan.path,
        trajectory=plan.trajectory,
        joints=plan.joints,
        simulation=simulated,
        checks=(*plan.checks, *plan.of_terms.checks),
        metrics={**own, **figures, **plan.of_terms.figures},
        timings=dict(stages.timings),
        versions=dict(versions()),
        room=room,
        tolerance=tolerance,
        tries=plan.tries,
        not_checked=left_unchecked(problem, plan.trajectory),
    )


def described(
    problem: Problem,
    plan: VerifiedPlan,
    stages: Stages,
    settings: Settings = DEFAULT_SETTINGS,
    figures: Mapping[str, float] = MappingProxyType({}),
) -> Solution:
    """Return the solution for a verified plan, with clearance over time, survived errors and simulation.

    Args:
        problem: the problem that the plan solves.
        plan: a plan that passes every check.
        stages: names and times the stages, including those before.
        settings: settings of all stages.
        figures: further figures of merit, by name.

    Raises:
        CancelledWithPlan: on Ctrl-C, with the solution as far as it is known.
    """
    room: ClearanceRecord | None = None
    tolerance: tuple[SurvivedError, ...] = ()
    simulated: SimulatedMotion | None = None
    of_simulation: Mapping[str, float] = {}

    def so_far() -> Solution:
        known = {**of_simulation, **figures}
        return draft_solution(problem, plan, stages, simulated, known, room, tolerance)

    try:
        with stages("clearance"):
            of_clearance = partial(clearance_record, problem, plan.trajectory, plan.checks, settings)
            room = kept(of_clearance, "the clearance of the motion was not measured", lambda _: None)
        with stages("tolerance"):
            of_errors = partial(tolerance_at_once, problem, plan.trajectory, settings)
            tolerance = kept(of_errors, "the tolerance of the motion was not certified", lambda _: ())
        with stages("simulation"):
            simulated, of_simulation = simulated_motion(problem, plan)
    except KeyboardInterrupt as interrupt:
        raise CancelledWithPlan(so_far()) from interrupt
    return so_far()


def kept(stage: Callable[[], Result], what: str, instead: Callable[[Exception], Result]) -> Result:
    """Return the result of a stage that assesses a verified plan, or a substitute if the stage fails.

    A failure is logged as a defect with its traceback.

    Args:
        stage: function that computes the result.
        what: description of the result that is missing after a failure.
        instead: function that makes the substitute from the exception.
    """
    try:
        return stage()
    except Exception as defect:
        logger.exception("%s: this is a bug in ccm-opt, please report it", what)
        return instead(defect)


def simulated_motion(problem: Problem, plan: VerifiedPlan) -> tuple[SimulatedMotion, Mapping[str, float]]:
    """Return the simulated motion and its figures.

    If the simulation fails by a defect, the simulated arm is recorded as resting at the start.
    """
    stage = partial(simulate_and_check, problem, plan.trajectory, plan.joints)
    return kept(stage, "the plan was not simulated", partial(_stands_still, problem, plan))


def _stands_still(
    problem: Problem, plan: VerifiedPlan, defect: Exception
) -> tuple[SimulatedMotion, Mapping[str, float]]:
    reason = f"an error in ccm-opt: {type(defect).__name__}: {defect}"
    return not_simulated(plan.trajectory, plan.joints, problem.simulation.step, reason), {}
