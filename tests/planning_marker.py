"""Which tests plan: those whose code, or that of their fixtures, names what plans.

``python -m pytest -m "not planning"`` leaves these out. Code is read and not run: a test plans when it or a function of
these tests that it names holds a name of ``PLANNERS`` or a command of ``COMMANDS``. A test that plans where this is not
seen is marked by hand, and so is one that takes a second without planning.
"""

from collections.abc import Iterator
from functools import cache
from types import CodeType, FunctionType

import pytest

PLANNERS = frozenset(
    """
    solve find_pose pareto retarget reach_map LivePlan Servo tolerance_of simulate
    MotionPlanner plan plan_legs find_motion find_by_ways optimise CurveDraws
    GoalPoses poses_at_goal goal_poses solve_files
    compare compare_methods run_apart RunProcess completed execute with_constraint_first
    by_walks by_candidates connected straight FollowSearch runpy
    subprocess dask_cluster Process
    """.split()  # noqa: SIM905 - legible
)
"""What plans, simulates, solves a program or runs a process."""

COMMANDS = frozenset(("solve", "pose", "reach", "pareto", "simulate", "compare"))
"""Those of the command line that plan."""


def plans(item: pytest.Item) -> bool:
    """Tell whether a test, one of its fixtures or of its parameters plans."""
    if not isinstance(item, pytest.Function):
        return False
    fixtures = item._fixtureinfo.name2fixturedefs.values()
    given = item.callspec.params.values() if hasattr(item, "callspec") else ()
    roots = [item.function, *(one.func for found in fixtures for one in found), *given]
    return any(_plans(root, frozenset()) for root in roots)


def _plans(root: object, above: frozenset[int]) -> bool:
    """Whether a function or class of these tests, or what a sequence holds, plans."""
    if isinstance(root, str):
        return root in COMMANDS
    if isinstance(root, tuple | list):
        return any(_plans(one, above) for one in root)
    if isinstance(root, type):
        return root.__module__.startswith("tests.") and any(_plans(one, above) for one in vars(root).values())
    for inner in ("hypothesis", "inner_test", "func", "fget", "__func__", "__wrapped__"):
        root = getattr(root, inner, root)
    if not isinstance(root, FunctionType) or not root.__module__.startswith("tests.") or id(root) in above:
        return False
    names, texts = _words(root.__code__)
    if "stand_in" in names or names & PLANNERS or texts & COMMANDS:
        return "stand_in" not in names  # in the place of what plans
    return any(_plans(root.__globals__.get(name), above | {id(root)}) for name in names)


@cache
def _words(code: CodeType) -> tuple[frozenset[str], frozenset[str]]:
    """Names and strings of a function, and of those within it."""
    names, texts = set(code.co_names), set()
    for constant in _flat(code.co_consts):
        if isinstance(constant, str):
            texts.add(constant)
        elif isinstance(constant, CodeType):
            further = _words(constant)
            names |= further[0]
            texts |= further[1]
    return frozenset(names), frozenset(texts)


def _flat(constants: tuple[object, ...]) -> Iterator[object]:
    for constant in constants:
        if isinstance(constant, tuple):
            yield from _flat(constant)
        else:
            yield constant
