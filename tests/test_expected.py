"""What is no problem, solution, goal or list of terms is refused as bad input, with what was given and what to do."""

from collections.abc import Callable

import numpy as np
import pytest

import ccm_opt
from ccm_opt.errors import ProblemError

from .conftest import PROBLEMS

FILE = PROBLEMS / "open-space.toml"


def keeps(expression: Callable[[ccm_opt.Quantities], object]) -> ccm_opt.Constraint:
    """A constraint of an expression."""
    return ccm_opt.Constraint("mine", expression, lower=0.0)


@pytest.mark.parametrize("given", ["problems/x.toml", None, [1], True])
@pytest.mark.parametrize(
    "function", [ccm_opt.solve, ccm_opt.find_pose, ccm_opt.pareto, ccm_opt.reach_map, ccm_opt.LivePlan]
)
def test_what_is_no_problem_is_refused(function: Callable[[object], object], given: object) -> None:
    """The message names what was given and how a problem is had."""
    with pytest.raises(ProblemError, match=r"expected a ccm_opt\.Problem, got .*; ccm_opt\.load_problem reads one"):
        function(given)


@pytest.mark.parametrize(
    ("terms", "words"),
    [
        (True, "expected a list of constraints, got bool True"),
        (keeps(lambda q: q.tip[0]), r"expected a list of constraints, got .*write constraints=\[mine\]"),
        ([None], "expected a Constraint, got None"),
        ([keeps(lambda _: True)], "expected a number, got a comparison"),
        ([keeps(lambda q: q.tip[0] > -5.0)], "bound it by lower= and upper="),
    ],
)
def test_what_are_no_constraints_is_refused(terms: object, words: str) -> None:
    """A bare constraint, a boolean, and an expression that is true or false."""
    with pytest.raises(ProblemError, match=words):
        ccm_opt.solve(ccm_opt.load_problem(FILE), constraints=terms)  # type: ignore[arg-type]


def test_other_functions_refuse_what_they_are_not_made_for() -> None:
    """The verifier, the reader of files, and those that go on from a solution."""
    problem = ccm_opt.load_problem(FILE)
    solution = ccm_opt.solve(problem)
    with pytest.raises(ProblemError, match=r"expected a ccm_opt\.Problem, got None"):
        ccm_opt.check(None, solution.trajectory, solution.joints)  # type: ignore[arg-type]
    with pytest.raises(ProblemError, match="expected the path of a problem file, got None"):
        ccm_opt.load_problem(None)  # type: ignore[arg-type]
    with pytest.raises(ProblemError, match=r"expected a ccm_opt\.Solution, got Problem <"):
        ccm_opt.tolerance_of(problem)  # type: ignore[arg-type]
    with pytest.raises(ProblemError, match=r"expected a goal, got .*TipGoal\(position, heading\)"):
        ccm_opt.retarget(solution, 0.1, np.array([0.1, 0.2]))  # type: ignore[arg-type]
