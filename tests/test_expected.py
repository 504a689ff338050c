"""What is no problem, solution, goal or list of terms is refused as bad input, with what was given and what to do."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

import ccm_opt
from ccm_opt.core.errors import ProblemError

from .conftest import PROBLEMS
from .solved_problems import solved

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
    solution = solved("open-space")
    problem = solution.problem
    with pytest.raises(ProblemError, match=r"expected a ccm_opt\.Problem, got None"):
        ccm_opt.check(None, solution.trajectory, solution.joints)  # type: ignore[arg-type]
    with pytest.raises(ProblemError, match="expected the path of a problem file, got None"):
        ccm_opt.load_problem(None)  # type: ignore[arg-type]
    with pytest.raises(ProblemError, match=r"expected a ccm_opt\.Solution, got Problem <"):
        ccm_opt.tolerance_of(problem)  # type: ignore[arg-type]
    with pytest.raises(ProblemError, match=r"expected a goal, got .*TipGoal.at\(position\)"):
        ccm_opt.retarget(solution, 0.1, np.array([0.1, 0.2]))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def solution() -> ccm_opt.Solution:
    """A plan, for functions that go on from one."""
    return solved("open-space")


SOLUTION = object()
"""Stands for that plan among arguments."""
WRONG = (None, True, "text", 3.5, [1], {"a": 1}, object, lambda: 0)
"""Values of kinds that no argument below is made for, but for those that are left out."""
SOUND: list[tuple[str, dict[str, Any]]] = [
    ("solve", {"problem": FILE}),
    ("find_pose", {"problem": FILE}),
    ("pareto", {"problem": FILE}),
    ("reach_map", {"problem": FILE}),
    ("size", {"problem": FILE, "find": "radius"}),
    ("size_front", {"problem": FILE}),
    ("LivePlan", {"problem": FILE}),
    ("Servo", {"problem": FILE}),
    ("retarget", {"solution": SOLUTION, "time": 0.1, "goal": ccm_opt.TipGoal.at((0.1, 0.3))}),
    ("tolerance_of", {"solution": SOLUTION}),
    ("check", {"problem": FILE, "trajectory": SOLUTION, "joints": SOLUTION}),
    ("save", {"solution": SOLUTION, "folder": "nowhere"}),
    ("plot", {"plan": SOLUTION}),
    ("animate", {"plan": SOLUTION, "file": "film.gif"}),
    ("report", {"plan": SOLUTION, "file": "report.html"}),
    ("load", {"folder": "nowhere"}),
    ("load_problem", {"path": FILE}),
    ("Interval", {"first": 0.0, "last": 1.0}),
    ("Constraint", {"name": "mine", "expression": lambda q: q.tip[0], "lower": 0.0}),
    ("Cost", {"name": "mine", "expression": lambda q: q.tip[0]}),
    ("Settings", {}),
    ("BuiltInPlanner", {}),
    ("BuiltInRetimer", {}),
    ("Problem", {"name": "mine", "workspace": FILE, "arm": FILE, "limits": FILE, "start": FILE, "goal": FILE}),
]
"""Public callables with arguments that they take."""
WRONG_ARGUMENTS: list[tuple[str, str, Sequence[Any]]] = [
    *((name, "problem", WRONG) for name in ("solve", "find_pose", "pareto", "reach_map", "LivePlan", "Servo", "check")),
    *((name, part, WRONG[1:6]) for name in ("size", "size_front") for part in ("progress", "settings")),
    *((name, "problem", WRONG) for name in ("size", "size_front")),
    *((name, "time_limit", (True, "text", [1], -1.0)) for name in ("size", "size_front")),
    *((name, "workers", (None, True, "text", [1], 0)) for name in ("size", "size_front")),
    *(("size", "find", (None, True, "text", 3.5)), ("size", "places", (True, "text", 3.5, {"a": 1}))),
    *((name, "progress", WRONG[1:6]) for name in ("solve", "find_pose", "pareto", "reach_map", "retarget")),
    *(
        (name, "settings", WRONG[1:])
        for name in ("solve", "find_pose", "pareto", "reach_map", "LivePlan", "retarget", "tolerance_of", "check")
    ),
    *(
        ("Servo", name, values)
        for name, values in (("settings", (*WRONG[1:], None)), ("period", (None, True, "text", [1], 0.0, 1.0)))
    ),
    *(("BuiltInPlanner", "settings", WRONG[1:]), ("BuiltInRetimer", "settings", WRONG[1:])),
    *((name, "planner", WRONG[1:]) for name in ("solve", "retarget")),
    *(
        (name, terms, (*WRONG[:4], *WRONG[5:]))
        for name in ("solve", "find_pose", "pareto", "LivePlan", "retarget")
        for terms in ("constraints", "costs")
    ),
    *((name, "explain", (None, "yes", 1)) for name in ("solve", "pareto")),
    ("solve", "retimer", WRONG[1:]),
    ("pareto", "trade_off", WRONG),
    *(("reach_map", name, (True, "text", [1], {"a": 1})) for name in ("step", "headings", "workers")),
    *((name, "solution", WRONG) for name in ("retarget", "tolerance_of", "save")),
    *((name, "plan", WRONG) for name in ("plot", "animate", "report")),
    *((name, where, (None, True, 3.5, [1])) for name, where in (("save", "folder"), ("load", "folder"))),
    *((name, "file", (None, True, 3.5, [1])) for name in ("animate", "report")),
    ("load_problem", "path", (None, True, 3.5, [1])),
    ("load_problem", "changes", (None, True, "arm.radius=1", 3.5, [1])),
    ("retarget", "time", (None, True, "soon", [1])),
    ("retarget", "goal", WRONG),
    ("retarget", "tolerances", WRONG[1:]),
    ("tolerance_of", "simulated", (None, "yes", 1)),
    *(("check", name, WRONG) for name in ("trajectory", "joints")),
    *(("Interval", name, (None, True, "text", [1])) for name in ("first", "last")),
    *((name, "name", (None, True, 3.5, "")) for name in ("Constraint", "Cost")),
    *((name, "expression", WRONG[:6]) for name in ("Constraint", "Cost")),
    *((name, "weight", (None, True, "heavy", [1], -1.0)) for name in ("Constraint", "Cost")),
    *((name, "where", (None, True, "nowhere", 3.5, [1])) for name in ("Constraint", "Cost")),
    *(("Constraint", name, (None, True, "text", {"a": 1})) for name in ("lower", "upper")),
    ("Constraint", "soft", (None, "yes", 1)),
    *(("Settings", name, WRONG) for name in ("curve", "timing", "verification", "diagnosis")),
    *(
        ("Problem", part, WRONG[:7])
        for part in ("workspace", "arm", "limits", "start", "goal", "tolerances", "planner")
    ),
    *(("Problem", part, (*WRONG[:2], *WRONG[3:])) for part in ("name", "description", "source")),
    *(("Problem", part, (None, "text", [1])) for part in ("joint_error", "stops", "verification", "simulation")),
]
"""Callable, argument, and values of wrong kinds for it."""


def as_meant(name: str, given: object, solution: ccm_opt.Solution) -> object:
    """The argument that a stand-in stands for."""
    if given is FILE and name != "path":
        return solution.problem if name == "problem" else getattr(solution.problem, name)
    if given is SOLUTION:
        return getattr(solution, name, solution)
    return given


@pytest.mark.parametrize(("function", "argument", "values"), WRONG_ARGUMENTS, ids=lambda each: str(each)[:20])
def test_arguments_of_a_wrong_kind_are_refused_in_words(
    function: str, argument: str, values: Sequence[Any], solution: ccm_opt.Solution
) -> None:
    """Every one ends in an error of this package that says what was expected or needed, and what was given."""
    sound = {name: as_meant(name, given, solution) for name, given in dict(SOUND)[function].items()}
    for value in values:
        with pytest.raises(ccm_opt.CcmError, match=r"expected|must|needs|problem\(s\)"):
            getattr(ccm_opt, function)(**(sound | {argument: value}))


def test_every_public_callable_is_asked() -> None:
    """A new public function gets a row above, unless it makes results or is tested beside what it makes."""
    asked = {function for function, _ in SOUND}
    results = {"Progress", "Quantities", "Solution", "JointPath", "JointPose", "TipGoal"}
    data = {
        "Arm",
        "Limits",
        "Obstacle",
        "PlaneShape",
        "PlannerOptions",
        "Stop",
        "Workspace",
        "Planner",
        "Retimer",
        "Twist",
    }
    elsewhere = {
        "make_problem",
        "obstacles_of",
        "constraint",
        "cost",
        "CcmError",
        "NoPlanFound",
        "ProblemError",
    }
    modules = {"errors", "plotting", "__version__", "VerificationError"}
    assert set(ccm_opt.__all__) == asked | results | data | elsewhere | modules


@pytest.mark.parametrize("move", [{"position": "here"}, {"position": [1]}, {"direction": "up"}, {"direction": True}])
def test_a_live_plan_refuses_what_is_no_place(move: dict[str, Any], solution: ccm_opt.Solution) -> None:
    """Neither a text nor a boolean moves a goal, and the plan stays."""
    live = ccm_opt.LivePlan(solution.problem)
    with pytest.raises(ccm_opt.ProblemError, match="expected a"):
        live.move_goal(**move)
    with pytest.raises(ccm_opt.ProblemError, match="name of an obstacle"):
        live.move_obstacle(3, (0.1, 0.1))  # type: ignore[arg-type]
    with pytest.raises(ccm_opt.ProblemError, match="time limit above 0"):
        live.plan_anew(-1.0)
    assert live.current
