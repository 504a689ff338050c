"""``ccm-opt solve``: read a problem, solve it, draw and write the plan, or leave a record of why there is none."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import get_args

from ccm_opt.cli.display_settings import DISPLAY
from ccm_opt.cli.outcome import code_of_simulation, print_result, run_all, warn
from ccm_opt.cli.stage_clock import StageClock, stage_display
from ccm_opt.cli.tables import print_solution
from ccm_opt.errors import Diagnosis, NoPlanFound, ProblemError, VerificationError
from ccm_opt.files.export.folder import check_target, write_failure, write_solution
from ccm_opt.files.problem_file import load_problem
from ccm_opt.problem import MethodName, Problem
from ccm_opt.solution import Solution
from ccm_opt.user_terms.references import load_terms
from ccm_opt.user_terms.terms import Constraint, Cost

METHODS: tuple[MethodName, ...] = get_args(MethodName)
"""What ``--method`` accepts."""


@dataclass(frozen=True)
class TermReferences:
    """User constraints and costs named on the command line.

    Attributes:
        constraints: each ``module:function`` or ``file.py:function``.
        costs: likewise.
    """

    constraints: tuple[str, ...] = ()
    costs: tuple[str, ...] = ()


NO_TERMS = TermReferences()


def solve_files(
    files: Sequence[Path],
    out: Path,
    method: str | None,
    terms: TermReferences = NO_TERMS,
    *,
    pictures: bool,
    explain: bool = True,
) -> int:
    """Solve every file; all are tried.

    Args:
        files: problem files.
        out: directory of the output folders.
        method: planner asked for on the command line, or None.
        terms: user constraints and costs.
        pictures: whether to draw.
        explain: whether a problem without a plan is explained in the time that is left.

    Returns:
        The exit code.
    """
    taken: dict[str, Path] = {}

    def solve_one(file: Path) -> int:
        asked = _known_method(method)
        problem = load_problem(file)
        if asked is not None:
            problem = replace(problem, planner=replace(problem.planner, method=asked))
        # Folders are named after problems, so that a second problem of the same name would replace the first plan.
        first = taken.setdefault(problem.name, file)
        if first is not file:
            raise ProblemError(f"{file} has the same name '{problem.name}' as {first}; their folders would be one")
        return _solve(problem, out, terms, pictures=pictures, explain=explain)

    return run_all(files, solve_one)


def _known_method(method: str | None) -> MethodName | None:
    """The method asked for on the command line.

    Raises:
        ProblemError: there is none of that name.
    """
    if method is None:
        return None
    for known in METHODS:
        if method == known:
            return known
    raise ProblemError(f"--method {method} is unknown; expected {' or '.join(METHODS)}")


def _solve(problem: Problem, out: Path, terms: TermReferences, *, pictures: bool, explain: bool) -> int:
    check_target(out / problem.name)
    with stage_display(problem.name) as clock:
        solution = _plan_or_record_why_not(problem, out, clock, terms, explain=explain)
        clock("writing")
        folder = write_solution(solution, out, _pictures(solution) if pictures else {})
        clock.finish()
    code = code_of_simulation(problem.name, solution.simulation.verdict)
    _warn_of_tracking(solution)
    return print_result(lambda: print_solution(solution, clock, str(folder)), code)


def _warn_of_tracking(solution: Solution) -> None:
    """Say on stderr that the simulated arm followed the plan from afar only, and what to try."""
    error = solution.simulation.tracking_error
    options = solution.problem.simulation
    if not solution.simulation.verdict.followed or error <= DISPLAY.most_tracking_error:
        return
    gains = "bandwidth" if options.controller == "computed-torque" else "gains"
    warn(
        f"{solution.problem.name}: the simulated arm left the plan by {error:.2g} rad with the {options.controller} "
        f"controller at a step of {options.step:g} s; try a smaller simulation.step or another simulation.{gains}"
    )


def _plan_or_record_why_not(
    problem: Problem, out: Path, clock: StageClock, terms: TermReferences, *, explain: bool
) -> Solution:
    """Run the pipeline; a problem without a plan leaves the record of why in the output folder.

    Raises:
        NoPlanFound: its diagnosis is written to ``solution.json``.
        VerificationError: likewise.
        KeyboardInterrupt: a record with the status ``cancelled`` is written.
    """
    clock("loading")
    from ccm_opt.driver.pipeline import solve  # noqa: PLC0415 - loads casadi and toppra

    if terms != NO_TERMS:
        constraints = load_terms(terms.constraints, Constraint)
        costs = load_terms(terms.costs, Cost)
        solve = partial(solve, constraints=constraints, costs=costs)
    try:
        return solve(problem, progress=clock, explain=explain)
    except NoPlanFound as error:
        write_failure(problem, error.status, error.diagnosis, out, clock.timings)
        raise
    except VerificationError as error:
        diagnosis = Diagnosis("the verifier refuses the plan: " + "; ".join(error.failures), "verification")
        write_failure(problem, "infeasible", diagnosis, out, clock.timings)
        raise
    except KeyboardInterrupt:
        diagnosis = Diagnosis("cancelled by the user", clock.current or "planning")
        write_failure(problem, "cancelled", diagnosis, out, clock.timings)
        raise


def _pictures(solution: Solution) -> Mapping[str, bytes]:
    from ccm_opt.files.plotting.animation import motion_gif  # noqa: PLC0415 - loads matplotlib
    from ccm_opt.files.plotting.plan import plan_png  # noqa: PLC0415
    from ccm_opt.files.report.page import report_html  # noqa: PLC0415

    return {
        "plan.png": plan_png(solution),
        "motion.gif": motion_gif(solution),
        "report.html": report_html(solution).encode(),
    }
