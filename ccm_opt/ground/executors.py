"""Where many tasks are executed: this process, processes of this machine, or a Dask cluster.

All are ``concurrent.futures`` executors.

Only a few tasks are handed over at a time, so that ten thousand take no more memory than ten. Whatever happens to a
worker, every task comes back exactly once: with its result or with the error that it ended with.
"""

import multiprocessing
import signal
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from queue import SimpleQueue
from typing import Any, Protocol, TypeVar

from ccm_opt.errors import ProblemError
from ccm_opt.ground.executor_settings import EXECUTORS, ExecutorSettings

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
        """An executor with fresh processes; they are ended at the exit, also when they are still at work."""
        # Not forked: locks and threads of numerical libraries do not survive that in a child.
        context = multiprocessing.get_context("spawn")
        # The executor does not publish its processes; those that are new from here on are its own.
        before = set(multiprocessing.active_children())
        executor = ProcessPoolExecutor(self.count, mp_context=context, initializer=_leave_interrupts)
        try:
            yield executor, self.settings.tasks_per_process * self.count
        except BaseException:
            # After Ctrl-C, or when nobody takes the results any more, nobody waits for what is still running.
            for process in set(multiprocessing.active_children()) - before:
                process.terminate()
            raise
        finally:
            executor.shutdown(wait=True, cancel_futures=True)


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
            raise ProblemError("--dask needs the extra 'cluster': pip install ccm-opt[cluster]") from error

        timeout = self.settings.cluster_timeout
        try:
            client = distributed.Client(self.address, timeout=timeout, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise ProblemError(f"no Dask scheduler answers at {self.address}: {error}") from error

        with client:
            try:
                client.wait_for_workers(1, timeout=timeout)
            except TimeoutError as error:
                raise ProblemError(f"the Dask cluster at {self.address} has no workers; start some") from error
            # Not pure: Dask must not take two runs of the same task for one.
            executor = client.get_executor(pure=False)
            threads = sum(client.nthreads().values())
            yield executor, max(self.settings.least_on_cluster, self.settings.tasks_per_thread * threads)


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
        ProblemError: when a cluster is not there, or leaves.
    """
    # Both outlive a broken executor: the tasks not handed over yet, and those that may have broken it.
    source = iter(tasks)
    suspects = deque[TASK]()
    finished = False
    while not finished:
        with workers.open() as (executor, width):
            finished = yield from _until_broken(executor, width, function, source, suspects)


def _until_broken(
    executor: Executor,
    width: int,
    function: Callable[[TASK], RESULT],
    source: Iterator[TASK],
    suspects: deque[TASK],
) -> Generator[tuple[TASK, RESULT | BaseException], None, bool]:
    """Yield results; return whether all tasks are done, or else the executor is broken.

    When it breaks, the tasks that it had become ``suspects``: the next executor runs them one at a time.
    """
    pending: dict[Future[RESULT], TASK] = {}
    done: SimpleQueue[Future[RESULT]] = SimpleQueue()
    while True:
        alone = bool(suspects)
        while len(pending) < (1 if alone else width):
            # Suspects first, and one at a time, so that the next failure names its task.
            task = suspects.popleft() if suspects else next(source, None)
            if task is None:
                break
            future = _submitted(executor, function, task)
            pending[future] = task
            future.add_done_callback(done.put)
        if not pending:
            return True

        future = done.get()
        task = pending.pop(future)
        error = _error_of(future)
        broken = isinstance(error, BrokenExecutor)
        if broken and not alone:
            suspects.append(task)
            suspects.extend(pending.values())
            return False
        yield task, error if error is not None else future.result()
        if broken:  # it was alone, so this task is the one that killed its process
            return False


def _submitted(executor: Executor, function: Callable[[TASK], RESULT], task: TASK) -> "Future[RESULT]":
    """The future of a task; when the executor is broken already, one that says so."""
    try:
        return executor.submit(function, task)
    except BrokenExecutor as error:
        future: Future[RESULT] = Future()
        future.set_exception(error)
        return future


def _error_of(future: "Future[RESULT]") -> BaseException | None:
    try:
        return future.exception()
    except CancelledError as error:
        raise ProblemError("the cluster has given up the work, or is gone; run again to continue") from error


def _leave_interrupts() -> None:
    """Leave Ctrl-C to the process that hands the tasks over."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
