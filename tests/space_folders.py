"""A plan in space that is solved once with a given path, for tests of output folders."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from ccm_opt.driver.pipeline import solve
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import JointPath, Solution

from .retiming_paths import make_path
from .space_plans import true_plan


@dataclass(frozen=True)
class GivenWay:
    """Planner that returns a given path for every problem."""

    path: JointPath

    def plan(self, problem: Problem) -> JointPath:
        """Return the given path."""
        del problem
        return self.path


@cache
def solved() -> Solution:
    """Return the solution of the problem of ``true_plan`` by a joint path through samples of its motion."""
    plan = true_plan()
    samples = plan.trajectory.positions
    moved = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(samples, axis=0), axis=1))))
    even = np.searchsorted(moved, np.linspace(0.0, moved[-1], 60))
    return solve(plan.problem, planner=GivenWay(make_path(samples[even])))
