"""Where many tasks are executed: this process, processes of this machine, or a Dask cluster.

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
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing.connection import wait
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any, Generic, Protocol, TypeVar

from ccm_opt.errors import ProblemError
from ccm_opt.ground.cluster import ClusterExecutor
from ccm_opt.ground.executor_settings import EXECUTORS, ExecutorSettings

logger = logging.getLogger(__name__)

CLUSTER_IS_GONE = frozenset(("ClosedClientError", "CommClosedError"))
"""Names of Dask's errors, which is not loaded here, when nothing can be handed over any more."""
TASK = TypeVar("TASK")
RESULT = TypeVar("RESULT")


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
