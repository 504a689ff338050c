"""Where runs are executed: processes of this machine, or a Dask cluster; both as ``concurrent.futures`` executors.

Only a few tasks are handed over at a time, so that ten thousand take no more memory than ten. Whatever happens to a
worker, every task comes back exactly once: with its result or with the error that it ended with.
"""

import multiprocessing
import signal
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from queue import SimpleQueue
from typing import Any, Protocol, TypeVar

from ccm_opt.errors import ProblemError

TASK = TypeVar("TASK")
RESULT = TypeVar("RESULT")
LEAST_ON_CLUSTER = 64
"""Least number of tasks that a cluster has at a time: short tasks must not wait for the network."""
CLUSTER_TIMEOUT = 20.0
"""Time to find a cluster's scheduler, and its first worker [s]."""


class Workers(Protocol):
    """Opens executors."""

    def open(self) -> "Any":
        """A context manager around (executor, number of tasks handed over at a time)."""
        ...


@dataclass(frozen=True)
class LocalWorkers:
    """Processes of this machine.

    Attributes:
        count: how many.
    """

    count: int

    @contextmanager
    def open(self) -> Iterator[tuple[Executor, int]]:
        """An executor with fresh processes; they are ended at the exit, also when they are still at work."""
        context = multiprocessing.get_context("spawn")
        before = set(multiprocessing.active_children())
        executor = ProcessPoolExecutor(self.count, mp_context=context, initializer=_leave_interrupts)
        done = False
        try:
            yield executor, 2 * self.count
            done = True
        finally:
            if not done:
                for process in set(multiprocessing.active_children()) - before:
                    process.terminate()
            executor.shutdown(wait=True, cancel_futures=True)


@dataclass(frozen=True)
class DaskWorkers:
    """A Dask cluster; its workers must have this package, and the planners that are compared, in the same versions.

    Attributes:
        address: of the scheduler, for example ``tcp://host:8786``.
    """

    address: str

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
        try:
            client = distributed.Client(self.address, timeout=CLUSTER_TIMEOUT, set_as_default=False)
        except (OSError, ValueError, TimeoutError) as error:
            raise ProblemError(f"no Dask scheduler answers at {self.address}: {error}") from error
        with client:
            try:
                client.wait_for_workers(1, timeout=CLUSTER_TIMEOUT)
            except TimeoutError as error:
                raise ProblemError(f"the Dask cluster at {self.address} has no workers; start some") from error
            executor = client.get_executor(pure=False)
            yield executor, max(LEAST_ON_CLUSTER, 4 * sum(client.nthreads().values()))


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
    source, suspects = iter(tasks), deque[TASK]()
    more = True
    while more:
        with workers.open() as (executor, width):
            for item in _until_broken(executor, width, function, source, suspects):
                if item is None:
                    break
                yield item
            else:
                more = False


def _until_broken(
    executor: Executor,
    width: int,
    function: Callable[[TASK], RESULT],
    source: Iterator[TASK],
    suspects: deque[TASK],
) -> Iterator[tuple[TASK, RESULT | BaseException] | None]:
    """Results until there are no more tasks; None when the executor is broken, its tasks then being ``suspects``."""
    pending: dict[Future[RESULT], TASK] = {}
    done: SimpleQueue[Future[RESULT]] = SimpleQueue()
    while True:
        alone = bool(suspects)
        for future in _handed_over(executor, function, pending, suspects if alone else source, 1 if alone else width):
            future.add_done_callback(done.put)
        if not pending:
            return
        future = done.get()
        task, error = pending.pop(future), _error_of(future)
        if isinstance(error, BrokenExecutor) and not alone:
            suspects.extend((task, *pending.values()))
            yield None
            return
        yield task, error if error is not None else future.result()
        if isinstance(error, BrokenExecutor):
            yield None
            return


def _handed_over(
    executor: Executor,
    function: Callable[[TASK], RESULT],
    pending: dict[Future[RESULT], TASK],
    tasks: Iterator[TASK] | deque[TASK],
    width: int,
) -> Iterator[Future[RESULT]]:
    """Hand over tasks until ``width`` are pending; the futures of the new ones."""
    while len(pending) < width:
        task = (tasks.popleft() if tasks else None) if isinstance(tasks, deque) else next(tasks, None)
        if task is None:
            return
        try:
            future = executor.submit(function, task)
        except BrokenExecutor as error:
            future = Future()
            future.set_exception(error)
        pending[future] = task
        yield future


def _error_of(future: "Future[RESULT]") -> BaseException | None:
    try:
        return future.exception()
    except CancelledError as error:
        raise ProblemError("the cluster has given up the work, or is gone; run again to continue") from error


def _leave_interrupts() -> None:
    """Leave Ctrl-C to the process that hands the tasks over."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
