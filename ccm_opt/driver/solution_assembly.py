"""Assembly of a solution from a verified plan: clearance over time, tolerated errors, simulation, figures of merit.

Nothing measured or simulated here can invalidate a plan. A simulation that cannot be run gives an outcome that says so;
an unexpected exception in a measurement is logged with its traceback, and the result is omitted.
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
from ccm_opt.core.polyline import points_at
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
    JointPath,
    JointTrajectory,
    PossibleGap,
    SimulatedMotion,
    Solution,
    ToleratedError,
)
from ccm_opt.scene.workspace import Obstacle
from ccm_opt.verification.verifier import left_unchecked

Result = TypeVar("Result")

logger = logging.getLogger(__name__)


def gap_between_walls(problem: Problem, points: FloatArray, most: float) -> PossibleGap | None:
    """Return an upper bound on the clearance of motions between the two closest obstacles that a pose passes between.

    Where the arm's axis crosses the shortest line between two obstacles, its distance from one of them is at most half
    the length of that line. No motion between the two has a larger clearance.

    Args:
        problem: the problem, which gives planar arm and obstacles.
        points: positions of joints and tip of n links in the pose, shape (n + 1, 2) [m].
        most: clearance above which a bound is of no interest [m].

    Returns:
        The bound with the names of the obstacles; None if the pose passes between no two obstacles whose bound is less
        than ``most``.
    """
    arm = problem.arm
    body = float(np.min(arm.radii)) + problem.workspace.clearance
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
    """Return the distance of two planar obstacles if the arm's axis crosses their shortest connection, else inf [m]."""
    line = shapely.shortest_line(one.core, other.core)
    if not shapely.intersects(line, axis):
        return float(np.inf)
    return float(shapely.length(line)) - one.rounding - other.rounding


def clearance_record(
    problem: Problem,
    path: JointPath,
    trajectory: JointTrajectory,
    checks: Sequence[Check],
    settings: Settings = DEFAULT_SETTINGS,
) -> ClearanceRecord:
    """Return the clearance of a verified motion over time, with an upper bound on the clearance of any motion.

    Args:
        problem: the problem as posed.
        path: path of the motion, which says what limits its clearance.
        trajectory: the motion.
        checks: verifier's checks, which hold the minimum clearances.
        settings: settings of all stages of planning.
    """
    room = clearance_over_time(problem, trajectory, problem.wanted_gap, checks, settings.room, settings.verification)
    if room.wanted == 0.0:
        return room
    if not room.short:
        # The motion keeps the preferred clearance, so the preferred clearance is possible.
        return replace(room, possible=PossibleGap(room.wanted, "wanted gap"))
    if any(part.cause == "passage" for part in room.short):
        limits = (part.clearance_limit for part in path.parts or (path,))
        room = replace(room, limited_by=tuple(dict.fromkeys(limit for limit in limits if limit is not None)))
    if problem.dimension == 3:
        # Flooding the workspace for the widest way takes as long as planning.
        return room
    bounds = list(_passage_bounds(problem, trajectory, room))
    general = possible_gap(problem, room)
    if general is not None:
        bounds.append(general)
    return replace(room, possible=min(bounds, key=lambda bound: bound.value, default=None))


def _passage_bounds(problem: Problem, trajectory: JointTrajectory, room: ClearanceRecord) -> Iterator[PossibleGap]:
    """Yield an upper bound on clearance for each passage in which a motion keeps less than the preferred clearance."""
    for part in room.short:
        if part.cause != "passage":
            continue
        pose = points_at(trajectory.positions, trajectory.time, part.nearest.time)
        bound = gap_between_walls(problem, problem.arm.joint_positions_at(pose), room.wanted)
        if bound is not None:
            yield bound


PACKAGES = ("ccm-opt", "casadi", "daqp", "numpy", "scipy", "shapely", "toppra")
"""Names of the packages on which results depend."""


@cache
def versions() -> Mapping[str, str]:
    """Return the versions of Python and of the packages on which results depend, by name."""
    return {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}}


def draft_solution(
    problem: Problem,
    plan: VerifiedPlan,
    stages: Stages,
    simulated: SimulatedMotion | None = None,
    figures: Mapping[str, float] = MappingProxyType({}),
    room: ClearanceRecord | None = None,
    tolerance: tuple[ToleratedError, ...] = (),
    *,
    following: bool = True,
) -> Solution:
    """Return the solution of a problem assembled from a verified plan and the results known so far.

    Args:
        problem: the problem as posed.
        plan: the verified plan.
        stages: clock with the CPU time of every stage.
        simulated: motion of the simulated arm; None if it was not simulated.
        figures: further figures of merit, of the simulation and the costs.
        room: clearance of the motion over time; None if it was not measured.
        tolerance: errors that the motion tolerates.
        following: whether the metrics say how closely the arm follows the path of its tip.
    """
    if plan.tour is not None:
        problem = plan.tour.visited
    if simulated is None:
        simulated = not_simulated(problem.arm, plan.trajectory, plan.joints, problem.simulation.step)
    plan_metrics = metrics(
        problem, plan.path, plan.trajectory, plan.joints, simulated, plan.checks, following=following
    )
    return Solution(
        problem=problem,
        path=plan.path,
        trajectory=plan.trajectory,
        joints=plan.joints,
        simulation=simulated,
        checks=(*plan.checks, *plan.of_terms.checks),
        metrics={**plan_metrics, **figures, **plan.of_terms.figures},
        timings=dict(stages.timings),
        versions=dict(versions()),
        room=room,
        tolerance=tolerance,
        tries=plan.tries,
        not_checked=left_unchecked(problem, plan.trajectory),
        tour=plan.tour,
    )


def described(
    problem: Problem,
    plan: VerifiedPlan,
    stages: Stages,
    settings: Settings = DEFAULT_SETTINGS,
    figures: Mapping[str, float] = MappingProxyType({}),
) -> Solution:
    """Return the solution of a problem for a verified plan, with clearance over time, tolerated errors and simulation.

    Args:
        problem: the problem.
        plan: the verified plan.
        stages: clock that names and times the stages, including earlier ones.
        settings: settings of all stages of planning.
        figures: further figures of merit, by name.

    Raises:
        CancelledWithPlan: Ctrl-C was pressed; the error holds the solution as far as known.
    """
    if plan.tour is not None:
        problem = plan.tour.visited
    room: ClearanceRecord | None = None
    tolerance: tuple[ToleratedError, ...] = ()
    simulated: SimulatedMotion | None = None
    of_simulation: Mapping[str, float] = {}

    def so_far() -> Solution:
        known = {**of_simulation, **figures}
        return draft_solution(problem, plan, stages, simulated, known, room, tolerance)

    try:
        with stages("clearance"):
            of_clearance = partial(clearance_record, problem, plan.path, plan.trajectory, plan.checks, settings)
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
    """Return the result of a stage that evaluates a verified plan, or a substitute if the stage raises an exception.

    The exception is logged as a defect with its traceback.

    Args:
        stage: function that computes the result.
        what: sentence about the missing result, for the log.
        instead: function of the exception that returns the substitute.
    """
    try:
        return stage()
    except Exception as defect:
        logger.exception("%s: this is a bug in ccm-opt, please report it", what)
        return instead(defect)


def simulated_motion(problem: Problem, plan: VerifiedPlan) -> tuple[SimulatedMotion, Mapping[str, float]]:
    """Return the simulation of a verified plan and its figures of merit.

    Sections that bend evenly are not simulated. If the simulation fails through a defect, the simulated arm is recorded
    as resting in the start pose.
    """
    stage = partial(simulate_and_check, problem, plan.trajectory, plan.joints)
    return kept(stage, "the plan was not simulated", partial(_stands_still, problem, plan))


def _stands_still(
    problem: Problem, plan: VerifiedPlan, defect: Exception
) -> tuple[SimulatedMotion, Mapping[str, float]]:
    reason = f"an error in ccm-opt: {type(defect).__name__}: {defect}"
    return not_simulated(problem.arm, plan.trajectory, plan.joints, problem.simulation.step, reason), {}
