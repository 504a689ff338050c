"""A dense check of a configuration against its task, with kinematics that share nothing with the NLP."""

from dataclasses import dataclass

import numpy as np

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.geometry.angles import wrap
from ccm_opt.nlp.multiple_shooting import ConfigurationNLP

POSITION_TOLERANCE = 1e-5
"""Of the tip [m]."""
HEADING_TOLERANCE = 1e-6
"""Of the tip [rad]."""
CONTAINMENT_TOLERANCE = 1e-6
"""By which a sampled point of the curve may lie outside its region [m]."""
_SAMPLES_PER_SEGMENT = 201


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
    task, (tip, heading) = nlp.task, configuration.tip
    goal = heading if task.goal_heading is None else task.goal_heading
    low, high = task.base_heading_range
    base_miss = max(low - configuration.base_heading, configuration.base_heading - high, 0.0)
    arc = np.linspace(0.0, configuration.length, _SAMPLES_PER_SEGMENT * len(configuration.segments))
    figures = (
        Shortfall("tip position", float(np.hypot(*(tip - task.goal))), POSITION_TOLERANCE, "m"),
        Shortfall("tip heading", abs(wrap(heading - goal)), HEADING_TOLERANCE, "rad"),
        Shortfall("base heading", base_miss, 1e-12, "rad"),
        Shortfall("length", abs(configuration.length - task.length), 1e-9 * task.length, "m"),
        Shortfall("curvature", float(np.abs(configuration.curvature_at(arc)).max()), task.curvature_limit, "1/m"),
        Shortfall("distance outside the corridor", _outside(nlp, configuration), CONTAINMENT_TOLERANCE, "m"),
    )
    return tuple(figure for figure in figures if not figure.worst <= figure.limit)


def _outside(nlp: ConfigurationNLP, configuration: Configuration) -> float:
    """Greatest distance of a point of the curve, the stub excepted, from its segment's region [m]."""
    boundaries = configuration.boundaries[len(configuration.segments) - len(nlp.regions) :]
    worst = -np.inf
    for index, start, end in zip(nlp.regions, boundaries[:-1], boundaries[1:], strict=True):
        region = nlp.task.corridor.regions[index]
        points = configuration.positions_at(np.linspace(start, end, _SAMPLES_PER_SEGMENT))
        worst = max(worst, float((points @ region.normals.T - region.offsets).max()))
    return max(worst, 0.0)
