"""The process in which runs are made; started by ``supervision`` as ``python -m ccm_opt.cli.compare.run_process``.

It reads pickled tasks from its standard input and answers each with the pickled record of its run. What planners print
goes to standard error, so that it cannot be taken for an answer.
"""

import os
import pickle
import select
import signal
import sys

if sys.platform == "linux":
    import fcntl


def main() -> None:
    """Answer tasks until there are no more."""
    _belong_to_the_parent()
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    from ccm_opt.cli.compare.runs import execute  # noqa: PLC0415 - after the outputs are in order

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
        _end_with(int(sys.argv[1]))


def _end_with(pipe: int) -> None:
    """End when the other end of a pipe is closed, which the system does for a parent that dies, however it does.

    The system sends a signal then, whose default is to end the process; no thread of Python has to have its turn. (That
    it can send one when the parent dies is of no use: it is sent when the parent's thread ends.)
    """
    fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | os.O_ASYNC)
    if select.select([pipe], [], [], 0.0)[0]:  # it was closed before
        sys.exit()


if __name__ == "__main__":
    main()
