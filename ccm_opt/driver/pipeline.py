"""The driver, in the paper's order: problem, plan, joint trajectory, dynamics, simulation, verification."""

import platform
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version

from ccm_opt.diagnosis.explain import explaining, refuse_impossible
from ccm_opt.diagnosis.recall import Recalling
from ccm_opt.driver.closed_loop import simulate_and_check
from ccm_opt.driver.metrics import metrics
from ccm_opt.driver.verified_plan import default_planner, verified_plan
from ccm_opt.dynamics.runtime.compiled_library import prepare
from ccm_opt.dynamics.simulation.closed_loop_run import check_options
from ccm_opt.planners.protocols import Planner, Retimer
from ccm_opt.problem import Problem
from ccm_opt.solution import Solution
from ccm_opt.stages import Stages
from ccm_opt.user_terms.compiled_terms import compile_terms
from ccm_opt.user_terms.terms import Constraint, Cost

PACKAGES = ("ccm-opt", "casadi", "daqp", "numpy", "piqp", "scipy", "shapely", "toppra")


def solve(
    problem: Problem,
    *,
    progress: Callable[[str], None] | None = None,
    planner: Planner | None = None,
    retimer: Retimer | None = None,
    constraints: Sequence[Constraint] = (),
    costs: Sequence[Cost] = (),
    explain: bool = True,
) -> Solution:
    """Plan, time, simulate and verify a motion.

    Args:
        problem: what to solve.
        progress: called with the name of each stage when it starts.
        planner: another planner; when None the feed planner for an arm on a feed axis, else the curve planner.
        retimer: another way to time the path; the one that the problem names when None.
        constraints: the user's own; another planner is not told of them, but its plan is held against them.
        costs: the user's own; another planner is not told of them.
        explain: whether the time left after a failure is used to tell why, and what change would help.

    Returns:
        A verified solution; there is no unverified one.

    Raises:
        ProblemError: the problem cannot be used as it stands.
        NoPlanFound: with a diagnosis: there is no plan within the limits.
        VerificationError: the verifier refuses the plan; a defect of the planner.
    """
    stages = Stages(progress)
    prepare(problem.arm)
    with stages("dynamics model"):
        check_options(problem.arm, problem.simulation)
        terms = compile_terms(problem.arm, constraints, costs) if constraints or costs else None
    chosen = Recalling(planner or default_planner(problem, stages, terms))

    def again(changed: Problem) -> object:
        own, quiet = None if terms is None else compile_terms(changed.arm, constraints, costs), Stages()
        other = Recalling(planner or default_planner(changed, quiet, own), chosen.paths)
        return verified_plan(changed, other, quiet, retimer, own)

    with explaining(problem, again, stages, wanted=explain):
        with stages("necessary checks"):
            refuse_impossible(problem)
        plan = verified_plan(problem, chosen, stages, retimer, terms)
    with stages("simulation"):
        simulated, of_simulation = simulate_and_check(problem, plan.trajectory, plan.joints)
    figures = metrics(problem, plan.path, plan.trajectory, plan.joints, simulated, plan.checks)
    return Solution(
        problem,
        plan.path,
        plan.trajectory,
        plan.joints,
        simulated,
        (*plan.checks, *plan.user_checks),
        {**figures, **of_simulation, **plan.figures},
        dict(stages.timings),
        versions=versions(),
    )


def versions() -> Mapping[str, str]:
    """Versions of Python and of the packages a result depends on."""
    return {"python": platform.python_version(), **{name: version(name) for name in PACKAGES}}
