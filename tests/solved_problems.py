"""Solutions of the problem files in ``problems/``, each computed once per process and shared by tests."""

from functools import cache

import ccm_opt
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Solution

from .conftest import PROBLEMS


@cache
def solved(name: str) -> Solution:
    """Return the solution of a planar problem by name."""
    problem = ccm_opt.load_problem(PROBLEMS / f"{name}.toml")
    assert isinstance(problem, Problem)
    return ccm_opt.solve(problem)


@cache
def solved_in_space(name: str) -> Solution:
    """Return the solution of a problem in space by name."""
    problem = ccm_opt.load_problem(PROBLEMS / "space" / f"{name}.toml")
    assert problem.dimension == 3
    return ccm_opt.solve(problem)
