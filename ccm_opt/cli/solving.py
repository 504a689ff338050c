"""``ccm-opt solve``: read a problem, solve it, draw and write the plan, or leave a record of why there is none."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from ccm_opt.cli.cancelling import last_steps_uninterrupted
from ccm_opt.cli.choices import FigureKind
from ccm_opt.cli.drawing import pareto_pictures, plan_pictures
from ccm_opt.cli.failure_record import failure_recorder, failures_recorded, kept_without_pictures
from ccm_opt.cli.loading import NO_TERMS, NamedProblems, TermReferences, no_search_for_cycles
from ccm_opt.cli.outcome import code_of_simulation, print_result, run_all
from ccm_opt.cli.stage_clock import stage_display
from ccm_opt.cli.tables import print_pareto, print_solution
from ccm_opt.cli.watchdog import ended_when_silent
from ccm_opt.io.folder import PARETO_RECORD, RECORD, check_target, solution_files, write_folder
from ccm_opt.io.pareto_folder import pareto_files
from ccm_opt.problem.space_problem import AnyProblem


@dataclass(frozen=True)
class SolveOptions:
    """What the command line asks for.

    Attributes:
        out: directory of the output folders.
        terms: user constraints and costs.
        changes: keys of the problem files that are set to other values, each ``key.path=value``.
        pictures: whether to draw.
        figure_format: of the still pictures.
        explain: whether a problem without a plan is explained in the time that is left.
        several: whether plans from the fastest to the roomiest are made in place of one.
    """

    out: Path
    terms: TermReferences = NO_TERMS
    changes: tuple[str, ...] = ()
    pictures: bool = True
    figure_format: FigureKind = "png"
    explain: bool = True
    several: bool = False


def with_planner_options(
    changes: Sequence[str], *, method: str | None, time_limit: float | None, seed: int | None
) -> tuple[str, ...]:
    """The changes of a command line, with those of its options that stand for keys of the table ``planner``."""
    options = {"method": method, "time_limit": time_limit, "seed": seed}
    return (*changes, *(f"planner.{key}={value}" for key, value in options.items() if value is not None))


def solve_files(files: Sequence[Path], options: SolveOptions) -> int:
    """Solve every file; all are tried.

    Args:
        files: problem files.
        options: the options.

    Returns:
        The exit code.
    """
    problems = NamedProblems(files, options.changes)

    def solve_one(file: Path) -> int:
        problem = problems.read(file)
        return _solve_several(problem, options) if options.several else _solve(problem, options)

    return run_all(files, solve_one)


def _solve(problem: AnyProblem, options: SolveOptions) -> int:
    target = options.out / problem.name
    check_target(target)
    with stage_display(problem.name) as clock:
        clock.begin("loading")
        with no_search_for_cycles():
            from ccm_opt.driver.pipeline import solve  # noqa: PLC0415 - loads casadi and toppra

        arguments = options.terms.loaded()
        recorded = failures_recorded(problem, options.out, clock, pictures=options.pictures)
        of_silence = failure_recorder(problem, options.out, clock, pictures=False)
        with recorded, ended_when_silent(problem.name, problem.planner, clock, of_silence) as progress:
            solution = solve(problem, progress=progress, explain=options.explain, **arguments)
        clock.begin("writing")
        files = solution_files(solution)
        with kept_without_pictures(target, files):
            drawn = plan_pictures(solution, options.figure_format) if options.pictures else {}
        last_steps_uninterrupted()
        write_folder(target, {**files, **drawn})
        clock.finish()
    code = code_of_simulation(problem.name, solution.simulation.verdict)
    return print_result(lambda: print_solution(solution, clock, str(target)), code, lambda: _data(files, target))


def _solve_several(problem: AnyProblem, options: SolveOptions) -> int:
    """Plans from the fastest to the roomiest, all written, the recommended one in the place of the only one."""
    target = options.out / problem.name
    check_target(target)
    with stage_display(problem.name) as clock:
        clock.begin("loading")
        from ccm_opt.driver.pareto import pareto  # noqa: PLC0415 - loads casadi and toppra

        arguments = options.terms.loaded()
        recorded = failures_recorded(problem, options.out, clock, pictures=options.pictures)
        of_silence = failure_recorder(problem, options.out, clock, pictures=False)
        with recorded, ended_when_silent(problem.name, problem.planner, clock, of_silence) as progress:
            found = pareto(
                problem,
                progress=progress,
                explain=options.explain,
                **arguments,
            )
        clock.begin("writing")
        files = pareto_files(found)
        with kept_without_pictures(target, files):
            drawn = pareto_pictures(found, options.figure_format) if options.pictures else {}
        last_steps_uninterrupted()
        write_folder(target, {**files, **drawn})
        clock.finish()
    code = code_of_simulation(problem.name, found.best.simulation.verdict)
    return print_result(lambda: print_pareto(found, clock, str(target)), code, lambda: _data(files, target))


def _data(files: Mapping[str, bytes], target: Path) -> dict[str, object]:
    """The record of a plan without the problem, and of several plans their trade-off, for programs."""
    record: dict[str, object] = json.loads(files[RECORD])
    del record["problem"]
    if PARETO_RECORD in files:
        record["pareto"] = json.loads(files[PARETO_RECORD])
    return {"folder": str(target), **record}
