"""A dense check of a configuration against its task, with kinematics that share nothing with the NLP."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.ground.angles import wrap
from ccm_opt.nlp.multiple_shooting import ConfigurationNLP


@dataclass(frozen=True)
class Shortfall:
    """One requirement a configuration misses: ``worst`` against ``limit``, in ``unit``."""

    name: str
    worst: float
    limit: float
    unit: str

    def __str__(self) -> str:
        return f"{self.name}: {self.worst:.6g} {self.unit}, allowed {self.limit:.6g} {self.unit}"


def shortfalls(nlp: ConfigurationNLP, configuration: Configuration) -> tuple[Shortfall, ...]:
    """Every requirement of the NLP's task that a configuration misses; empty when it is good.

    Args:
        nlp: gives the task and the region of each segment.
        configuration: in metres, from ``polished_configuration``.
    """
    task = nlp.task
    settings = task.settings
    tip, heading = configuration.tip
    goal = heading if task.goal_heading is None else task.goal_heading
    low, high = task.base_heading_range
    base_miss = max(low - configuration.base_heading, configuration.base_heading - high, 0.0)
    arc = np.linspace(0.0, configuration.length, settings.check_samples * len(configuration.segments))
    curvature = float(np.abs(configuration.curvature_at(arc)).max())
    outside = _outside(nlp, configuration)
    figures = (
        Shortfall("tip position", float(np.hypot(*(tip - task.goal))), settings.tip_tolerance, "m"),
        Shortfall("tip heading", abs(wrap(heading - goal)), settings.tip_heading_tolerance, "rad"),
        Shortfall("base heading", base_miss, 1e-12, "rad"),
        Shortfall("length", abs(configuration.length - task.length), 1e-9 * task.length, "m"),
        Shortfall("curvature", curvature, task.curvature_limit, "1/m"),
        Shortfall("distance outside the corridor", outside, settings.containment_tolerance, "m"),
    )
    # So written, a figure that is not a number falls short too.
    return tuple(figure for figure in figures if not figure.worst <= figure.limit)


def _outside(nlp: ConfigurationNLP, configuration: Configuration) -> float:
    """Greatest distance of a point of the curve, the stub excepted, from its segment's region [m]."""
    boundaries = configuration.boundaries[len(configuration.segments) - len(nlp.regions) :]
    worst = -np.inf
    for index, start, end in zip(nlp.regions, boundaries[:-1], boundaries[1:], strict=True):
        region = nlp.task.corridor.regions[index]
        points = configuration.positions_at(np.linspace(start, end, nlp.task.settings.check_samples))
        worst = max(worst, float((points @ region.normals.T - region.offsets).max()))
    return max(worst, 0.0)
