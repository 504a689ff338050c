"""What ``ccm-opt solve`` leaves in the output folder of a problem without a plan: the record of why."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ccm_opt.cli.stage_clock import StageClock
from ccm_opt.errors import Diagnosis, NoPlanFound, VerificationError
from ccm_opt.files.export.folder import write_failure
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
        KeyboardInterrupt: a record with the status ``cancelled`` is written.
    """
    try:
        yield
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
