"""How many tasks workers are handed at a time, and how long a cluster may take to answer."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ExecutorSettings:
    """How many tasks workers are handed at a time, and how long a cluster may take to answer; all of them are taste.

    Attributes:
        tasks_per_process: tasks handed over at a time for every process of this machine.
        tasks_per_thread: the same for every thread of a cluster.
        least_on_cluster: least number of tasks that a cluster has at a time: short ones must not wait for the network.
        cluster_timeout: time to find a cluster's scheduler, and again to find its first worker [s].
    """

    tasks_per_process: int = 2
    tasks_per_thread: int = 4
    least_on_cluster: int = 64
    cluster_timeout: float = 20.0


EXECUTORS = ExecutorSettings()
"""Used where no other settings are given."""
