"""Tasks and planners that tests of comparisons run in other processes, where they are imported by module name."""

import os
import signal
import time
from pathlib import Path

import numpy as np
from scipy.interpolate import BSpline

from ccm_opt.core.errors import Diagnosis, MotionNotFound
from ccm_opt.problem import JointPose, Problem
from ccm_opt.problem.solution import JointPath


def double(number: int) -> int:
    """Return twice a number."""
    return 2 * number


def nap(seconds: float) -> int:
    """Sleep for some seconds, and return the id of the process."""
    time.sleep(seconds)
    return os.getpid()


def slow_double(number: int) -> tuple[int, int]:
    """Return twice a number, after 50 ms, and the id of the process."""
    time.sleep(0.05)
    return 2 * number, os.getpid()


def deadly(number: int) -> int:
    """Return twice a number; for 7, end the process instead."""
    if number == 7:
        os._exit(1)
    return 2 * number


def die_once(task: tuple[int, str]) -> int:
    """Return twice a number; for 5, end the process instead, but only the first time.

    Args:
        task: the number, and the path of a file that is created before the process ends, so that it ends only once.
    """
    number, mark = task
    if number == 5 and not Path(mark).exists():
        Path(mark).touch()
        os._exit(1)
    return 2 * number


def fail_on_odd(number: int) -> int:
    """Return a number if it is even.

    Raises:
        ValueError: the number is odd.
    """
    if number % 2:
        raise ValueError(f"{number} is odd")
    return number


class StraightPlanner:
    """Planner whose path is straight in joint space between two joint poses, whatever obstacles there are."""

    def plan(self, problem: Problem) -> JointPath:
        """Return the straight path from start to goal.

        Raises:
            MotionNotFound: start or goal is no joint pose.
        """
        if not (isinstance(problem.start, JointPose) and isinstance(problem.goal, JointPose)):
            raise MotionNotFound(Diagnosis("this planner goes to joint poses only", "motion"))
        control = np.linspace(problem.start.bends, problem.goal.bends, 4)
        return JointPath(BSpline(np.repeat([0.0, 1.0], 4), control, 3), control, (), "straight")


class BrokenPlanner:
    """Planner that fails with an exception that is no planning failure, as by a programming error."""

    def plan(self, problem: Problem) -> JointPath:
        """Raise an exception that is no planning failure."""
        raise ZeroDivisionError(f"no plan for {problem.name}")


def leave() -> None:
    """Exit instead of returning a planner."""
    raise SystemExit(0)


NOT_A_PLANNER = 3


class HangingPlanner:
    """Planner that never returns."""

    def plan(self, problem: Problem) -> JointPath:  # noqa: ARG002 - the protocol's
        """Sleep forever."""
        while True:
            time.sleep(1.0)


class GreedyPlanner:
    """Planner that allocates memory until there is none left."""

    def plan(self, problem: Problem) -> JointPath:  # noqa: ARG002 - the protocol's
        """Allocate memory forever."""
        eaten = []
        while True:
            eaten.append(np.ones(4 << 20))


class DyingPlanner:
    """Planner that ends its process by a signal."""

    def plan(self, problem: Problem) -> JointPath:  # noqa: ARG002 - the protocol's
        """End the process by SIGSEGV, as an invalid memory access does."""
        os.kill(os.getpid(), signal.SIGSEGV)
        raise AssertionError("still here")


class LeavingPlanner:
    """Planner that raises ``SystemExit``."""

    def plan(self, problem: Problem) -> JointPath:  # noqa: ARG002 - the protocol's
        """Raise ``SystemExit``."""
        raise SystemExit(3)


class RubbishPlanner:
    """Planner that returns an object that is no path, and writes to the stream of the worker's results."""

    def plan(self, problem: Problem) -> JointPath:  # noqa: ARG002 - the protocol's
        """Write bytes to standard output, and return a string instead of a path."""
        print("rubbish")  # noqa: T201
        os.write(1, b"\x80\x04rubbish")
        return "rubbish"  # type: ignore[return-value]


class NowherePlanner:
    """Planner that returns a path of NaN."""

    def plan(self, problem: Problem) -> JointPath:
        """Return a joint path whose coefficients are all NaN."""
        control = np.full((4, problem.arm.links), np.nan)
        return JointPath(BSpline(np.repeat([0.0, 1.0], 4), control, 3), control, (), "nowhere")
