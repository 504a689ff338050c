"""Runs a planner of OMPL's Python wheel on one of the scenes, in a process of its own with a limit on CPU time.

``pip install ompl`` (extra ``bench``); the process is killed when its CPU time is used up, whatever the planner does.
Poses are checked by the compiled ``CrossingCheck`` behind a Python callback (4 µs at 12 links), motions by OMPL's own
discrete validator at ``RESOLUTION`` of the extent of joint space; its default, 1 %, lets motions jump through walls.
"""

import multiprocessing
import os
import resource
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from ccm_opt.ground.arrays import FloatArray
from ccm_opt.problem import JointPose, Problem, TipGoal
from tests.crossings import CrossingCheck, densely
from tests.ompl_scenes import SCENES

RESOLUTION = 5e-4
"""Step of OMPL's motion check as a share of the extent of joint space."""
PLANNERS = ("RRTConnect", "KPIECE1", "BITstar")
SPARE = 60.0
"""Wall time beyond the CPU limit after which the process is killed [s]."""


@dataclass(frozen=True)
class PeerRun:
    """What came of one run.

    Attributes:
        outcome: "solved", "unsound" (its path crosses something between checks), "not solved" or "killed".
        seconds: CPU time of the search.
        checks: poses checked.
    """

    outcome: str
    seconds: float
    checks: int


def run_peer(scene: str, links: int, goal: FloatArray, planner: str, limit: float, seed: int) -> PeerRun:
    """Run a planner of OMPL in a process of its own.

    Args:
        scene: a key of ``SCENES``.
        links: of the arm.
        goal: bends of a pose at the goal, (links,) [rad], given to the planner as a gift where the goal is the tip's.
        planner: one of ``PLANNERS``.
        limit: CPU time [s].
        seed: of OMPL's random numbers.
    """
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(sender, scene, links, goal, planner, limit, seed))
    process.start()
    sender.close()
    try:
        run = receiver.recv() if receiver.poll(4.0 * limit + SPARE) else PeerRun("killed", limit, 0)
    except EOFError:
        run = PeerRun("killed", limit, 0)
    process.kill()
    process.join()
    return run


def _child(sender: Connection, scene: str, links: int, goal: FloatArray, planner: str, limit: float, seed: int) -> None:
    problem = SCENES[scene](links)
    check = CrossingCheck(problem)
    setup, counter = _setup(problem, check, goal, planner, seed)
    used = sum(os.times()[:2])
    hard = int(np.ceil(used + limit + 2.0))
    resource.setrlimit(resource.RLIMIT_CPU, (hard, hard))
    status = setup.solve(_stopper(setup, used + limit))
    seconds = sum(os.times()[:2]) - used
    outcome = "not solved"
    if status and setup.haveExactSolutionPath():
        states = np.array([state[0:links] for state in setup.getSolutionPath().getStates()])
        outcome = "solved" if check.path_is_free(densely(states)) else "unsound"
    sender.send(PeerRun(outcome, seconds, counter[0]))


def _setup(problem: Problem, check: CrossingCheck, goal: FloatArray, planner: str, seed: int) -> tuple[Any, list[int]]:
    from ompl import base, geometric, util

    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(seed + 1)
    arm = problem.arm
    space = base.RealVectorStateSpace(arm.links)
    bounds = base.RealVectorBounds(arm.links)
    for joint in range(arm.links):
        reach = arm.base_limit if joint == 0 else np.pi
        bounds.setLow(joint, -reach)
        bounds.setHigh(joint, reach)
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    counter = [0]

    def is_free(state: Any) -> bool:
        counter[0] += 1
        return check(state[0 : arm.links])

    setup.setStateValidityChecker(is_free)
    information = setup.getSpaceInformation()
    information.setStateValidityCheckingResolution(RESOLUTION)
    start = space.allocState()
    if not isinstance(problem.start, JointPose):
        raise TypeError("the scenes start from joint poses")
    start[0 : arm.links] = [float(bend) for bend in problem.start.bends]
    setup.setStartState(start)
    setup.setGoal(_goal(information, problem, goal))
    chosen = getattr(geometric, planner)(information)
    if planner == "BITstar":
        chosen.setStopOnSolnImprovement(True)
    setup.setPlanner(chosen)
    setup.setup()
    return setup, counter


def _goal(information: Any, problem: Problem, pose: FloatArray) -> Any:
    """The whole-arm goal, or the tip's disc with one pose in it to grow a tree from."""
    from ompl import base

    arm = problem.arm

    class TipRegion(base.GoalSampleableRegion):  # type: ignore[misc]  # the wheel ships no types
        """Poses whose tip is within the tolerance of the goal."""

        def distanceGoal(self, state: Any) -> float:  # noqa: N802 - OMPL's name
            if not isinstance(problem.goal, TipGoal):
                return float(np.abs(np.array(state[0 : arm.links]) - pose).max())
            headings = arm.headings(np.array(state[0 : arm.links]))
            return float(np.hypot(*(arm.joint_positions(headings)[-1] - problem.goal.position)))

        def sampleGoal(self, state: Any) -> None:  # noqa: N802
            state[0 : arm.links] = [float(bend) for bend in pose]

        def maxSampleCount(self) -> int:  # noqa: N802
            return 1

    region = TipRegion(information)
    region.setThreshold(problem.tolerances.position if isinstance(problem.goal, TipGoal) else 1e-6)
    return region


def _stopper(setup: Any, limit: float) -> Any:
    """Stops at the first solution, also planners that would go on improving it, or when the CPU time is used up."""
    from ompl import base

    def over() -> bool:
        return sum(os.times()[:2]) > limit or bool(setup.getProblemDefinition().hasExactSolution())

    return base.PlannerTerminationCondition(over)
