"""ccm_opt: planning, certification, timing and simulation of motions of highly redundant manipulators.

Public names are imported on first use, which keeps ``import ccm_opt`` fast::

    problem = ccm_opt.load_problem("problems/swan-neck.toml")  # or ccm_opt.make_problem(...)
    solution = ccm_opt.solve(problem)
    checks = ccm_opt.check(problem, solution.trajectory, solution.joints)
"""

from importlib import import_module

TYPE_CHECKING = False  # importing typing would take longer than everything else in this module
if TYPE_CHECKING:
    from ccm_opt import viz as plotting
    from ccm_opt.core import errors
    from ccm_opt.core.errors import CcmError, NoPlanFound, ProblemError, VerificationError
    from ccm_opt.core.progress import Progress
    from ccm_opt.driver.finding_pose import find_pose
    from ccm_opt.driver.live_plan import LivePlan
    from ccm_opt.driver.pareto import pareto
    from ccm_opt.driver.pipeline import solve
    from ccm_opt.driver.planning_run import BuiltInPlanner, BuiltInRetimer, Planner, Retimer
    from ccm_opt.driver.reach_mapping import reach_map
    from ccm_opt.driver.retargeting import retarget
    from ccm_opt.driver.robustness import tolerance_of
    from ccm_opt.driver.saved_solution import load
    from ccm_opt.driver.servo import Servo, Twist
    from ccm_opt.driver.settings import Settings
    from ccm_opt.driver.sizing import size, size_front
    from ccm_opt.ik.quantities import Quantities
    from ccm_opt.ik.terms import Constraint, Cost, Interval, constraint, cost
    from ccm_opt.io.problem_parts import make_problem
    from ccm_opt.io.reading import load_problem
    from ccm_opt.problem import (
        Arm,
        JointPose,
        Limits,
        Obstacle,
        PlaneShape,
        PlannerOptions,
        Problem,
        Stop,
        TipGoal,
        Workspace,
        obstacles_of,
    )
    from ccm_opt.problem.solution import JointPath, Solution
    from ccm_opt.verification.verifier import verify as check
    from ccm_opt.viz.saved_plans import animate, plot, report, save

__version__ = "0.1.0"

__all__ = [
    "Arm",
    "BuiltInPlanner",
    "BuiltInRetimer",
    "CcmError",
    "Constraint",
    "Cost",
    "Interval",
    "JointPath",
    "JointPose",
    "Limits",
    "LivePlan",
    "NoPlanFound",
    "Obstacle",
    "PlaneShape",
    "Planner",
    "PlannerOptions",
    "Problem",
    "ProblemError",
    "Progress",
    "Quantities",
    "Retimer",
    "Servo",
    "Settings",
    "Solution",
    "Stop",
    "TipGoal",
    "Twist",
    "VerificationError",
    "Workspace",
    "__version__",
    "animate",
    "check",
    "constraint",
    "cost",
    "errors",
    "find_pose",
    "load",
    "load_problem",
    "make_problem",
    "obstacles_of",
    "pareto",
    "plot",
    "plotting",
    "reach_map",
    "report",
    "retarget",
    "save",
    "size",
    "size_front",
    "solve",
    "tolerance_of",
]

_NAMES = {
    "ccm_opt.driver.planning_run": ("BuiltInPlanner", "BuiltInRetimer", "Planner", "Retimer"),
    "ccm_opt.driver.finding_pose": ("find_pose",),
    "ccm_opt.driver.live_plan": ("LivePlan",),
    "ccm_opt.driver.pareto": ("pareto",),
    "ccm_opt.driver.pipeline": ("solve",),
    "ccm_opt.driver.reach_mapping": ("reach_map",),
    "ccm_opt.driver.retargeting": ("retarget",),
    "ccm_opt.driver.saved_solution": ("load",),
    "ccm_opt.driver.servo": ("Servo", "Twist"),
    "ccm_opt.driver.settings": ("Settings",),
    "ccm_opt.driver.robustness": ("tolerance_of",),
    "ccm_opt.driver.sizing": ("size", "size_front"),
    "ccm_opt.core.errors": ("CcmError", "NoPlanFound", "ProblemError", "VerificationError"),
    "ccm_opt.io.reading": ("load_problem",),
    "ccm_opt.io.problem_parts": ("make_problem",),
    "ccm_opt.viz.saved_plans": ("animate", "plot", "report", "save"),
    "ccm_opt.core.progress": ("Progress",),
    "ccm_opt.problem": (
        *("Arm", "JointPose", "Limits", "Obstacle", "PlaneShape", "PlannerOptions", "Problem", "Stop", "TipGoal"),
        *("Workspace", "obstacles_of"),
    ),
    "ccm_opt.problem.solution": ("JointPath", "Solution"),
    "ccm_opt.ik.quantities": ("Quantities",),
    "ccm_opt.ik.terms": ("Constraint", "Cost", "Interval", "constraint", "cost"),
}
"""Public names, by the module that defines them under equal names."""
_HOMES = {name: (module, name) for module, names in _NAMES.items() for name in names}
_HOMES["check"] = ("ccm_opt.verification.verifier", "verify")
"""Defining module, and name in that module, of each public object."""
_MODULES = {"errors": "ccm_opt.core.errors", "plotting": "ccm_opt.viz"}
"""Public modules, by their public name."""


_MAKING_SOLUTIONS = frozenset(
    ("LivePlan", "Servo", "Solution", "load", "pareto", "retarget", "size", "size_front", "solve")
)
"""Public names through which a caller can obtain a ``Solution``."""


def __getattr__(name: str) -> object:
    """Return a public object, importing the module that defines it on first use.

    Raises:
        AttributeError: the package has no such name.
    """
    if name in _MODULES:
        return import_module(_MODULES[name])
    if name not in _HOMES:
        raise AttributeError(f"module 'ccm_opt' has no attribute {name!r}; it has {', '.join(__all__)}")
    if name in _MAKING_SOLUTIONS:
        import_module("ccm_opt.viz.saved_plans")  # registers the presenter behind Solution.plot, .animate and .save
    module, attribute = _HOMES[name]
    value = getattr(import_module(module), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
