"""Tasks that tests of the comparison run in other processes; they are found there by the name of this module."""

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
    """Twice a number."""
    return 2 * number


def nap(seconds: float) -> int:
    """Sleep, and tell in which process."""
    time.sleep(seconds)
    return os.getpid()


def slow_double(number: int) -> tuple[int, int]:
    """Twice a number after 50 ms, and the process it was done in."""
    time.sleep(0.05)
    return 2 * number, os.getpid()


def deadly(number: int) -> int:
    """Twice a number; seven ends its process."""
    if number == 7:
        os._exit(1)
    return 2 * number


def die_once(task: tuple[int, str]) -> int:
    """Twice a number; the first who finds no mark leaves one and ends the process."""
    number, mark = task
    if number == 5 and not Path(mark).exists():
        Path(mark).touch()
        os._exit(1)
    return 2 * number


def fail_on_odd(number: int) -> int:
    """The number, if it is even."""
    if number % 2:
        raise ValueError(f"{number} is odd")
    return number


class StraightPlanner:
    """A planner that goes straight through joint space to a goal for the joints, whatever is in the way."""

    def plan(self, problem: Problem) -> JointPath:
        """The straight path.

        Raises:
            MotionNotFound: when the goal is not one for the joints.
        """
        if not (isinstance(problem.start, JointPose) and isinstance(problem.goal, JointPose)):
            raise MotionNotFound(Diagnosis("this planner goes to joint poses only", "motion"))
        control = np.linspace(problem.start.bends, problem.goal.bends, 4)
        return JointPath(BSpline(np.repeat([0.0, 1.0], 4), control, 3), control, (), "straight")


class BrokenPlanner:
    """A planner with a defect."""

    def plan(self, problem: Problem) -> JointPath:
        """Fail as a defect does."""
        raise ZeroDivisionError(f"no plan for {problem.name}")


def leave() -> None:
    """End the process instead of making a planner."""
    raise SystemExit(0)


NOT_A_PLANNER = 3


class HangingPlanner:
    """A planner that comes back never."""

    def plan(self, problem: Problem) -> JointPath:  # noqa: ARG002 - the protocol's
        """Sleep for ever."""
        while True:
            time.sleep(1.0)


class GreedyPlanner:
    """A planner that eats all memory."""

    def plan(self, problem: Problem) -> JointPath:  # noqa: ARG002 - the protocol's
        """Fill pages for ever."""
        eaten = []
        while True:
            eaten.append(np.ones(4 << 20))


class DyingPlanner:
    """A planner that takes its process with it."""

    def plan(self, problem: Problem) -> JointPath:  # noqa: ARG002 - the protocol's
        """End the process as a fault of memory does."""
        os.kill(os.getpid(), signal.SIGSEGV)
        raise AssertionError("still here")


class LeavingPlanner:
    """A planner that calls for the end of the program."""

    def plan(self, problem: Problem) -> JointPath:  # noqa: ARG002 - the protocol's
        """Leave."""
        raise SystemExit(3)


class RubbishPlanner:
    """A planner that returns something that is not a path."""

    def plan(self, problem: Problem) -> JointPath:  # noqa: ARG002 - the protocol's
        """Something else, and words where answers are expected."""
        print("rubbish")  # noqa: T201
        os.write(1, b"\x80\x04rubbish")
        return "rubbish"  # type: ignore[return-value]


class NowherePlanner:
    """A planner that returns a path of no numbers."""

    def plan(self, problem: Problem) -> JointPath:
        """A path to nowhere."""
        control = np.full((4, problem.arm.links), np.nan)
        return JointPath(BSpline(np.repeat([0.0, 1.0], 4), control, 3), control, (), "nowhere")
