"""The process in which runs are made; started by ``supervision`` as ``python -m ccm_opt.comparison.run_process``.

It reads pickled tasks from its standard input and answers each with the pickled record of its run. What planners print
goes to standard error, so that it cannot be taken for an answer.
"""

import ctypes
import os
import pickle
import signal
import sys
from contextlib import suppress
from pathlib import Path

PARENT_DIES = 1
"""PR_SET_PDEATHSIG of Linux."""
FIRST_TO_GO = "1000"
"""Greatest score of Linux's out-of-memory killer: a run that eats the memory goes before whoever watches it."""


def main() -> None:
    """Answer tasks until there are no more."""
    _belong_to_the_parent()
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    from ccm_opt.comparison.runs import execute  # noqa: PLC0415 - after the outputs are in order

    tasks = sys.stdin.buffer
    while True:
        try:
            task = pickle.load(tasks)  # noqa: S301 - from the process that started this one
        except EOFError:
            return
        pickle.dump(execute(task), answers)
        answers.flush()


def _belong_to_the_parent() -> None:
    """Leave Ctrl-C to the parent and end with it, whatever the planner is at; where the system can do that."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PARENT_DIES, signal.SIGKILL)
        with suppress(OSError):
            Path("/proc/self/oom_score_adj").write_text(FIRST_TO_GO, encoding="ascii")


if __name__ == "__main__":
    main()
