"""What ``ccm-opt solve`` leaves where something fails: the record of why there is no plan, or else the plan."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from ccm_opt.cli.stage_clock import StageClock
from ccm_opt.errors import CancelledWithPlan, Diagnosis, NoPlanFound, VerificationError
from ccm_opt.files.export.folder import write_failure, write_solution
from ccm_opt.problem import Problem


@contextmanager
def failures_recorded(problem: Problem, out: Path, clock: StageClock) -> Iterator[None]:
    """Plan inside it; a problem without a plan leaves the record of why in the output folder.

    Args:
        problem: what is solved.
        out: directory of the output folders.
        clock: knows the stages so far.

    Raises:
        NoPlanFound: its diagnosis is written to ``solution.json``.
        VerificationError: likewise.
        KeyboardInterrupt: a record with the status ``cancelled`` is written, or the plan where there is one already.
    """
    try:
        yield
    except NoPlanFound as error:
        write_failure(problem, error.status, error.diagnosis, out, clock.timings)
        raise
    except VerificationError as error:
        diagnosis = Diagnosis("the verifier refuses the plan: " + "; ".join(error.failures), "verification")
        write_failure(problem, NoPlanFound.unproved_status, diagnosis, out, clock.timings)
        raise
    except CancelledWithPlan as cancelled:
        write_solution(cancelled.solution, out)
        raise
    except KeyboardInterrupt:
        diagnosis = Diagnosis("cancelled by the user", clock.current or "planning")
        write_failure(problem, "cancelled", diagnosis, out, clock.timings)
        raise


@contextmanager
def kept_without_pictures(write: Callable[[], object]) -> Iterator[None]:
    """Draw inside it; a plan whose drawing fails or is cancelled is written without pictures before the error goes on.

    Args:
        write: writes the plan alone.
    """
    try:
        yield
    except BaseException:
        write()
        raise
