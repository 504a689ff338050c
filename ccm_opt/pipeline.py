"""The driver, in the paper's order: problem, plan, joint trajectory, dynamics, simulation, verification."""

import platform
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from importlib.metadata import version

import numpy as np

from ccm_opt import retiming, verification
from ccm_opt.closed_loop import simulate_and_check
from ccm_opt.curve_planner import CurvePlanner
from ccm_opt.diagnosis.explain import explaining, refuse_impossible
from ccm_opt.diagnosis.recall import Recalling
from ccm_opt.dynamics.compiled import prepare
from ccm_opt.dynamics.inverse_dynamics import InverseDynamics, joint_states
from ccm_opt.dynamics.simulation import check_options
from ccm_opt.errors import ProblemError, VerificationError
from ccm_opt.feed_planner import FeedPlanner
from ccm_opt.hill_climbing_planner import HillClimbingPlanner
from ccm_opt.jointed.frames import revolute_angles
from ccm_opt.motion.feeding.deviation import Deviation, deviation
from ccm_opt.planner import Planner, Retimer
from ccm_opt.problem import Problem, TipGoal
from ccm_opt.solution import Check, JointPath, JointStates, JointTrajectory, SimulatedMotion, Solution
from ccm_opt.stages import Stages
from ccm_opt.user_terms.checking import checks_of, metrics_of
from ccm_opt.user_terms.compiled import UserTerms, compile_terms
from ccm_opt.user_terms.terms import Constraint, Cost

PACKAGES = ("ccm-opt", "casadi", "daqp", "numpy", "piqp", "scipy", "shapely", "toppra")


def solve(
    problem: Problem,
    *,
    progress: Callable[[str], None] | None = None,
    planner: Planner | None = None,
    retimer: Retimer | None = None,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    explain: bool = True,
) -> Solution:
    """Plan, time, simulate and verify a motion.

    Args:
        problem: what to solve.
        progress: called with the name of each stage when it starts.
        planner: another planner; when None the feed planner for an arm on a feed axis, else the curve planner.
        retimer: another way to time the path; the one that the problem names when None.
        constraints: the user's own; another planner is not told of them, but its plan is held against them.
        costs: the user's own; another planner is not told of them.
        explain: whether the time left after a failure is used to tell why, and what change would help.

    Returns:
        A verified solution; there is no unverified one.

    Raises:
        ProblemError: the problem cannot be used as it stands.
        NoPlanFound: with a diagnosis: there is no plan within the limits.
        VerificationError: the verifier refuses the plan; a defect of the planner.
    """
    stages = Stages(progress)
    prepare(problem.arm)
    with stages("dynamics model"):
        check_options(problem.arm, problem.simulation)
        terms = compile_terms(problem.arm, constraints, costs) if constraints or costs else None
    chosen = Recalling(planner or default_planner(problem, stages, terms))

    def again(changed: Problem) -> object:
        own, quiet = None if terms is None else compile_terms(changed.arm, constraints, costs), Stages()
        other = Recalling(planner or default_planner(changed, quiet, own), chosen.paths)
        return planned(changed, other, quiet, retimer, own)

    with explaining(problem, again, stages, wanted=explain):
        with stages("necessary checks"):
            refuse_impossible(problem)
        path, trajectory, joints, checks = planned(problem, chosen, stages, retimer, terms)
    with stages("simulation"):
        simulated, of_simulation = simulate_and_check(problem, trajectory, joints)
    figures = {**metrics(problem, path, trajectory, joints, simulated, checks), **of_simulation}
    if terms is not None:
        figures |= metrics_of(terms, problem.arm, path, trajectory)
    return Solution(
        problem,
        path,
        trajectory,
        joints,
        simulated,
        checks,
        figures,
        dict(stages.timings),
        versions=versions(),
    )


def default_planner(problem: Problem, stages: Stages, terms: UserTerms | None = None) -> Planner:
    """The planner for a problem and the user's own terms."""
    if problem.planner.method == "hill-climbing":
        if terms is not None:
            raise ProblemError("hill climbing knows no constraints and costs of one's own; use planner.method nlp")
        return HillClimbingPlanner(stages)
    if problem.arm.feed is None:
        return CurvePlanner(stages, terms)
    if terms is not None:
        raise ProblemError("own constraints and costs are not planned for with a feed axis yet; leave arm.feed out")
    return FeedPlanner(stages)


def planned(
    problem: Problem, planner: Planner, stages: Stages, retimer: Retimer | None, terms: UserTerms | None
) -> tuple[JointPath, JointTrajectory, JointStates, tuple[Check, ...]]:
    """A path with its first timing that passes every check.

    Raises:
        NoPlanFound: there is no plan within the limits.
        VerificationError: the verifier refuses the plan.
    """
    path = planner.plan(problem)
    with stages("dynamics model"):
        inverse_dynamics = InverseDynamics(problem.arm, problem.simulation.gravity)
    return path, *timed_and_verified(problem, path, inverse_dynamics, stages, retimer, terms)


def timed_and_verified(
    problem: Problem,
    path: JointPath,
    inverse_dynamics: InverseDynamics,
    stages: Stages,
    retimer: Retimer | None = None,
    terms: UserTerms | None = None,
) -> tuple[JointTrajectory, JointStates, tuple[Check, ...]]:
    """The first timing of a path that passes every check.

    Raises:
        NoPlanFound: the path cannot be timed within the limits.
        VerificationError: no timing passes; it names what the last of them fails.
    """
    timings = timings_of(problem, path, inverse_dynamics, retimer)
    failures: list[str] = []
    while True:
        with stages("retiming"):
            trajectory = next(timings, None)
            if trajectory is None:
                raise VerificationError(failures)
            joints = joint_states(problem.arm, trajectory, inverse_dynamics)
        with stages("verification"):
            checks = verification.verify(problem, trajectory, joints)
            if terms is not None:
                checks += checks_of(terms, problem.arm, path, trajectory)
        failures = [
            f"{check.name}: {check.worst:.6g} {check.unit} at {check.where}" for check in checks if not check.passed
        ]
        if not failures:
            return trajectory, joints, checks


def timings_of(
    problem: Problem, path: JointPath, inverse_dynamics: InverseDynamics, retimer: Retimer | None
) -> Iterator[JointTrajectory]:
    """Timings of a path, best first: those of the problem's method, or the only one of a user's own."""
    if retimer is not None:
        yield retimer.retime(problem, path)
        return
    revolutes, method = partial(revolute_angles, problem.arm), problem.planner.retiming
    length = problem.arm.link_length
    yield from retiming.timings(
        path, problem.limits, inverse_dynamics, revolutes=revolutes, method=method, link_length=length
    )


def metrics(
    problem: Problem,
    path: JointPath,
    trajectory: JointTrajectory,
    joints: JointStates,
    simulated: SimulatedMotion,
    checks: tuple[Check, ...],
) -> Mapping[str, float]:
    """The figures of merit of a plan, named with their units."""
    arm = problem.arm
    headings = arm.headings(trajectory.bend_angles)
    feeds = 0.0 if trajectory.feed is None else trajectory.feed.positions
    tip = arm.joint_positions(headings, feeds)[-1, -1]
    figures = {
        "duration_s": trajectory.duration,
        "peak_torque_Nm": float(np.max(np.abs(joints.torques), initial=0.0)),
        "joint_path_length_rad": float(np.linalg.norm(np.diff(trajectory.bend_angles, axis=0), axis=1).sum()),
        "largest_curvature_per_m": float(np.max(np.abs(trajectory.bend_angles[:, 1:]), initial=0.0) / arm.link_length),
        "keyframes": float(len(path.keyframes)),
        "tracking_error_rad": simulated.tracking_error,
    }
    if isinstance(problem.goal, TipGoal):
        figures["tip_error_m"] = float(np.hypot(*(tip - problem.goal.position)))
        if problem.goal.heading is not None:
            turn = (headings[-1, -1] - problem.goal.heading + np.pi) % (2.0 * np.pi) - np.pi
            figures["heading_error_rad"] = abs(float(turn))
    if path.leaders and trajectory.feed is not None:
        figures.update(leader_figures(deviation(arm, trajectory.bend_angles, trajectory.feed.positions, path.leaders)))
    figures.update(
        {
            f"least_{check.name.replace(' ', '_')}_m": check.worst
            for check in checks
            if check.unit == "m" and "clearance" in check.name
        }
    )
    return figures


def leader_figures(found: Deviation) -> Mapping[str, float]:
    """How well the arm follows its leader, as figures of merit."""
    return {
        "leader_deviation_mean_m": found.mean,
        "leader_deviation_worst_m": found.worst,
        "leader_deviation_straight_mean_m": found.straight_mean,
    }


def versions() -> Mapping[str, str]:
    """Versions of Python and of the packages a result depends on."""
    return {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}}
