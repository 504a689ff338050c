"""Work on several processes and on clusters.

All are ``concurrent.futures`` executors.

Only a few tasks are handed over at a time, so that ten thousand take no more memory than ten. Whatever happens to a
worker, every task comes back exactly once: with its result or with the error that it ended with.
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
"""Tasks handed over at a time for every process of this machine. Taste."""
_TASKS_PER_THREAD = 4
"""The same for every thread of a cluster. Taste."""
_LEAST_ON_CLUSTER = 64
"""Least number of tasks that a cluster has at a time: short ones must not wait for the network. Taste."""
_LOOK_EVERY = 0.5
"""Time between two looks whether a cluster is still there, while nothing comes back [s]. Taste."""
_FAREWELL = 2.0
"""Time that a cluster is given to be left in good order [s]. Taste."""
MESSAGES_KEPT = "distributed.admin.low-level-log-length"
"""Key of Dask's configuration."""
RESULT = TypeVar("RESULT")


@dataclass(frozen=True)
class DaskWorkers:
    """A Dask cluster; its workers must have this package, and the planners that are compared, in the same versions.

    Attributes:
        address: of the scheduler, for example ``tcp://host:8786``.
        timeout: time to find the scheduler, and again to find its first worker [s].
    """

    address: str
    timeout: float = 20.0

    @contextmanager
    def open(self) -> Iterator[tuple[Executor, int]]:
        """Return an executor of the cluster; the scheduler repeats what a lost worker was at.

        Raises:
            ProblemError: when Dask is not installed or the cluster cannot be reached.
        """
        try:
            distributed: Any = import_module("distributed")  # an extra, and slow to load
        except ImportError as error:
            raise ProblemError(
                "--dask needs Dask's package distributed; install it with: pip install distributed"
            ) from error

        # Dask keeps its last messages for those who look for defects in it: a thousand, with all tasks in them; on a
        # busy machine one message holds many. It asks how many whenever it connects, as after a machine stood still.
        none_kept = import_module("dask").config.set({MESSAGES_KEPT: 0})
        with _unheard("distributed", "distributed.client", "tornado.application"), none_kept:
            client = self._connect_client(distributed)
            try:
                yield self._make_executor(client)
            finally:
                # A scheduler that is gone does not answer any more.
                with suppress(OSError, TimeoutError, CancelledError):
                    client.close(timeout=_FAREWELL)

    def _connect_client(self, distributed: Any) -> Any:
        """Return a client that is connected.

        Raises:
            ProblemError: when there is no scheduler, or the client's thread is given no time to run in.
        """
        limit = self.timeout
        connect = partial(distributed.Client, self.address, timeout=limit, set_as_default=False)
        for _ in range(2):
            # Dask has no words for a thread of its own that did not start within ten seconds.
            with suppress(AssertionError):
                try:
                    # Dask's own limit ends with the connection: it waits for ever for the first word.
                    return in_background(connect).result(limit)
                except (OSError, ValueError, TypeError, TimeoutError) as error:  # TypeError: no certificates are set up
                    reason = str(error) or f"nothing was heard within {limit:g} s"
                    raise ProblemError(f"no Dask scheduler answers at {self.address}: {reason}") from error
        raise ProblemError("this machine is too busy for a client of Dask to start")

    def _make_executor(self, client: Any) -> tuple[Executor, int]:
        try:
            in_background(partial(client.wait_for_workers, 1, timeout=self.timeout)).result(self.timeout)
            threads = sum(in_background(client.nthreads).result(self.timeout).values())
        except (OSError, TimeoutError) as error:
            raise ProblemError(f"the Dask cluster at {self.address} has no workers; start some") from error
        return ClusterExecutor(client), max(_LEAST_ON_CLUSTER, _TASKS_PER_THREAD * threads)


@contextmanager
def _unheard(*loggers: str) -> Iterator[None]:
    """Leave what Dask has to say of a cluster that comes and goes to us: its tracebacks would bury our sentence."""
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
    """Dask's executor, of which one can ask whether its cluster is still there."""

    def __init__(self, client: Any) -> None:
        self._client = client
        # Not pure: Dask must not take two runs of the same task for one.
        self._executor = client.get_executor(pure=False)

    def submit(self, fn: Callable[..., RESULT], /, *args: Any, **kwargs: Any) -> "Future[RESULT]":
        """Hand a task to the cluster."""
        future: Future[RESULT] = self._executor.submit(fn, *args, **kwargs)
        return future

    @property
    def gone(self) -> bool:
        """Whether the scheduler has been lost, be it for a moment: Dask forgets what it was at."""
        return bool(self._client.status != "running")


CLUSTER_IS_GONE = frozenset(("ClosedClientError", "CommClosedError"))
"""Names of Dask's errors, which is not loaded here, when nothing can be handed over any more."""
TASK = TypeVar("TASK")


class Workers(Protocol):
    """Opens executors."""

    def open(self) -> "Any":
        """Return a context manager around (executor, number of tasks handed over at a time)."""
        ...


@dataclass(frozen=True)
class ThisProcess:
    """No workers at all: every task is run when it is handed over."""

    @contextmanager
    def open(self) -> Iterator[tuple[Executor, int]]:
        """Return an executor that runs tasks itself, one at a time."""
        yield _Immediate(), 1


class _Immediate(Executor):
    """Runs a task while it is submitted."""

    def submit(self, fn: Callable[..., RESULT], /, *args: Any, **kwargs: Any) -> "Future[RESULT]":
        """Return the future of a task that is over; Ctrl-C ends the caller, not the task alone."""
        future: Future[RESULT] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 - whatever it is belongs to the task
            future.set_exception(error)
        return future


@dataclass(frozen=True)
class LocalWorkers:
    """Processes of this machine.

    Attributes:
        count: how many.
    """

    count: int

    @contextmanager
    def open(self) -> Iterator[tuple[Executor, int]]:
        """Return an executor with fresh processes; they are ended at the exit, also when they are still at work.

        Raises:
            ProblemError: the system allows none.
        """
        # Not forked: locks and threads of numerical libraries do not survive that in a child.
        context = multiprocessing.get_context("spawn")
        # The executor does not publish its processes; those that are new from here on are its own.
        before = set(multiprocessing.active_children())
        try:
            Path.cwd()  # processes begin there, and without it each task would fail by itself
        except OSError as error:
            raise ProblemError("processes for workers cannot be had: the working directory is gone") from error
        try:
            executor = ProcessPoolExecutor(self.count, mp_context=context, initializer=_serve_parent)
        except OSError as error:
            raise ProblemError(
                f"{self.count} processes for workers cannot be had: {error.strerror or error}; see ulimit -n, or take "
                f"fewer workers"
            ) from error
        try:
            yield executor, _TASKS_PER_PROCESS * self.count
        except BaseException:
            # After Ctrl-C, or when nobody takes the results any more, nobody waits for what is still running.
            for process in set(multiprocessing.active_children()) - before:
                process.terminate()
            raise
        finally:
            executor.shutdown(wait=True, cancel_futures=True)


def completed(
    workers: Workers, function: Callable[[TASK], RESULT], tasks: Iterable[TASK]
) -> Iterator[tuple[TASK, RESULT | BaseException]]:
    """Run a function on every task, and give each back as soon as it is done, with its result or its error.

    When processes of this machine die, nobody knows which task did it. All that were handed over are run again, one at
    a time: the one that dies alone is given back with its error.

    Args:
        workers: where to run.
        function: of a task; it and the tasks are pickled.
        tasks: taken one by one as there is room.

    Raises:
        ProblemError: when a cluster is not there, or is lost.
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
    """Yield results; return whether all tasks are done, or else the executor is broken.

    When it breaks, the tasks that it had become suspects: the next executor runs them one at a time, so that the next
    failure names its task.

    Raises:
        ProblemError: the cluster is gone.
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
        if broken:  # it was alone, so this task is the one that killed its process
            return False


def _next_done(pending: Collection["Future[RESULT]"], executor: Executor) -> "Future[RESULT]":
    """Return the next future that is over.

    Raises:
        ProblemError: the cluster is gone; Dask cancels its futures then, and leaves some of them open.
    """
    while not (over := futures.wait(pending, _LOOK_EVERY, futures.FIRST_COMPLETED).done):
        if isinstance(executor, ClusterExecutor) and executor.gone:
            raise ProblemError(_LOST)
    done = next((future for future in over if not future.cancelled()), None)
    if done is None:
        raise ProblemError(_LOST)
    return done


_LOST = "the cluster was lost; start it anew, and give the same command again"


def _submitted(executor: Executor, function: Callable[[TASK], RESULT], task: TASK) -> "Future[RESULT]":
    """Return the future of a task; when it cannot be handed over, one that says why.

    Raises:
        ProblemError: the cluster is gone.
    """
    try:
        return executor.submit(function, task)
    except Exception as error:  # a task that cannot be pickled has itself to blame
        if type(error).__name__ in CLUSTER_IS_GONE:
            raise ProblemError(_LOST) from error
        future: Future[RESULT] = Future()
        future.set_exception(error)
        return future


def _serve_parent() -> None:
    """Leave Ctrl-C to the process that hands the tasks over, and end when that one does, however it ends.

    A worker waits for tasks on a pipe whose other end it holds too, so that by itself it would wait for ever.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is None:
        return
    Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()
    if sys.platform.startswith("linux"):
        # Where a solver spins no thread of Python's gets a turn; there the system ends the worker.
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(_SIGNAL_AT_PARENTS_END, signal.SIGKILL)


def _end_with(sentinel: int) -> None:
    """Wait until another process ends, and end this one."""
    wait([sentinel])
    os._exit(1)


_SIGNAL_AT_PARENTS_END = 1
"""``PR_SET_PDEATHSIG`` of Linux."""
