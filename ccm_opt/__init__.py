"""ccm_opt: certified, timed and simulated motions of highly redundant manipulators.

The names below are loaded when they are first used, so that importing the package is cheap::

    problem = ccm_opt.load_problem("problems/swan-neck.toml")
    solution = ccm_opt.solve(problem)
    checks = ccm_opt.check(problem, solution.trajectory, solution.joints)
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ccm_opt import errors
    from ccm_opt.driver.finding_pose import find_pose
    from ccm_opt.driver.live_plan import LivePlan
    from ccm_opt.driver.pareto import pareto
    from ccm_opt.driver.pipeline import solve
    from ccm_opt.driver.reach_mapping import reach_map
    from ccm_opt.driver.retargeting import retarget
    from ccm_opt.driver.solve_settings import Settings
    from ccm_opt.driver.surviving import tolerance_of
    from ccm_opt.files.problem_file import load_problem
    from ccm_opt.files.saved_plans import SavedPlan, animate, load, plot, save
    from ccm_opt.ground.progress import Progress
    from ccm_opt.problem import Problem
    from ccm_opt.solution import Solution
    from ccm_opt.user_terms.quantities import Quantities
    from ccm_opt.user_terms.terms import Constraint, Cost, Interval, constraint, cost
    from ccm_opt.verification import verify as check

__version__ = "0.1.0"

__all__ = [
    "Constraint",
    "Cost",
    "Interval",
    "LivePlan",
    "Problem",
    "Progress",
    "Quantities",
    "SavedPlan",
    "Settings",
    "Solution",
    "__version__",
    "animate",
    "check",
    "constraint",
    "cost",
    "errors",
    "find_pose",
    "load",
    "load_problem",
    "pareto",
    "plot",
    "reach_map",
    "retarget",
    "save",
    "solve",
    "tolerance_of",
]

_HOMES = {
    "save": ("ccm_opt.files.saved_plans", "save"),
    "plot": ("ccm_opt.files.saved_plans", "plot"),
    "load": ("ccm_opt.files.saved_plans", "load"),
    "animate": ("ccm_opt.files.saved_plans", "animate"),
    "SavedPlan": ("ccm_opt.files.saved_plans", "SavedPlan"),
    "Constraint": ("ccm_opt.user_terms.terms", "Constraint"),
    "Cost": ("ccm_opt.user_terms.terms", "Cost"),
    "Interval": ("ccm_opt.user_terms.terms", "Interval"),
    "Quantities": ("ccm_opt.user_terms.quantities", "Quantities"),
    "constraint": ("ccm_opt.user_terms.terms", "constraint"),
    "cost": ("ccm_opt.user_terms.terms", "cost"),
    "LivePlan": ("ccm_opt.driver.live_plan", "LivePlan"),
    "Problem": ("ccm_opt.problem", "Problem"),
    "Progress": ("ccm_opt.ground.progress", "Progress"),
    "Settings": ("ccm_opt.driver.solve_settings", "Settings"),
    "Solution": ("ccm_opt.solution", "Solution"),
    "check": ("ccm_opt.verification", "verify"),
    "find_pose": ("ccm_opt.driver.finding_pose", "find_pose"),
    "load_problem": ("ccm_opt.files.problem_file", "load_problem"),
    "pareto": ("ccm_opt.driver.pareto", "pareto"),
    "reach_map": ("ccm_opt.driver.reach_mapping", "reach_map"),
    "retarget": ("ccm_opt.driver.retargeting", "retarget"),
    "solve": ("ccm_opt.driver.pipeline", "solve"),
    "tolerance_of": ("ccm_opt.driver.surviving", "tolerance_of"),
}
"""Module and name of each public object."""


_MAKING_SOLUTIONS = frozenset(("LivePlan", "Solution", "pareto", "retarget", "solve"))
"""Names by which one comes by solutions."""


def __getattr__(name: str) -> object:
    """Load a public name when it is first used."""
    if name == "errors":
        return import_module("ccm_opt.errors")
    if name not in _HOMES:
        raise AttributeError(f"module 'ccm_opt' has no attribute {name!r}; it has {', '.join(__all__)}")
    if name in _MAKING_SOLUTIONS:
        import_module("ccm_opt.files.saved_plans")  # which lets solutions draw and save themselves
    module, attribute = _HOMES[name]
    value = getattr(import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
