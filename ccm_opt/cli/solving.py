"""``ccm-opt solve``: read a problem, solve it, draw and write the plan, or leave a record of why there is none."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import get_args

from ccm_opt.cli.cancelling import last_steps_uninterrupted
from ccm_opt.cli.failure_record import failures_recorded, kept_without_pictures
from ccm_opt.cli.named_problems import NamedProblems
from ccm_opt.cli.outcome import code_of_simulation, print_result, run_all
from ccm_opt.cli.pareto_table import print_pareto
from ccm_opt.cli.stage_clock import stage_display
from ccm_opt.cli.tables import print_solution
from ccm_opt.cli.term_references import NO_TERMS, TermReferences
from ccm_opt.errors import ProblemError
from ccm_opt.files.export.folder import check_target, solution_files, write_folder
from ccm_opt.files.export.pareto_folder import pareto_files
from ccm_opt.problem import MethodName, Problem
from ccm_opt.solution import ParetoPlans, Solution

METHODS: tuple[MethodName, ...] = get_args(MethodName)
"""What ``--method`` accepts."""


def solve_files(
    files: Sequence[Path],
    out: Path,
    method: str | None,
    terms: TermReferences = NO_TERMS,
    *,
    pictures: bool,
    explain: bool = True,
    several: bool = False,
) -> int:
    """Solve every file; all are tried.

    Args:
        files: problem files.
        out: directory of the output folders.
        method: planner asked for on the command line, or None.
        terms: user constraints and costs.
        pictures: whether to draw.
        explain: whether a problem without a plan is explained in the time that is left.
        several: whether plans from the fastest to the roomiest are made in place of one.

    Returns:
        The exit code.
    """
    problems = NamedProblems()

    def solve_one(file: Path) -> int:
        asked = _known_method(method)
        problem = problems.read(file)
        if asked is not None:
            problem = replace(problem, planner=replace(problem.planner, method=asked))
        solve = _solve_several if several else _solve
        return solve(problem, out, terms, pictures=pictures, explain=explain)

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
    target = out / problem.name
    check_target(target)
    with stage_display(problem.name) as clock:
        clock("loading")
        from ccm_opt.driver.pipeline import solve  # noqa: PLC0415 - loads casadi and toppra

        arguments = terms.loaded()
        with failures_recorded(problem, out, clock):
            solution = solve(problem, progress=clock, explain=explain, **arguments)
        clock("writing")
        files = solution_files(solution)
        with kept_without_pictures(target, files):
            drawn = _pictures(solution) if pictures else {}
        last_steps_uninterrupted()
        write_folder(target, {**files, **drawn})
        clock.finish()
    code = code_of_simulation(problem.name, solution.simulation.verdict)
    return print_result(lambda: print_solution(solution, clock, str(target)), code)


def _solve_several(problem: Problem, out: Path, terms: TermReferences, *, pictures: bool, explain: bool) -> int:
    """Plans from the fastest to the roomiest, all written, the recommended one in the place of the only one."""
    target = out / problem.name
    check_target(target)
    with stage_display(problem.name) as clock:
        clock("loading")
        from ccm_opt.driver.pareto import pareto  # noqa: PLC0415 - loads casadi and toppra

        arguments = terms.loaded()
        with failures_recorded(problem, out, clock):
            found = pareto(
                problem,
                progress=lambda stage: clock(stage.partition(":")[0]),
                explain=explain,
                **arguments,
            )
        clock("writing")
        files = pareto_files(found)
        with kept_without_pictures(target, files):
            drawn = _pareto_pictures(found) if pictures else {}
        last_steps_uninterrupted()
        write_folder(target, {**files, **drawn})
        clock.finish()
    code = code_of_simulation(problem.name, found.best.simulation.verdict)
    return print_result(lambda: print_pareto(found, clock, str(target)), code)


def _pictures(solution: Solution) -> Mapping[str, bytes]:
    from ccm_opt.files.plotting.animation import motion_gif  # noqa: PLC0415 - loads matplotlib
    from ccm_opt.files.plotting.plan import plan_png  # noqa: PLC0415
    from ccm_opt.files.report.page import report_html  # noqa: PLC0415

    return {
        "plan.png": plan_png(solution),
        "motion.gif": motion_gif(solution),
        "report.html": report_html(solution).encode(),
    }


def _pareto_pictures(found: ParetoPlans) -> Mapping[str, bytes]:
    from ccm_opt.files.plotting.pareto_picture import pareto_png  # noqa: PLC0415 - loads matplotlib

    return {**_pictures(found.best), "pareto.png": pareto_png(found)}
