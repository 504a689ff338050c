"""Executors: every task comes back exactly once, whatever happens to the workers."""

import gc
import os
import signal
import socket
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from ccm_opt.core.errors import ProblemError
from ccm_opt.core.executors import DaskWorkers, LocalWorkers, completed

from .comparison_tasks import deadly, die_once, double, fail_on_odd, nap, slow_double

ROOT = Path(__file__).parent.parent


@pytest.mark.drawn(6, of="processes")
@pytest.mark.parametrize("workers", [1, 2])
def test_every_task_comes_back_once_from_processes(workers: int) -> None:
    """Results belong to their tasks, none is missing and none is double; tasks are taken as there is room."""
    taken: list[int] = []
    tasks = (taken.append(k) or k for k in range(40))
    found = {}
    for count, (task, result) in enumerate(completed(LocalWorkers(workers), double, tasks), start=1):
        assert task not in found
        assert len(taken) <= count + 2 * workers
        found[task] = result
    assert found == {k: 2 * k for k in range(40)}


def test_an_error_is_a_result() -> None:
    """A task that raises comes back with its error, and the others go on."""
    found = dict(completed(LocalWorkers(1), fail_on_odd, range(6)))
    assert [found[k] for k in (0, 2, 4)] == [0, 2, 4]
    assert [str(found[k]) for k in (1, 3, 5)] == ["1 is odd", "3 is odd", "5 is odd"]


@pytest.mark.drawn(6, of="processes")
def test_a_task_that_ends_its_process_is_found_out() -> None:
    """The guilty task alone comes back with an error; those that were on the way with it are run again."""
    found = list(completed(LocalWorkers(2), deadly, range(20)))
    assert sorted(task for task, _ in found) == list(range(20))
    errors = {task: result for task, result in found if isinstance(result, BaseException)}
    assert list(errors) == [7]
    assert all(result == 2 * task for task, result in found if task != 7)


@pytest.mark.drawn(6, of="processes")
def test_a_process_that_dies_by_chance_loses_nothing(tmp_path: Path) -> None:
    """When a task dies once and not again, all results are there, each once."""
    tasks = [(k, str(tmp_path / "mark")) for k in range(12)]
    found = [(task[0], result) for task, result in completed(LocalWorkers(2), die_once, tasks)]
    assert (tmp_path / "mark").exists()
    assert sorted(found) == [(k, 2 * k) for k in range(12)]


@pytest.mark.drawn(6, of="processes")
def test_work_that_is_given_up_is_ended() -> None:
    """Leaving the loop early does not wait for tasks that sleep for a minute."""
    begin = time.monotonic()
    for task, result in completed(LocalWorkers(2), nap, [0.0, 60.0, 60.0, 60.0]):
        assert task == 0.0
        assert result != os.getpid()
        break
    assert time.monotonic() - begin < 20.0


def no_scheduler() -> str:
    """An address where nobody listens."""
    return "tcp://127.0.0.1:9"


@contextmanager
def dask_cluster(folder: Path, workers: int) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A real scheduler and workers, each in a process of its own; the address, and the processes in that order.

    Processes that are added to the list are ended with the others.
    """
    place = folder / "scheduler.json"
    processes = [dask_process(folder, "scheduler", "--port", "0", "--host", "127.0.0.1")]
    try:
        processes += [dask_worker(folder) for _ in range(workers)]
        yield address_in(place), processes
    finally:
        for process in processes:
            process.kill()
        for process in processes:
            process.wait()


def dask_process(folder: Path, kind: str, *options: str) -> "subprocess.Popen[bytes]":
    """A process of a cluster that meets the others by a file."""
    command = [sys.executable, "-m", f"distributed.cli.dask_{kind}", "--no-dashboard", *options]
    return subprocess.Popen(
        [*command, "--scheduler-file", str(folder / "scheduler.json")],
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "ignore"},
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def dask_worker(folder: Path) -> "subprocess.Popen[bytes]":
    """A worker with one thread, which ends when its scheduler does."""
    return dask_process(folder, "worker", "--no-nanny", "--nthreads", "1", "--local-directory", str(folder))


def address_in(place: Path, patience: float = 30.0) -> str:
    """The address in a scheduler's file, as soon as it is there."""
    import json

    end = time.monotonic() + patience
    while time.monotonic() < end:
        if place.exists() and (text := place.read_text()).strip().endswith("}"):
            return str(json.loads(text)["address"])
        time.sleep(0.05)
    raise TimeoutError("the scheduler did not start")


@pytest.mark.drawn(1, of="cluster")
@pytest.mark.filterwarnings("ignore")
def test_a_cluster_loses_and_doubles_nothing_when_a_worker_is_killed(tmp_path: Path) -> None:
    """A real scheduler with two workers, of which one is killed midway: every task comes back once, with its result."""
    pytest.importorskip("distributed")
    with dask_cluster(tmp_path, 2) as (address, processes):
        workers = processes[1:]
        wait_for_workers(address, 2)
        found: list[tuple[int, object]] = []
        seen: set[int] = set()
        after: set[int] = set()
        victim = None
        for task, result in completed(DaskWorkers(address), slow_double, range(120)):
            assert not isinstance(result, BaseException)
            found.append((task, result[0]))
            seen.add(result[1])
            if victim is not None:
                after.add(result[1])
            if len(found) == 30:
                victim = workers[0].pid
                workers[0].send_signal(signal.SIGKILL)
        assert seen == {process.pid for process in workers}
        assert workers[1].pid in after
        assert sorted(found) == [(k, 2 * k) for k in range(120)]


@pytest.mark.drawn(1, of="cluster")
@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_that_is_lost_ends_the_work_with_a_reason(tmp_path: Path) -> None:
    """What came back before is given back; then one sentence says that the cluster was lost, and what to do."""
    pytest.importorskip("distributed")
    with dask_cluster(tmp_path, 1) as (address, processes):
        wait_for_workers(address, 1)
        found: list[int] = []

        def until_the_end() -> None:
            for task, _ in completed(DaskWorkers(address), slow_double, range(60)):
                found.append(task)
                if len(found) == 20:
                    kill_all(processes)

        with pytest.raises(
            ProblemError, match="the connection to the cluster was lost; restart the cluster and repeat the command"
        ):
            until_the_end()
        assert len(found) == len(set(found)) >= 20


@pytest.mark.drawn(1, of="cluster")
@pytest.mark.filterwarnings("ignore")
def test_the_client_of_a_cluster_keeps_nothing_of_what_is_over(tmp_path: Path) -> None:
    """When all tasks have come back, less than a tenth of what went to the cluster is in the client's memory."""
    pytest.importorskip("distributed")
    count, size = 300, 40_000
    with dask_cluster(tmp_path, 1) as (address, _):
        wait_for_workers(address, 1)
        tracemalloc.start()
        try:
            back = completed(DaskWorkers(address), len, (f"{k:{size}d}" for k in range(count)))
            for _ in range(count):
                next(back)  # after the last the client is still there, and nothing is on its way
            end = time.monotonic() + 60.0
            while kept_memory() > count * size / 10 and time.monotonic() < end:
                time.sleep(0.1)  # Dask's threads let go of it when their turn comes
            assert kept_memory() < count * size / 10
            back.close()
        finally:
            tracemalloc.stop()


def kept_memory() -> int:
    """Memory in use after a collection [B]."""
    gc.collect()
    return tracemalloc.get_traced_memory()[0]


def kill_all(processes: "list[subprocess.Popen[bytes]]") -> None:
    """Kill all processes of a cluster, as a fault of its machine does."""
    for process in processes:
        process.kill()
    for process in processes:
        process.wait()


def wait_for_workers(address: str, count: int) -> None:
    """Wait until a scheduler has so many workers."""
    from distributed import Client

    with Client(address, set_as_default=False) as client:
        client.wait_for_workers(count, timeout=30)


@pytest.mark.filterwarnings("ignore")
def test_a_cluster_that_is_not_there_is_reported() -> None:
    """No answer from the address gives one clear sentence."""
    pytest.importorskip("distributed")
    with pytest.raises(ProblemError, match=r"no Dask scheduler answers"):
        list(completed(DaskWorkers(no_scheduler(), timeout=0.5), double, [1]))


@pytest.mark.filterwarnings("ignore")
def test_a_scheduler_that_never_answers_is_reported() -> None:
    """An address that accepts and says nothing gives the same sentence as one where nobody listens."""
    pytest.importorskip("distributed")
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(ProblemError, match=r"no Dask scheduler answers.*: no answer within 1 s"):
            list(completed(DaskWorkers(address, timeout=1.0), double, [1]))


def test_the_extra_is_named_when_dask_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the distributed package the message says what to install."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ProblemError, match="pip install distributed"):
        list(completed(DaskWorkers(no_scheduler()), double, [1]))
