"""Problems of ``problems/`` as ``ccm_opt.solve`` solves them, each once a process, for whichever test asks."""

from functools import cache

import ccm_opt
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Solution

from .conftest import PROBLEMS


@cache
def solved(name: str) -> Solution:
    """The plan of a problem in the plane."""
    problem = ccm_opt.load_problem(PROBLEMS / f"{name}.toml")
    assert isinstance(problem, Problem)
    return ccm_opt.solve(problem)


@cache
def solved_in_space(name: str) -> Solution:
    """The plan of a problem in space."""
    problem = ccm_opt.load_problem(PROBLEMS / "space" / f"{name}.toml")
    assert problem.dimension == 3
    return ccm_opt.solve(problem)
