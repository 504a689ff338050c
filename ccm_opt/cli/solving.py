"""The command ``solve``, and the records of problems for which no plan was found.

An earlier plan of the same name is kept if the new result is incomplete, which is then written next to it.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from ccm_opt.cli.cancelling import last_steps_uninterrupted
from ccm_opt.cli.drawing import pareto_pictures, plan_pictures
from ccm_opt.cli.loading import NO_TERMS, NamedProblems, NamedTerms, loaded_terms
from ccm_opt.cli.outcome import WORST_FIRST, print_result, run_all, simulation_exit_code, tour_exit_code, warn
from ccm_opt.cli.output import FigureKind
from ccm_opt.cli.stage_clock import StageClock, ended_when_silent, stage_display
from ccm_opt.cli.surroundings import MORE_MEMORY, is_out_of_memory, no_search_for_cycles
from ccm_opt.cli.tables import print_pareto, print_solution
from ccm_opt.core.errors import CancelledWithPlan, Diagnosis, NoPlanFound, VerificationError
from ccm_opt.io.folder import PARETO_RECORD, RECORD, check_target, solution_files, write_folder
from ccm_opt.io.result_folders import UNFINISHED, pareto_files, sibling_folder, write_failure
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Solution


def failure_recorder(
    problem: Problem, out: Path, clock: StageClock, *, pictures: bool, write: Callable[..., Path] = write_failure
) -> Callable[[str, Diagnosis], None]:
    """Return a function that, given status and diagnosis, writes the record of a problem without a plan.

    Args:
        problem: the problem.
        out: parent folder of the output folders.
        clock: clock with the CPU times of the stages so far.
        pictures: whether to write the HTML report too.
        write: function that writes the record.
    """

    def record(status: str, diagnosis: Diagnosis) -> None:
        # The record comes first: it has to exist even if the page fails.
        folder = write(problem, status, diagnosis, out, clock.timings)
        # After Ctrl-C, nobody should have to wait for a page.
        if pictures and status != "cancelled":
            from ccm_opt.viz.failure_page import failure_html  # noqa: PLC0415 - most need no view

            page = failure_html(problem, status, diagnosis, clock.timings)
            folder = write_failure(problem, status, diagnosis, out, clock.timings, {"report.html": page.encode()})
        report_folder(folder, out / problem.name, "the reason why there is no new one is")

    return record


@contextmanager
def failures_recorded(
    problem: Problem, out: Path, clock: StageClock, *, pictures: bool, write: Callable[..., Path] = write_failure
) -> Iterator[Callable[..., None]]:
    """Write a record when planning inside a ``with`` block fails, or reports no progress for too long.

    Args:
        problem: the problem.
        out: parent folder of the output folders.
        clock: clock with the CPU times of the stages so far.
        pictures: whether to write the HTML report too.
        write: function that writes the record.

    Yields:
        A function that must be called with every progress report.

    Raises:
        NoPlanFound: no plan was found; the record contains the diagnosis.
        VerificationError: the verifier rejects the plan, as the record says.
        KeyboardInterrupt: Ctrl-C was pressed; the record has the status ``cancelled`` and any reason known so far, or
            an existing plan is written.
        MemoryError: memory was exhausted before a reason was known; the record says so. Libraries may report this by
            other types of error.
    """
    record = failure_recorder(problem, out, clock, pictures=pictures, write=write)
    in_short = failure_recorder(problem, out, clock, pictures=False, write=write)
    try:
        with ended_when_silent(problem.name, problem.planner, clock, in_short) as progress:
            yield progress
    except NoPlanFound as error:
        record(error.status, error.diagnosis)
        raise
    except VerificationError as error:
        refused = Diagnosis("the verifier rejects the plan: " + "; ".join(error.failures), "verification")
        record(NoPlanFound.unproved_status, refused)
        raise
    except CancelledWithPlan as cancelled:
        write_unfinished(out / problem.name, solution_files(cancelled.solution))
        raise
    except KeyboardInterrupt:
        record("cancelled", clock.known or Diagnosis("cancelled by the user", clock.current or "planning"))
        raise
    except Exception as error:
        short = is_out_of_memory(error)
        known = clock.known
        if known is None and short:
            known = Diagnosis("out of memory", clock.current or "planning", advice=(MORE_MEMORY,))
        if known is not None:
            # The memory of the failed work is free again by now; if it is too little for a record, the error has to do.
            with suppress(MemoryError):
                in_short(NoPlanFound(known).status, known)
        if clock.known is not None and short:
            advice = (*clock.known.advice, "more memory; it ran out during the search for changes that would help")
            raise NoPlanFound(replace(clock.known, advice=advice)) from error
        raise


def write_unfinished(target: Path, files: Mapping[str, bytes]) -> None:
    """Write a verified plan whose simulation or pictures were interrupted, next to an earlier plan if there is one.

    Args:
        target: output folder of the problem.
        files: contents of the plan's files, by file name.
    """
    folder = write_folder(target, files, beside=partial(sibling_folder, ending=UNFINISHED))
    report_folder(folder, target, "the new one, verified but unfinished, is")


def report_folder(folder: Path, target: Path, what: str) -> None:
    """Print a warning if an earlier result was kept and the new one was written to another folder.

    Args:
        folder: folder that was written.
        target: output folder of the problem, which may hold an earlier result.
        what: second half of the warning, before the path of ``folder``.
    """
    if folder != target:
        warn(f"{target} keeps its earlier result; {what} in {folder}")


def solve_files(files: Sequence[Path], out: Path, changes: Sequence[str] = (), **options: Any) -> int:
    """Solve every problem file, write an output folder for each, and return the exit code.

    Args:
        files: problem files.
        out: parent folder of the output folders.
        changes: overrides of keys of the problem files, each ``key.path=value``.
        options: options of ``solve_problem``.

    Returns:
        The exit code of the worst outcome; after a failure the other files are still tried.
    """
    problems = NamedProblems(files, changes)
    return run_all(files, lambda file: solve_problem(problems.read(file), out, **options))


def solve_problem(
    problem: Problem,
    out: Path,
    *,
    plan_with: Callable[..., Solution] | None = None,
    terms: NamedTerms = NO_TERMS,
    pictures: bool = True,
    figure_format: FigureKind = "png",
    explain: bool = True,
    several: bool = False,
) -> int:
    """Solve a problem, write its output folder, print the result, and return the exit code.

    Of several plans, the recommended one is at the top level of the folder.

    Args:
        problem: the problem.
        out: parent folder of the output folders.
        plan_with: function that plans; None for ``solve``.
        terms: references to the user's constraints and costs.
        pictures: whether to make pictures, film and HTML report.
        figure_format: file format of still pictures.
        explain: whether to search, in the remaining time, for changes that would help if no plan is found.
        several: whether to make several plans, from the fastest to that of maximum clearance.
    """
    target = out / problem.name
    check_target(target)
    with stage_display(problem.name) as clock:
        clock.begin("loading")
        with no_search_for_cycles():
            from ccm_opt.driver.pipeline import solve  # noqa: PLC0415 - loads casadi and toppra
        ways: tuple[Callable[..., Any], ...] = (plan_with or solve, solution_files, plan_pictures, print_solution)
        if several:
            from ccm_opt.driver.pareto import pareto  # noqa: PLC0415 - most want one plan

            ways = (pareto, pareto_files, pareto_pictures, print_pareto)
        plan, files_of, pictures_of, tell = ways
        arguments = loaded_terms(*terms)
        with failures_recorded(problem, out, clock, pictures=pictures) as progress:
            found = plan(problem, progress=progress, explain=explain, **arguments)
        clock.begin("writing")
        files: Mapping[str, bytes] = files_of(found)
        try:
            picture_files: Mapping[str, bytes] = pictures_of(found, figure_format) if pictures else {}
        except BaseException:
            # If drawing fails or is cancelled, the plan is written without pictures before the error is raised again.
            write_unfinished(target, files)
            raise
        last_steps_uninterrupted()
        write_folder(target, {**files, **picture_files})
        clock.finish()
    best = found.best if several else found
    codes = [simulation_exit_code(problem.name, best.simulation.verdict), tour_exit_code(problem.name, best.tour)]
    code = min(codes, key=WORST_FIRST.index)
    return print_result(lambda: tell(found, clock, str(target)), code, lambda: _data(files, target))


def _data(files: Mapping[str, bytes], target: Path) -> dict[str, object]:
    """Return the records of a plan and of any Pareto-optimal plans, without the problem, for JSON output."""
    record: dict[str, object] = json.loads(files[RECORD])
    del record["problem"]
    if PARETO_RECORD in files:
        record["pareto"] = json.loads(files[PARETO_RECORD])
    return {"folder": str(target), **record}
