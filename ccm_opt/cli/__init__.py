"""The command line: ``main`` is the entry point, ``commands`` has every command and option."""

import gc
import os
import sys

from ccm_opt.cli.cancelling import report_cancelled

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Read by the linear algebra libraries when they are loaded: small matrices run faster on one thread."""

OBJECTS_BETWEEN_COLLECTIONS = 20_000
"""New objects that start a search for cycles: Python's own 700 makes loading, which leaves none, a sixth longer."""


def main() -> None:
    """Entry point of ``ccm-opt``; Ctrl-C ends it with exit code 130 also while modules are loaded."""
    for variable in THREAD_VARIABLES:
        os.environ.setdefault(variable, "1")
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
    try:
        from ccm_opt.cli.commands import app  # noqa: PLC0415 - Ctrl-C while loading is handled here

        app()
    except KeyboardInterrupt:
        sys.exit(report_cancelled())
