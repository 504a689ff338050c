"""Dask clusters as workers: found, left, and asked whether they are still there."""

import logging
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Executor, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any, TypeVar

from ccm_opt.errors import ProblemError
from ccm_opt.ground.background import in_background
from ccm_opt.ground.executor_settings import EXECUTORS, ExecutorSettings

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
