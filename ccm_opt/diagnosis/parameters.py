"""Values of a problem that may be relaxed, one at a time, and how each is read, changed and reported."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Finding, Relaxation
from ccm_opt.core.length_words import METRES, file_length, in_unit
from ccm_opt.diagnosis.gaps import WORKSPACE_NAMES
from ccm_opt.diagnosis.named_goals import named_poses, named_tip_goals
from ccm_opt.diagnosis.sections import Section, as_cylinders, sections_of, with_section
from ccm_opt.problem import Problem

Read = Callable[[Any], float]
"""Function that reads a number from a problem, in the plane or in space."""
Write = Callable[[Any, float], Any]
"""Function that returns a problem in which a number is replaced by another."""


_FIGURES = 4
"""Significant digits of a reported value, which is rounded to the easier side before the problem is solved.
Heuristic."""
_BOUNDS_MARGIN = 0.02
"""Margin beyond radius and clearance when bounds are widened, as a fraction of the arm's length. Heuristic."""
_FAR = 0.05
"""Relative distance from its bound above which a value is reported together with the bound.

Derived: more than the first step beyond the bound that is tried.
"""


@dataclass(frozen=True)
class Parameter:
    """A numerical value of a problem that can be relaxed to make the problem easier.

    Attributes:
        key: key of the value in the problem file.
        easier: +1 if larger values make the problem easier, −1 if smaller values do.
        read: returns the value in a problem, in SI units and radians.
        write: returns the problem with another value.
        words: returns the text of a value with its unit.
        scale: returns the factor from a value to the unit of ``words``.
        fits: returns whether the parameter can be changed in a problem.
        unit: returns the factor from a value to SI units; 1 except for values that are fractions.
        whole: value by which a change is divided to give its relative size; the given value if None.
        bound: value that must at least be reached, as far as is known; None if findings provide the bound.
        tried: values to be tried in turn, the least change first; None for steps beyond the bound.
        paths_stay: whether a path found for one value also connects start and goal for other values.
    """

    key: str
    easier: int
    read: Read
    write: Write
    words: Callable[[Any, float], str]
    scale: Read = lambda _: 1.0
    fits: Callable[[Any], bool] = lambda _: True
    unit: Read = lambda _: 1.0
    whole: float | None = None
    bound: float | None = None
    tried: tuple[float, ...] | None = None
    paths_stay: bool = True

    def rounded(self, problem: Problem, value: float) -> float:
        """Return a value rounded in its reported unit to the easier side, so that what is reported is solved."""
        reported = value * self.scale(problem)
        if reported <= 0.0:
            return 0.0
        digits = _FIGURES - 1 - int(np.floor(np.log10(reported)))
        count = reported * 10.0**digits
        # A value that is already round, up to floating-point error, must not move to the next one.
        count = np.ceil(count - 1e-6) if self.easier > 0 else np.floor(count + 1e-6)
        return float(count / 10.0**digits / self.scale(problem))

    def requirement(self, problem: Problem, value: float) -> str:
        """Return text saying that the parameter must be at least, or at most, a given value."""
        return self.words(problem, value).replace("?", "≥" if self.easier > 0 else "≤", 1)

    def relaxation(self, problem: Problem, value: float, bound: float | None) -> Relaxation:
        """Return the relaxation to report for a problem that was solved with a changed value.

        Args:
            problem: the original problem.
            value: the value with which the changed problem was solved.
            bound: the value that must at least be reached, if known.
        """
        given = self.read(problem)
        change = abs(value - given) / max(abs(given if self.whole is None else self.whole), 1e-300)
        words = self.words(problem, value).replace("?", "=", 1)
        if bound is not None and self.bound is None and abs(value - bound) > _FAR * abs(bound):
            # Without the bound, the numbers of the reason and of the relaxation would seem unrelated.
            needed = self.words(problem, bound).rpartition("? ")[2].partition(" (")[0]
            words += f"; the reason alone requires at {'least' if self.easier > 0 else 'most'} {needed}"
        unit = self.unit(problem)
        return Relaxation(words, self.key, unit * value, None if bound is None else unit * bound, change)


def _with_radius(problem: Problem, radius: float) -> Problem:
    """Return a problem with another radius of the arm.

    A mount whose length equals the radius changes with the radius; inertias of solid cylinders are recomputed.
    """
    arm = problem.arm
    mount = radius if arm.mount_length == arm.radius else arm.mount_length
    return replace(problem, arm=as_cylinders(arm, replace(arm, radius=radius, mount_length=mount)))


def _with_feed_range(problem: Problem, high: float) -> Problem:
    feed = problem.arm.feed
    return problem if feed is None else replace(problem, arm=replace(problem.arm, feed=replace(feed, high=high)))


def _with_torque(problem: Problem, share: float) -> Problem:
    limits = problem.limits
    torque = None if limits.torque is None else share * limits.torque
    return replace(problem, limits=replace(limits, torque=torque))


def _with_mass(problem: Problem, share: float) -> Problem:
    arm = problem.arm
    parts = {name: share * getattr(arm, name) for name in ("masses", "inertia_axial", "inertia_transverse")}
    return replace(problem, arm=replace(arm, **parts))


def _uniform(values: FloatArray | None) -> float:
    """Return the common value of an array; 1 if values differ or are missing, so that factors are reported."""
    return 1.0 if values is None or np.ptp(values) else float(values[0])


def _mass_words(problem: Problem, share: float) -> str:
    if np.ptp(problem.arm.masses):
        return f"arm.masses ? {share:.4g} times the given masses"
    return f"arm.link_mass ? {share * problem.arm.masses[0]:.4g} kg"


def _torque_words(problem: Problem, share: float) -> str:
    torque = problem.limits.torque
    unit = "times the given torques" if torque is None or np.ptp(torque) else "N m"
    return f"limits.torque ? {share * _uniform(torque):.4g} {unit}"


def _per_file_unit(problem: Problem) -> float:
    """Return the factor from metres to the length unit of the problem file, in which reported lengths are rounded."""
    return 1.0 / METRES[problem.length_unit]


def _no_curves(problem: Problem) -> bool:
    """Return whether neither start nor goal is a curve, whose length would have to change with the arm's."""
    return not any(getattr(end, "curve", None) for end in (problem.start, problem.goal))


RADIUS = Parameter(
    "arm.radius",
    -1,
    lambda p: p.arm.radius,
    _with_radius,
    lambda _, v: f"arm.radius ? {file_length(v)}",
    _per_file_unit,
)
CLEARANCE = Parameter(
    "workspace.clearance",
    -1,
    lambda p: p.workspace.clearance,
    lambda p, v: replace(p, workspace=replace(p.workspace, clearance=v)),
    lambda _, v: f"workspace.clearance ? {file_length(v)}",
    _per_file_unit,
    lambda p: p.workspace.clearance > 0.0,
)
FEED_RANGE = Parameter(
    "arm.feed.range",
    +1,
    lambda p: p.arm.base_range[1],
    _with_feed_range,
    lambda _, v: f"upper end of arm.feed.range ? {file_length(v)}",
    _per_file_unit,
    fits=lambda p: p.arm.feed is not None,
)
LENGTH = Parameter(
    "arm.link_length",
    +1,
    lambda p: p.arm.link_length,
    lambda p, v: replace(p, arm=as_cylinders(p.arm, replace(p.arm, link_length=v))),
    lambda p, v: f"arm length ? {file_length(p.arm.links * v)} (arm.link_length = {file_length(v, 6)})",
    lambda p: p.arm.links * _per_file_unit(p),
    _no_curves,
    paths_stay=False,
)
JOINT_LIMIT = Parameter(
    "arm.joint_limit_deg",
    +1,
    lambda p: p.arm.joint_limit,
    lambda p, v: replace(p, arm=replace(p.arm, joint_limit=v)),
    lambda _, v: f"arm.joint_limit_deg ? {np.rad2deg(v):.4g}°",
    lambda _: float(np.rad2deg(1.0)),
)
BASE_LIMIT = Parameter(
    "arm.base_limit_deg",
    +1,
    lambda p: p.arm.base_limit,
    lambda p, v: replace(p, arm=replace(p.arm, base_limit=v)),
    lambda _, v: f"arm.base_limit_deg ? {np.rad2deg(v):.4g}°",
    lambda _: float(np.rad2deg(1.0)),
)
TORQUE = Parameter(
    "limits.torque",
    +1,
    lambda _: 1.0,
    _with_torque,
    _torque_words,
    lambda p: _uniform(p.limits.torque),
    lambda p: p.limits.torque is not None,
    lambda p: _uniform(p.limits.torque),
)
MASS = Parameter(
    "arm.link_mass",
    -1,
    lambda _: 1.0,
    _with_mass,
    _mass_words,
    lambda p: _uniform(p.arm.masses),
    lambda p: p.limits.torque is not None,
    lambda p: _uniform(p.arm.masses),
)
PARAMETERS = (RADIUS, CLEARANCE, FEED_RANGE, LENGTH, JOINT_LIMIT, BASE_LIMIT, TORQUE, MASS)
"""All parameters that may be relaxed, in the order in which they are tried if nothing else decides."""
_OF_LINKS = (RADIUS, LENGTH, JOINT_LIMIT)
"""Parameters of links, which every section of an arm of unequal links has for itself."""


def parameters_of(problem: Problem) -> tuple[Parameter, ...]:
    """Return the parameters of a problem that may be relaxed: those of links section by section, if links differ."""
    if problem.arm.proportions is None:
        return PARAMETERS
    shared = tuple(each for each in PARAMETERS if each not in _OF_LINKS)
    return (*(of for each in sections_of(problem.arm) for of in _of_section(each)), *shared)


def _of_section(section: Section) -> Iterator[Parameter]:
    """Yield the radius, link length and joint limit of a section; the greatest, of links that differ within it."""
    links = slice(section.first, section.end)

    def scaled(key: str, read: Read) -> Write:
        return lambda p, v: replace(p, arm=with_section(p.arm, section, key, v / read(p)))

    def limit(problem: Problem) -> float:
        limits = problem.arm.bend_limits.reshape(problem.arm.links, -1)[max(section.first, 1) : section.end]
        return float(np.max(limits, initial=0.0))

    def radius(problem: Problem) -> float:
        return float(np.max(problem.arm.radii[links]))

    def length(problem: Problem) -> float:
        return float(problem.arm.lengths[section.first])

    thick, long, bent = (section.key(key) for key in ("radius", "link_length", "joint_limit_deg"))
    yield replace(
        RADIUS,
        key=thick,
        read=radius,
        write=scaled("radius", radius),
        words=lambda _, v: f"{thick} ? {file_length(v)}",
        fits=lambda p: radius(p) > 0.0,
    )
    yield replace(
        LENGTH,
        key=long,
        read=length,
        write=scaled("link_length", length),
        words=lambda _, v: f"{long} ? {file_length(v, 6)}",
        scale=_per_file_unit,
    )
    yield replace(
        JOINT_LIMIT,
        key=bent,
        read=limit,
        write=scaled("joint_limit_deg", limit),
        words=lambda _, v: f"{bent} ? {np.rad2deg(v):.4g}°",
        fits=lambda p: limit(p) > 0.0,
    )


@dataclass(frozen=True)
class WholeChange:
    """A change of a problem that is made completely or not at all, such as omitting an obstacle.

    Attributes:
        words: description to report.
        key: key of the changed part in the problem file.
        value: name of the obstacle or value concerned, or None.
        changed: returns the problem with the change.
        term: name of a user-defined constraint or cost that is dropped as well; usually empty.
        part: returns a parameter for a smaller change, given the problem and the final configuration, shape (c,), of
            the plan for the changed problem; None if no smaller change is known.
    """

    words: str
    key: str
    value: str | None
    changed: Callable[[Any], Any]
    term: str = ""
    part: Callable[[Any, FloatArray], Parameter | None] = lambda *_: None

    def relaxation(self) -> Relaxation:
        """Return the relaxation to report if the problem was solved with this change."""
        return Relaxation(self.words, self.key, self.value)


def without_obstacle(name: str) -> WholeChange:
    """Return the change that removes the obstacle with a given name."""
    return WholeChange(
        f"obstacle '{name}' removed",
        "workspace.obstacles",
        name,
        lambda problem: replace(problem, workspace=problem.workspace.without_obstacle(name)),
    )


def without_term(name: str, kind: str) -> WholeChange:
    """Return the change that drops the user-defined constraint or cost with a given name."""
    return WholeChange(f"{kind} '{name}' dropped", f"{kind}s", name, lambda problem: problem, name)


def larger_bounds(problem: Problem, findings: tuple[Finding, ...]) -> WholeChange | None:
    """Return the change that widens the workspace's bounds to contain the start and the goals.

    The result is None unless all findings are contacts with the sides of a box-shaped workspace.

    Args:
        problem: the problem.
        findings: the proved findings.
    """
    bounds = problem.workspace.box
    of_clearance = all(
        finding.kind == "contact" and WORKSPACE_NAMES.intersection(finding.obstacles) for finding in findings
    )
    if not findings or not of_clearance or bounds is None or not problem.workspace.is_box:
        return None
    arm = problem.arm
    need = arm.radius + problem.workspace.clearance + _BOUNDS_MARGIN * arm.length
    places = [arm.joint_positions_at(pose.q) for pose in named_poses(problem)]
    points = np.concatenate([*places, *(place.goal.position[None] for place in named_tip_goals(problem))])
    step = 10.0 ** np.floor(np.log10(arm.length) - 3.0)
    low = np.floor(np.minimum(points.min(axis=0) - need, bounds[0]) / step) * step
    high = np.ceil(np.maximum(points.max(axis=0) + need, bounds[1]) / step) * step
    # Reported in the unit of the problem file, so that users can copy the values.
    unit = problem.length_unit
    corners = [", ".join(f"{in_unit(value, unit):.6g}" for value in corner.tolist()) for corner in (low, high)]
    numbers = ", ".join(corners if arm.dimension == 2 else (f"[{corner}]" for corner in corners))
    return WholeChange(
        f"workspace.bounds = [{numbers}] {unit}",
        "workspace.bounds",
        numbers,
        lambda p: replace(p, workspace=p.workspace.within(np.stack((low, high)))),
    )
