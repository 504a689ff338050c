"""OMPL's planners on our problems, compiled against its C++ library, with swept checks; needs ``libompl-dev``.

Each run has a process of its own with a limit on CPU time and on memory. The planners have OMPL's default parameters.
A goal for the tip is a region, to which poses at the goal are given, so that trees can grow from both ends.
"""

import ctypes
import multiprocessing
import resource
from dataclasses import dataclass
from multiprocessing.connection import Connection

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Problem, TipGoal
from tests.benchmarks.dense_sweep import ROUNDING, densely, least_gaps
from tests.benchmarks.swept_scene import MOST_POSES, POINTER, SweptScene, compiled

PLANNERS = ("RRTConnect", "STRIDE", "XXL", "KPIECE1", "BITstar")
OPTIONS = ("-std=c++17", "-I/usr/include/ompl-1.5", "-I/usr/include/eigen3", "-lompl")
"""Of the compiler; where Debian's package puts its headers."""
SPARE = 60.0
"""Wall time beyond four times the CPU limit after which the process is killed [s]."""
MEMORY = 8 << 30
"""Address space of a run [B]."""


@dataclass(frozen=True)
class PeerRun:
    """What came of one run.

    Attributes:
        outcome: "solved", "unsound" (its path crosses something), "not solved" or "killed".
        seconds: CPU time of the search.
    """

    outcome: str
    seconds: float


def run_peer(problem: Problem, goals: FloatArray, planner: str, limit: float, seed: int) -> PeerRun:
    """Run a planner of OMPL in a process of its own.

    Args:
        problem: which starts from a joint pose.
        goals: bends of poses at the goal, shape (m, links) [rad].
        planner: one of ``PLANNERS``.
        limit: CPU time [s].
        seed: of OMPL's random numbers.

    Raises:
        RuntimeError: where OMPL's library is not installed.
    """
    compiled("ompl_planners.cpp", *OPTIONS)
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_child, args=(sender, problem, goals, planner, limit, seed))
    process.start()
    sender.close()
    try:
        run = receiver.recv() if receiver.poll(4.0 * limit + SPARE) else PeerRun("killed", limit)
    except EOFError:
        run = PeerRun("killed", limit)
    process.kill()
    process.join()
    return run


def _child(sender: Connection, problem: Problem, goals: FloatArray, planner: str, limit: float, seed: int) -> None:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    most = int(np.ceil(usage.ru_utime + usage.ru_stime + 1.5 * limit + 2.0))
    resource.setrlimit(resource.RLIMIT_CPU, (most, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    way, seconds = _way(problem, goals, planner, limit, seed)
    resource.setrlimit(resource.RLIMIT_CPU, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    outcome = "not solved"
    if way is not None:
        gap = min(least_gaps(problem, densely(problem, way)))
        outcome = "solved" if gap > (-ROUNDING if problem.arm.radius > 0.0 else 0.0) else "unsound"
    sender.send(PeerRun(outcome, seconds))


def _way(problem: Problem, goals: FloatArray, planner: str, limit: float, seed: int) -> tuple[FloatArray | None, float]:
    """The way that a planner finds, shape (K, links) [rad], or None; and the CPU time that it took [s]."""
    scene = SweptScene.of(problem)
    goals = np.ascontiguousarray(goals)
    way = np.zeros((MOST_POSES, problem.arm.links))
    used = ctypes.c_double()
    search = compiled("ompl_planners.cpp", *OPTIONS).ompl_plan
    search.restype = ctypes.c_long
    count = search(
        planner.encode(), ctypes.byref(scene.struct), POINTER(scene.start.ctypes.data), POINTER(goals.ctypes.data),
        ctypes.c_long(len(goals)), *map(ctypes.c_double, _goal_set(problem)), ctypes.c_double(limit),
        ctypes.c_uint32(seed + 1), POINTER(way.ctypes.data), ctypes.c_long(MOST_POSES), ctypes.byref(used),
    )  # fmt: skip
    if count < 0:
        raise ValueError(f"got the planner {planner!r}, expected one of {', '.join(PLANNERS)}")
    return (way[:count] if count else None), used.value


def _goal_set(problem: Problem) -> tuple[float, ...]:
    """The tip's place, tolerance, heading and its tolerance; a negative tolerance for a goal of the whole arm."""
    if not isinstance(problem.goal, TipGoal):
        return (0.0, 0.0, -1.0, 0.0, 1.0)
    x, y = (float(value) for value in problem.goal.position)
    if problem.goal.heading is None:
        return (x, y, problem.tolerances.position, 0.0, np.inf)
    return (x, y, problem.tolerances.position, problem.goal.heading, problem.tolerances.heading)
