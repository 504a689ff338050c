"""The command line of ccm_opt: ``main`` is the entry point, ``commands`` defines every command and option.

Only modules that Python has already loaded are imported before ``main`` starts to handle Ctrl-C.
"""

import os
import sys

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables for the number of threads of linear algebra libraries, which read them on import; small
matrices are faster on one thread."""

OBJECTS_BETWEEN_COLLECTIONS = 20_000
"""Number of new objects that triggers a garbage collection; at Python's default of 700, collecting costs more time."""


def main() -> None:
    """Run the program ``ccm-opt``; Ctrl-C ends it with exit code 130, even while modules are being imported."""
    try:
        _run()
    except KeyboardInterrupt:
        from ccm_opt.cli.cancelling import leave_at_once, report_cancelled  # noqa: PLC0415 - see above

        report_cancelled()
        leave_at_once()
    except SystemExit as end:
        from ccm_opt.cli import cancelling  # noqa: PLC0415 - see above

        if end.code == cancelling.CANCELLED:
            if cancelling.interrupt_unmet():
                cancelling.report_cancelled()  # before a command begins, Typer turns it into an exit code
            cancelling.leave_at_once()
        # Only Python's own shutdown is left, in which nothing would handle Ctrl-C.
        cancelling.ignore_interrupts()
        sys.exit(end.code)
    except (MemoryError, ImportError, OSError) as error:
        from ccm_opt.cli.surroundings import is_out_of_memory  # noqa: PLC0415 - see above

        if not is_out_of_memory(error):
            raise
        _exit_out_of_memory("out of memory while loading libraries; solving takes 0.6 to 1 GB")


def _exit_out_of_memory(message: str) -> None:
    """Print an error message in one line and exit at once, since a regular shutdown of Python may need memory too."""
    sys.stderr.write(f"error: {message}\n")
    sys.stderr.flush()
    os._exit(1)


def _run() -> None:
    import gc  # noqa: PLC0415 - see above

    from ccm_opt.cli.surroundings import ensure_stdio, too_little_memory  # noqa: PLC0415 - see above

    ensure_stdio()
    if short := too_little_memory():
        _exit_out_of_memory(short)
    for variable in THREAD_VARIABLES:
        os.environ.setdefault(variable, "1")
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
    from ccm_opt.cli.cancelling import interrupts_end_at_once, interrupts_insist  # noqa: PLC0415 - see above

    interrupts_end_at_once()
    from ccm_opt.cli.surroundings import no_search_for_cycles  # noqa: PLC0415 - Ctrl-C while loading is handled from here

    with no_search_for_cycles():
        from ccm_opt.cli.commands import app  # noqa: PLC0415 - likewise

    interrupts_insist()
    app()
