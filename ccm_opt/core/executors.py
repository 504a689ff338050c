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
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from multiprocessing.connection import wait
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any, Generic, Protocol, TypeVar

from ccm_opt.core.errors import ProblemError
from ccm_opt.core.threads import in_background


@dataclass(frozen=True)
class ExecutorSettings:
    """How many tasks workers are handed at a time, and how long a cluster may take to answer; all of them are taste.

    Attributes:
        tasks_per_process: tasks handed over at a time for every process of this machine.
        tasks_per_thread: the same for every thread of a cluster.
        least_on_cluster: least number of tasks that a cluster has at a time: short ones must not wait for the network.
        cluster_timeout: time to find a cluster's scheduler, and again to find its first worker [s].
        return_timeout: time for which a cluster that was lost may take to come back [s].
        most_losses: how often in a row a cluster may be lost without a single result between.
        look_every: time between two looks whether a cluster is still there, while nothing comes back [s].
        farewell: time that a cluster is given to be left in good order [s].
    """

    tasks_per_process: int = 2
    tasks_per_thread: int = 4
    least_on_cluster: int = 64
    cluster_timeout: float = 20.0
    return_timeout: float = 300.0
    most_losses: int = 5
    look_every: float = 0.5
    farewell: float = 2.0


EXECUTORS = ExecutorSettings()
"""Used where no other settings are given."""


MESSAGES_KEPT = "distributed.admin.low-level-log-length"
"""Key of Dask's configuration."""
RESULT = TypeVar("RESULT")


@dataclass(frozen=True)
class DaskWorkers:
    """A Dask cluster; its workers must have this package, and the planners that are compared, in the same versions.

    Attributes:
        address: of the scheduler, for example ``tcp://host:8786``.
        settings: tasks at a time, and how long to wait for an answer.
    """

    address: str
    settings: ExecutorSettings = EXECUTORS

    @contextmanager
    def open(self) -> Iterator[tuple[Executor, int]]:
        """An executor of the cluster; the scheduler repeats what a lost worker was at.

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
            client = self._client_of(distributed)
            try:
                yield self._executor_of(client)
            finally:
                # A scheduler that is gone does not answer any more.
                with suppress(OSError, TimeoutError, CancelledError):
                    client.close(timeout=self.settings.farewell)

    def _client_of(self, distributed: Any) -> Any:
        """A client that is connected.

        Raises:
            ProblemError: when there is no scheduler, or the client's thread is given no time to run in.
        """
        limit = self.settings.cluster_timeout
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

    def _executor_of(self, client: Any) -> tuple[Executor, int]:
        limit = self.settings.cluster_timeout
        try:
            in_background(partial(client.wait_for_workers, 1, timeout=limit)).result(limit)
            threads = sum(in_background(client.nthreads).result(limit).values())
        except (OSError, TimeoutError) as error:
            raise ProblemError(f"the Dask cluster at {self.address} has no workers; start some") from error
        return ClusterExecutor(client), max(self.settings.least_on_cluster, self.settings.tasks_per_thread * threads)

    @property
    def patience(self) -> float:
        """Time for which to wait for a cluster that was lost [s]."""
        return self.settings.return_timeout


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


logger = logging.getLogger(__name__)

CLUSTER_IS_GONE = frozenset(("ClosedClientError", "CommClosedError"))
"""Names of Dask's errors, which is not loaded here, when nothing can be handed over any more."""
TASK = TypeVar("TASK")


class Workers(Protocol):
    """Opens executors."""

    def open(self) -> "Any":
        """A context manager around (executor, number of tasks handed over at a time)."""
        ...


@dataclass(frozen=True)
class ThisProcess:
    """No workers at all: every task is run when it is handed over."""

    @contextmanager
    def open(self) -> Iterator[tuple[Executor, int]]:
        """An executor that runs tasks itself, one at a time."""
        yield _Immediate(), 1


class _Immediate(Executor):
    """Runs a task while it is submitted."""

    def submit(self, fn: Callable[..., RESULT], /, *args: Any, **kwargs: Any) -> "Future[RESULT]":
        """The future of a task that is over; Ctrl-C ends the caller, not the task alone."""
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
        settings: tasks at a time.
    """

    count: int
    settings: ExecutorSettings = EXECUTORS

    @contextmanager
    def open(self) -> Iterator[tuple[Executor, int]]:
        """An executor with fresh processes; they are ended at the exit, also when they are still at work.

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
            yield executor, self.settings.tasks_per_process * self.count
        except BaseException:
            # After Ctrl-C, or when nobody takes the results any more, nobody waits for what is still running.
            for process in set(multiprocessing.active_children()) - before:
                process.terminate()
            raise
        finally:
            executor.shutdown(wait=True, cancel_futures=True)


class _LostError(Exception):
    """The cluster is gone, or has given up the work."""


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

    A cluster that is lost is waited for. What it was at is handed over again when it is back: a task may be run twice
    then, but it is given back once.

    Raises:
        ProblemError: when a cluster is not there, or does not come back.
    """
    supply = _Supply(iter(tasks))
    losses = 0
    finished = False
    while not finished:
        with _opened(workers, returning=losses > 0) as (executor, width):
            results = _until_broken(executor, width, function, supply)
            try:
                while True:
                    found = next(results)
                    losses = 0
                    yield found
            except StopIteration as end:
                finished = bool(end.value)
            except _LostError as error:
                losses += 1
                if losses > EXECUTORS.most_losses:
                    raise ProblemError("the cluster gives up whatever it is handed; run again to continue") from error
                logger.warning("the cluster is gone, or has given up the work; it is waited for")


@dataclass
class _Supply(Generic[TASK]):
    """Tasks to be handed over; it outlives the executors.

    Attributes:
        source: those that were handed to none yet.
        again: those that a lost cluster was at.
        suspects: those that may have broken their executor; they are handed over one at a time.
    """

    source: Iterator[TASK]
    again: deque[TASK] = field(default_factory=deque)
    suspects: deque[TASK] = field(default_factory=deque)

    def take(self) -> TASK | None:
        """The next task, suspects first, so that the next failure names its task; None when there are no more."""
        for waiting in (self.suspects, self.again):
            if waiting:
                return waiting.popleft()
        return next(self.source, None)


@contextmanager
def _opened(workers: Workers, *, returning: bool) -> Iterator[tuple[Executor, int]]:
    """The executor of some workers; those that were lost are waited for.

    Raises:
        ProblemError: they are not there, or do not come back.
    """
    patience = getattr(workers, "patience", 0.0) if returning else 0.0
    until = time.monotonic() + patience
    with ExitStack() as stack:
        while True:
            try:
                opened = stack.enter_context(workers.open())
                break
            except ProblemError as error:
                if time.monotonic() < until:
                    time.sleep(min(1.0, max(0.0, until - time.monotonic())))
                    continue
                if not returning:
                    raise
                raise ProblemError(f"the cluster was lost, and is not back after {patience:.3g} s: {error}") from error
        yield opened


def _until_broken(
    executor: Executor, width: int, function: Callable[[TASK], RESULT], supply: _Supply[TASK]
) -> Generator[tuple[TASK, RESULT | BaseException], None, bool]:
    """Yield results; return whether all tasks are done, or else the executor is broken.

    When it breaks, the tasks that it had become suspects: the next executor runs them one at a time.

    Raises:
        _LostError: the cluster is gone; what it was at is to be handed over again.
    """
    pending: dict[Future[RESULT], TASK] = {}
    done: SimpleQueue[Future[RESULT]] = SimpleQueue()
    while True:
        alone = bool(supply.suspects)
        while len(pending) < (1 if alone else width):
            task = supply.take()
            if task is None:
                break
            future = _submitted(executor, function, task)
            pending[future] = task
            future.add_done_callback(done.put)
        if not pending:
            return True

        over = _next_done(done, executor)
        if over is None or over.cancelled():
            # What has come back in spite of all is kept; all else is to be handed over again.
            yield from _saved(pending, done)
            supply.again.extend(pending.values())
            raise _LostError
        task = pending.pop(over)
        error = over.exception()
        broken = isinstance(error, BrokenExecutor)
        if broken and not alone:
            supply.suspects.append(task)
            supply.suspects.extend(pending.values())
            return False
        yield task, error if error is not None else over.result()
        if broken:  # it was alone, so this task is the one that killed its process
            return False


def _next_done(done: "SimpleQueue[Future[RESULT]]", executor: Executor) -> "Future[RESULT] | None":
    """The next future that is over; None when its cluster is gone, for Dask leaves some of its futures open then."""
    while True:
        with suppress(Empty):
            return done.get(timeout=EXECUTORS.look_every)
        if isinstance(executor, ClusterExecutor) and executor.gone:
            return None


def _saved(
    pending: dict["Future[RESULT]", TASK], done: "SimpleQueue[Future[RESULT]]"
) -> Iterator[tuple[TASK, RESULT | BaseException]]:
    """Results that had come back before a cluster was lost; they are taken out of what is pending."""
    with suppress(Empty):
        while True:
            future = done.get_nowait()
            if not future.cancelled() and future.exception() is None:
                yield pending.pop(future), future.result()


def _submitted(executor: Executor, function: Callable[[TASK], RESULT], task: TASK) -> "Future[RESULT]":
    """The future of a task; when it cannot be handed over, one that says why."""
    try:
        return executor.submit(function, task)
    except Exception as error:  # noqa: BLE001 - a task that cannot be pickled has itself to blame
        future: Future[RESULT] = Future()
        if type(error).__name__ in CLUSTER_IS_GONE:
            future.cancel()
        else:
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
