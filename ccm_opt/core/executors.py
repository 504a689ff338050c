"""Parallel execution of tasks by ``concurrent.futures`` executors, in processes of this machine or on a Dask cluster.

Only a few tasks are in flight at a time, so that ten thousand take no more memory than ten. Whatever happens to a
worker, every task is returned exactly once, with its result or with its error.
"""

import ctypes
import logging
import multiprocessing
import os
import signal
import sys
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterable, Iterator
from concurrent import futures
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from multiprocessing.connection import wait
from pathlib import Path
from threading import Thread
from typing import Any, Protocol, TypeVar

from ccm_opt.core.errors import ProblemError
from ccm_opt.core.threads import in_background

_TASKS_PER_PROCESS = 2
"""Number of tasks in flight per worker process of this machine. Heuristic."""
_TASKS_PER_THREAD = 4
"""Number of tasks in flight per worker thread of a cluster. Heuristic."""
_LEAST_ON_CLUSTER = 64
"""Least number of tasks in flight on a cluster, so that short tasks do not wait for the network. Heuristic."""
_LOOK_EVERY = 0.5
"""Interval at which the connection to a cluster is checked while no result arrives [s]. Heuristic."""
_FAREWELL = 2.0
"""Time allowed for closing the connection to a cluster [s]. Heuristic."""
MESSAGES_KEPT = "distributed.admin.low-level-log-length"
"""Key in the configuration of Dask for the number of recent messages that Dask retains for debugging."""
RESULT = TypeVar("RESULT")


@dataclass(frozen=True)
class DaskWorkers:
    """A Dask cluster whose workers have this package and any compared planners in the versions used here.

    Attributes:
        address: address of the scheduler, for example ``tcp://host:8786``.
        timeout: time allowed to reach the scheduler, and again to reach its first worker [s].
    """

    address: str
    timeout: float = 20.0

    @contextmanager
    def open(self) -> Iterator[tuple[Executor, int]]:
        """Open an executor on the cluster, and return it with the number of tasks to keep in flight.

        The scheduler reruns the tasks of a lost worker.

        Raises:
            ProblemError: Dask is not installed or the cluster cannot be reached.
        """
        try:
            distributed: Any = import_module("distributed")  # an extra, and slow to load
        except ImportError as error:
            raise ProblemError(
                "--dask needs the package distributed; install it with: pip install distributed"
            ) from error

        # For debugging, Dask retains its last thousand messages including their tasks, which costs memory. Dask reads
        # this setting at every (re)connection, so the setting stays in force while the client is open.
        none_kept = import_module("dask").config.set({MESSAGES_KEPT: 0})
        with _unheard("distributed", "distributed.client", "tornado.application"), none_kept:
            client = self._connect_client(distributed)
            try:
                yield self._make_executor(client)
            finally:
                # A lost scheduler does not answer the request to close.
                with suppress(OSError, TimeoutError, CancelledError):
                    client.close(timeout=_FAREWELL)

    def _connect_client(self, distributed: Any) -> Any:
        """Return a connected Dask client.

        Raises:
            ProblemError: no scheduler answers, or the machine is too busy for the client's thread to start.
        """
        limit = self.timeout
        # The destructor of a client that did not connect waits for that client's thread and takes a lock of all
        # clients, in whichever thread collects garbage: the thread of the next client may never answer.
        client = type("Client", (distributed.Client,), {"__del__": lambda _: None})
        connect = partial(client, self.address, timeout=limit, set_as_default=False)
        try:
            # Dask's own timeout covers only the connection; Dask then waits forever for the first message.
            return in_background(connect).result(limit)
        except AssertionError as error:  # bare, if the client's thread does not start within ten seconds
            raise ProblemError("this machine is too busy to start a Dask client") from error
        except (OSError, ValueError, TypeError, TimeoutError) as error:  # TypeError: no certificates are set up
            reason = str(error) or f"no answer within {limit:g} s"
            raise ProblemError(f"no Dask scheduler answers at {self.address}: {reason}") from error

    def _make_executor(self, client: Any) -> tuple[Executor, int]:
        try:
            in_background(partial(client.wait_for_workers, 1, timeout=self.timeout)).result(self.timeout)
            threads = sum(in_background(client.nthreads).result(self.timeout).values())
        except (OSError, TimeoutError) as error:
            raise ProblemError(f"the Dask cluster at {self.address} has no workers; start at least one") from error
        return ClusterExecutor(client), max(_LEAST_ON_CLUSTER, _TASKS_PER_THREAD * threads)


@contextmanager
def _unheard(*loggers: str) -> Iterator[None]:
    """Silence loggers during a block, in which tracebacks on a lost cluster would hide the message of this package."""
    found = [logging.getLogger(name) for name in loggers]
    levels = [logger.level for logger in found]
    for logger in found:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(found, levels, strict=True):
            logger.setLevel(level)


class ClusterExecutor(Executor):
    """Executor of a Dask cluster that can also report whether the cluster is still connected."""

    def __init__(self, client: Any) -> None:
        self._client = client
        # Not pure: Dask must not merge two runs of the same task into one.
        self._executor = client.get_executor(pure=False)

    def submit(self, fn: Callable[..., RESULT], /, *args: Any, **kwargs: Any) -> "Future[RESULT]":
        """Submit a function call to the cluster as a task, and return its future."""
        future: Future[RESULT] = self._executor.submit(fn, *args, **kwargs)
        return future

    @property
    def gone(self) -> bool:
        """Whether the connection to the scheduler was ever lost, even briefly; Dask then drops pending tasks."""
        return bool(self._client.status != "running")


CLUSTER_IS_GONE = frozenset(("ClosedClientError", "CommClosedError"))
"""Names of the errors that Dask raises if tasks can no longer be submitted; Dask itself is not imported here."""
TASK = TypeVar("TASK")


class Workers(Protocol):
    """Protocol of objects that provide executors on which tasks run."""

    def open(self) -> "Any":
        """Return a context manager that yields an executor and the number of tasks to keep in flight."""
        ...


@dataclass(frozen=True)
class ThisProcess:
    """Execution without workers: every task runs in this process while it is submitted."""

    @contextmanager
    def open(self) -> Iterator[tuple[Executor, int]]:
        """Open an executor that runs each task in this process, with 1 as the number of tasks in flight."""
        yield _Immediate(), 1


class _Immediate(Executor):
    """Executor that runs a task while the task is submitted."""

    def submit(self, fn: Callable[..., RESULT], /, *args: Any, **kwargs: Any) -> "Future[RESULT]":
        """Run a task and return its completed future; Ctrl-C is raised in the caller, not kept in the future."""
        future: Future[RESULT] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 - any error is the task's result
            future.set_exception(error)
        return future


@dataclass(frozen=True)
class LocalWorkers:
    """Worker processes on this machine.

    Attributes:
        count: number of processes.
    """

    count: int

    @contextmanager
    def open(self) -> Iterator[tuple[Executor, int]]:
        """Open an executor on new processes, which end with the block; after an error they are terminated.

        The executor comes with the number of tasks to keep in flight.

        Raises:
            ProblemError: the system cannot start the processes.
        """
        # Not forked: locks and threads of numerical libraries do not survive a fork.
        context = multiprocessing.get_context("spawn")
        # The executor does not expose its processes; children that are new from here on are its own.
        before = set(multiprocessing.active_children())
        try:
            Path.cwd()  # workers start there; without this check every single task would fail
        except OSError as error:
            raise ProblemError("cannot start worker processes: the working directory no longer exists") from error
        try:
            executor = ProcessPoolExecutor(self.count, mp_context=context, initializer=_serve_parent)
        except OSError as error:
            raise ProblemError(
                f"cannot start {self.count} worker processes: {error.strerror or error}; use fewer workers, or raise "
                f"ulimit -n"
            ) from error
        try:
            yield executor, _TASKS_PER_PROCESS * self.count
        except BaseException:
            # After Ctrl-C, or when the results are no longer consumed, running tasks are abandoned.
            for process in set(multiprocessing.active_children()) - before:
                process.terminate()
            raise
        finally:
            executor.shutdown(wait=True, cancel_futures=True)


def completed(
    workers: Workers, function: Callable[[TASK], RESULT], tasks: Iterable[TASK]
) -> Iterator[tuple[TASK, RESULT | BaseException]]:
    """Run a function on every task, and yield each task with its result or error as soon as it is done.

    When a process of this machine dies, the task that killed it is unknown. All tasks in flight are then run again, one
    at a time, and the one that kills its process is yielded with its error.

    Args:
        workers: provider of the executor on which the tasks run.
        function: function of one task; function and tasks are pickled.
        tasks: the tasks, consumed one by one as workers become free.

    Raises:
        ProblemError: a cluster cannot be reached, or is lost.
    """
    source = iter(tasks)
    suspects: deque[TASK] = deque()
    finished = False
    while not finished:
        with workers.open() as (executor, width):
            finished = yield from _until_broken(executor, width, function, source, suspects)


def _until_broken(
    executor: Executor, width: int, function: Callable[[TASK], RESULT], source: Iterator[TASK], suspects: deque[TASK]
) -> Generator[tuple[TASK, RESULT | BaseException], None, bool]:
    """Yield tasks with their results until all are done or the executor breaks; return whether all are done.

    The tasks in flight when the executor breaks become suspects: the next executor runs the suspects one at a time, so
    that the next failure identifies its task.

    Raises:
        ProblemError: the cluster is lost.
    """
    pending: dict[Future[RESULT], TASK] = {}
    while True:
        alone = bool(suspects)
        while len(pending) < (1 if alone else width):
            task = suspects.popleft() if suspects else next(source, None)
            if task is None:
                break
            pending[_submitted(executor, function, task)] = task
        if not pending:
            return True
        over = _next_done(pending, executor)
        task = pending.pop(over)
        error = over.exception()
        broken = isinstance(error, BrokenExecutor)
        if broken and not alone:
            suspects.extend((task, *pending.values()))
            return False
        yield task, error if error is not None else over.result()
        if broken:  # the task ran alone, so it killed its process
            return False


def _next_done(pending: Collection["Future[RESULT]"], executor: Executor) -> "Future[RESULT]":
    """Wait for the next future to complete, and return that future.

    Raises:
        ProblemError: the cluster is lost; Dask then cancels several futures and leaves others pending forever.
    """
    while not (over := futures.wait(pending, _LOOK_EVERY, futures.FIRST_COMPLETED).done):
        if isinstance(executor, ClusterExecutor) and executor.gone:
            raise ProblemError(_LOST)
    done = next((future for future in over if not future.cancelled()), None)
    if done is None:
        raise ProblemError(_LOST)
    return done


_LOST = "the connection to the cluster was lost; restart the cluster and repeat the command"


def _submitted(executor: Executor, function: Callable[[TASK], RESULT], task: TASK) -> "Future[RESULT]":
    """Submit a task and return its future; a task that cannot be submitted gets a future with the error.

    Raises:
        ProblemError: the cluster is lost.
    """
    try:
        return executor.submit(function, task)
    except Exception as error:  # for example, the task cannot be pickled
        if type(error).__name__ in CLUSTER_IS_GONE:
            raise ProblemError(_LOST) from error
        future: Future[RESULT] = Future()
        future.set_exception(error)
        return future


def _serve_parent() -> None:
    """Make a worker process ignore Ctrl-C, which the parent handles, and end when the parent ends for any reason.

    A worker waits for tasks on a pipe of which it also holds the other end, so it would not notice the end of the
    parent.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()
    if sys.platform.startswith("linux"):
        # While a solver holds the interpreter lock the thread above cannot run; then the kernel kills the worker.
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_SIGNAL_AT_PARENTS_END, signal.SIGKILL)


def _end_with(sentinel: int) -> None:
    """Wait until the process with a given sentinel ends, then end this process."""
    wait([sentinel])
    os._exit(1)


_SIGNAL_AT_PARENTS_END = 1
"""Value of ``PR_SET_PDEATHSIG`` on Linux: the signal that a process gets when its parent ends."""
