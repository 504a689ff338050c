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
