"""The parameters of a problem that may be relaxed, one at a time: how each is read, changed and reported."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import Finding, Relaxation
from ccm_opt.core.length_words import METRES, file_length, in_unit
from ccm_opt.diagnosis.gaps import ROOM_NAMES
from ccm_opt.diagnosis.keyed_poses import tip_places, whole_poses
from ccm_opt.problem import Problem
from ccm_opt.robot.arm import Arm

Read = Callable[[Any], float]
"""A number of a problem, in the plane or in space."""
Write = Callable[[Any, float], Any]
"""A problem with another number, of the same kind as before."""


_FIGURES = 4
"""Figures that a reported value keeps, rounded to the easier side before it is solved. Taste."""
_ROOM_SPARE = 0.02
"""Room beyond radius and clearance in bounds that are made wide enough, as a share of the arm's length. Taste."""
_FAR = 0.05
"""Share of its bound by which a value lies beyond it that does not go without saying: more than the first step."""


@dataclass(frozen=True)
class Parameter:
    """One number of a problem.

    Attributes:
        key: of the problem file.
        easier: +1 when more of it makes the problem easier, −1 when less does.
        read: its value in a problem, SI units and radians.
        write: the problem with another value.
        words: a value with its unit, in a problem.
        scale: what a value is multiplied by to be reported in the unit of ``words``.
        fits: whether it can be changed in a problem.
        unit: what a value is multiplied by to be in SI units; 1 but for shares.
        whole: what the size of a change is compared with; the given value when None.
        bound: the value that it must reach at least as far as is known; None where the findings say.
        tried: values that are tried one after the other, the least change first; None for steps beyond the bound.
        paths_stay: whether a path that was found for one value leads from the start to the goal for others, too.
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
        """Return a value rounded to some figures, to the easier side: so what is reported is what was solved."""
        reported = value * self.scale(problem)
        if reported <= 0.0:
            return 0.0
        digits = _FIGURES - 1 - int(np.floor(np.log10(reported)))
        count = reported * 10.0**digits
        # A value that is round already, up to rounding of its digits, stays.
        count = np.ceil(count - 1e-6) if self.easier > 0 else np.floor(count + 1e-6)
        return float(count / 10.0**digits / self.scale(problem))

    def relaxation(self, problem: Problem, value: float, bound: float | None) -> Relaxation:
        """Return what is reported when a problem was solved with a value."""
        given = self.read(problem)
        sign = "≥" if self.easier > 0 else "≤"
        change = abs(value - given) / max(abs(given if self.whole is None else self.whole), 1e-300)
        words = self.words(problem, value).replace("?", sign, 1)
        if bound is not None and self.bound is None and abs(value - bound) > _FAR * abs(bound):
            # Else the figures of the reason and of what helps against it seem to have nothing to do with each other.
            needed = self.words(problem, bound).rpartition("? ")[2].partition(" (")[0]
            words += f"; what stands in the way asks for {sign} {needed}"
        unit = self.unit(problem)
        return Relaxation(words, self.key, unit * value, None if bound is None else unit * bound, change)


def _with_radius(problem: Problem, radius: float) -> Problem:
    """Return the another radius.

    A mount as long as the radius goes on being so, and solid cylinders stay solid cylinders.
    """
    arm = problem.arm
    mount = radius if arm.mount_length == arm.radius else arm.mount_length
    return replace(problem, arm=_as_cylinders(arm, replace(arm, radius=radius, mount_length=mount)))


def _as_cylinders(old: Arm, new: Arm) -> Arm:
    """Return the new arm with the inertia of solid cylinders where the old arm's is that."""
    given = (old.inertia_axial, old.inertia_transverse)
    if new.radius <= 0.0 or not all(map(np.allclose, given, _cylinder_inertia(old))):
        return new
    axial, transverse = _cylinder_inertia(new)
    return replace(new, inertia_axial=axial, inertia_transverse=transverse)


def _cylinder_inertia(arm: Arm) -> tuple[FloatArray, FloatArray]:
    """Inertia of links that are solid cylinders, about their axes and across them, shape (links,) each [kg m²]."""
    return arm.masses * arm.radius**2 / 2.0, arm.masses * (3.0 * arm.radius**2 + arm.link_length**2) / 12.0


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
    """Return what all values are, or 1 where they differ, so that shares of them are told."""
    return 1.0 if values is None or np.ptp(values) else float(values[0])


def _mass_words(problem: Problem, share: float) -> str:
    if np.ptp(problem.arm.masses):
        return f"arm.masses ? {share:.4g} times what they are"
    return f"arm.link_mass ? {share * problem.arm.masses[0]:.4g} kg"


def _torque_words(problem: Problem, share: float) -> str:
    torque = problem.limits.torque
    unit = "times what it is" if torque is None or np.ptp(torque) else "N m"
    return f"limits.torque ? {share * _uniform(torque):.4g} {unit}"


def _per_file_unit(problem: Problem) -> float:
    """Return what lengths are multiplied by to be in the unit of the problem's file, in which they are rounded."""
    return 1.0 / METRES[problem.length_unit]


def _no_curves(problem: Problem) -> bool:
    """Return whether no end is a curve, whose length would have to change with the arm's."""
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
    lambda _, v: f"the upper end of arm.feed.range ? {file_length(v)}",
    _per_file_unit,
    fits=lambda p: p.arm.feed is not None,
)
LENGTH = Parameter(
    "arm.link_length",
    +1,
    lambda p: p.arm.link_length,
    lambda p, v: replace(p, arm=_as_cylinders(p.arm, replace(p.arm, link_length=v))),
    lambda p, v: f"length ? {file_length(p.arm.links * v)} (arm.link_length = {file_length(v, 6)})",
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
"""All of them, in the order in which they are tried where nothing else decides."""


@dataclass(frozen=True)
class WholeChange:
    """A change that is made as a whole or not at all: something is left out, or the room made wide enough.

    Attributes:
        words: what is reported.
        key: of the problem file.
        value: name of an obstacle, or None.
        changed: the problem with the change.
        term: name of a constraint or cost of the user's that is dropped besides; usually none.
        part: by how much of it less may do, for the problem and the configuration in which the changed one ends, shape
            (c,); None where nothing less is known.
    """

    words: str
    key: str
    value: str | None
    changed: Callable[[Any], Any]
    term: str = ""
    part: Callable[[Any, FloatArray], Parameter | None] = lambda *_: None

    def relaxation(self) -> Relaxation:
        """Return what is reported when the problem was solved with it."""
        return Relaxation(self.words, self.key, self.value)


def without_obstacle(name: str) -> WholeChange:
    """Return the problem without one obstacle."""
    return WholeChange(
        f"obstacle '{name}' removed",
        "workspace.obstacles",
        name,
        lambda problem: replace(problem, workspace=problem.workspace.without(name)),
    )


def without_term(name: str, kind: str) -> WholeChange:
    """Return the problem without one constraint or cost of the user's."""
    return WholeChange(f"{kind} '{name}' dropped", f"{kind}s", name, lambda problem: problem, name)


def wider_room(problem: Problem, findings: tuple[Finding, ...]) -> WholeChange | None:
    """Return the problem in bounds that hold its start and its goals.

    None where other things than a room's sides matter.

    Args:
        problem: what was asked.
        findings: what is proved.
    """
    bounds = problem.workspace.box
    of_room = all(finding.kind == "contact" and ROOM_NAMES.intersection(finding.obstacles) for finding in findings)
    if not findings or not of_room or bounds is None or not problem.workspace.is_box:
        return None
    arm = problem.arm
    need = arm.radius + problem.workspace.clearance + _ROOM_SPARE * arm.length
    places = [arm.joint_positions_at(pose.q) for pose in whole_poses(problem)]
    points = np.concatenate([*places, *(place.goal.position[None] for place in tip_places(problem))])
    step = 10.0 ** np.floor(np.log10(arm.length) - 3.0)
    low = np.floor(np.minimum(points.min(axis=0) - need, bounds[0]) / step) * step
    high = np.ceil(np.maximum(points.max(axis=0) + need, bounds[1]) / step) * step
    # In the unit of the file, into which people copy them.
    unit = problem.length_unit
    corners = [", ".join(f"{in_unit(value, unit):.6g}" for value in corner.tolist()) for corner in (low, high)]
    numbers = ", ".join(corners if arm.dimension == 2 else (f"[{corner}]" for corner in corners))
    return WholeChange(
        f"workspace.bounds = [{numbers}] {unit}",
        "workspace.bounds",
        numbers,
        lambda p: replace(p, workspace=p.workspace.within(np.stack((low, high)))),
    )
