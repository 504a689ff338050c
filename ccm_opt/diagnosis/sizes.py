"""Sizes of an arm that may be searched for, and proofs that no arm of a size, nor any smaller, has a plan.

A proof for one size counts for all beyond it only where the condition that fails is monotone. These are:

- For the length, that the goal is out of reach; that every way that is wide enough is longer than the arm; and that the
  joint limits keep the arm from the goal by an amount that shrinks in proportion to a greater length. An arm cannot be
  compressed, and so what an arm does not reach with all its length, a shorter one of the same shape does not reach.
- For the number of links, the first two: the arm with fewer links is shorter.
- For the radius, that no way is wide enough, and contact of the start or of a goal with a wall. The mount, if it is as
  long as the radius, is taken as that of the thickest arm of the search, so that it excuses at least as much.

Contacts of a straight start with walls, of links with each other, and the curl of an arm that is too long for a near
goal are not monotone: these refute one size, and no other.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import Finding, ProblemError
from ccm_opt.diagnosis.axis_paths import axis_path_exists
from ccm_opt.diagnosis.checks import Check, failed, is_covered, is_goal_closed_off
from ccm_opt.diagnosis.contact import contact_at_poses, contact_at_tips
from ccm_opt.diagnosis.last_link import last_link_is_led_to
from ccm_opt.diagnosis.named_goals import named_poses
from ccm_opt.diagnosis.parameters import LENGTH, RADIUS, Parameter
from ccm_opt.diagnosis.reach import within_bend_limits, within_reach
from ccm_opt.problem import Goal, JointPose, Problem
from ccm_opt.problem.solution.sizes import SizeName

_CLOSE = 1e-3
"""Relative distance from a bound of a proof at which it is tried whether the proof ends there. Heuristic."""
_MOST_PROBES = 14
"""Largest number of sizes for which a proof is tried. Heuristic: a bisection to a percent takes eight."""


@dataclass(frozen=True)
class Size:
    """A size of an arm that may be searched for.

    Attributes:
        name: name of the size.
        parameter: reads and writes it; ``easier`` says in which direction a plan is easier to find.
        checks: conditions that are monotone in the size.
        enough: what is said of a size with a plan.
        beyond: what is said of a size without one.
        nearest: multiple of the given value beyond which no easier value is tried.
        hardest: multiple of the given value beyond which no harder value is tried.
        step: least difference of two values; 0 for lengths.
    """

    name: SizeName
    parameter: Parameter
    checks: tuple[Check, ...]
    enough: str
    beyond: str
    nearest: float
    hardest: float
    step: int = 0

    def at(self, problem: Problem, value: float) -> Problem:
        """Return a problem with another value; its text no longer describes it."""
        changed: Problem = self.parameter.write(problem, value)
        return replace(changed, source="")

    def rounded(self, problem: Problem, value: float) -> float:
        """Return a value rounded to the easier side, as it is reported."""
        if not self.step:
            return self.parameter.rounded(problem, value)
        return float(max(self.step * np.ceil(value / self.step - 1e-9), self.step))

    def farthest(self, problem: Problem, share: float) -> float:
        """Return a multiple of the given value, or a value nearer to the given one if bodies on links allow no other.

        Bodies keep their size, and touch other links where links are too short or too thick.
        """
        given = self.parameter.read(problem)
        value = self.rounded(problem, share * given)
        for _ in range(_MOST_PROBES if problem.arm.rigid_bodies else 0):
            try:
                self.at(problem, value)
            except ProblemError:
                value = self.rounded(problem, 0.5 * (value + given))
            else:
                break
        return value

    def harder(self, one: float, other: float) -> bool:
        """Return whether a plan for the first value is harder to find than for the second."""
        return (one - other) * self.parameter.easier < 0.0

    def close(self, easy: float, hard: float, share: float) -> bool:
        """Return whether two values differ by at most a share of the first, or are next to each other."""
        return abs(easy - hard) <= max(share * abs(easy), float(self.step))


def _with_links(problem: Problem, links: float) -> Problem:
    """Return a problem whose arm has another number of links like those that it has."""
    arm, count = problem.arm, int(links)

    def each(values: FloatArray | float | None) -> FloatArray | float | None:
        return (
            values
            if values is None or np.ndim(values) == 0
            else np.resize(values, count * np.size(values) // arm.links)
        )

    def pose(goal: Goal) -> Goal:
        shape = (count, 2) if arm.dimension == 3 else count
        return goal if goal.for_joints is None else replace(goal.for_joints, bends=np.zeros(shape))

    of_links = {name: each(getattr(arm, name)) for name in _OF_LINKS}
    limits: dict[str, object] = {name: each(getattr(problem.limits, name)) for name in _OF_JOINTS}
    start = pose(problem.start)
    assert isinstance(start, JointPose)  # noqa: S101 - poses stay poses
    return replace(
        problem,
        arm=replace(arm, links=count, **of_links),  # type: ignore[arg-type]
        limits=replace(problem.limits, **limits),  # type: ignore[arg-type]
        start=start,
        goal=pose(problem.goal),
        stops=tuple(replace(stop, goal=pose(stop.goal)) for stop in problem.stops),
    )


_OF_LINKS = ("masses", "inertia_axial", "inertia_transverse", "rotor_inertia", "friction")
_OF_JOINTS = ("velocity", "acceleration", "torque", "jerk")
LINKS = Parameter(
    "arm.links",
    +1,
    lambda p: float(p.arm.links),
    _with_links,
    lambda _, v: f"arm.links ? {v:.0f}",
    paths_stay=False,
)


def _proportional(problem: Problem) -> Iterator[Finding]:
    """Yield the findings on joint limits that a greater length in proportion removes, which hold for all lesser."""
    return (each for each in within_bend_limits(problem) if "arm.link_length" in each.bounds)


def _against_walls(check: Check) -> Check:
    """Return a check without its findings on links that touch each other, which depend on what pairs are checked."""

    def found(problem: Problem) -> Iterator[Finding]:
        return (each for each in check(problem) if each.obstacles)

    return found


SIZES: dict[str, Size] = {
    "length": Size(
        "length",
        LENGTH,
        (within_reach, _proportional, axis_path_exists, last_link_is_led_to),
        "is enough",
        "is too short",
        2.0,
        0.02,
    ),
    "links": Size("links", LINKS, (within_reach, axis_path_exists), "are enough", "are too few", 2.0, 0.02, step=2),
    "radius": Size(
        "radius",
        RADIUS,
        (_against_walls(contact_at_poses), _against_walls(contact_at_tips), axis_path_exists),
        "fits",
        "is too thick",
        0.25,
        4.0,
    ),
}
"""Sizes of an arm, by name."""


def size_of(problem: Problem, find: str) -> Size:
    """Return the size of a given name, for a problem whose arm may have another.

    Raises:
        ProblemError: there is no such size, or the arm, its start or a goal is tied to the size that it has.
    """
    if find not in SIZES:
        raise ProblemError(f"find must be one of {', '.join(SIZES)}, got {find!r}")
    if reasons := tuple(_ties(problem, find)):
        raise ProblemError(
            f"problem '{problem.name}' has no {find} to search for:\n" + "\n".join(f"  {each}" for each in reasons)
        )
    return SIZES[find]


def _ties(problem: Problem, find: str) -> Iterator[str]:
    """Yield a sentence for everything in a problem that is tied to the size of its arm."""
    arm = problem.arm
    if arm.drives is not None:
        yield 'arm.sections with drive = "section", and arm.coupling, are not supported'
    if find == "radius":
        if arm.radius <= 0.0:
            yield "arm.radius is 0: give a radius to begin with"
        return
    if not LENGTH.fits(problem):
        yield "start or goal is given by segments of the arm's length; give a straight start, or joints_deg"
    if find == "links":
        yield from _ties_to_links(problem)


def _ties_to_links(problem: Problem) -> Iterator[str]:
    """Yield a sentence for everything in a problem that is tied to the number of links of its arm."""
    arm, limits = problem.arm, problem.limits
    if arm.proportions is not None:
        yield "arm.links: the links differ; search for the length instead, which lengthens all in proportion"
        return
    for k, body in enumerate(arm.bodies):
        if body.link >= 0:
            where = f"the body is on link {body.link + 1} of {arm.links}"
            yield f"arm.bodies[{k}].link: {where}; search for the length instead"
    for pose in named_poses(problem):
        if np.any(pose.q[arm.coordinates.bends]):
            yield f'{pose.key}: {pose.name} bends the joints of {arm.links} links; make it shape = "straight"'
    each = [("arm", name, getattr(arm, name)) for name in _OF_LINKS]
    each += [("limits", name, getattr(limits, name)) for name in _OF_JOINTS]
    for table, name, values in each:
        if values is not None and np.ndim(values) and np.ptp(np.reshape(values, (arm.links, -1)), axis=0).any():
            yield f"{table}.{name} differs between links, so that those of further links are not known"


@dataclass(frozen=True)
class Proofs:
    """Proofs that there is no plan for an arm of a size, nor for any arm beyond it.

    Attributes:
        problem: the problem, with the arm at its place.
        size: the size.
        hardest: the value beyond which none is tried.
        mount: length of the mount of the thickest arm that the proofs are to hold for [m].
        seconds: CPU time limit of one proof [s].
    """

    problem: Problem
    size: Size
    hardest: float
    mount: float
    seconds: float

    def relaxed(self, value: float) -> Problem:
        """Return the problem with another size, and the mount of the thickest arm."""
        changed = self.size.at(self.problem, value)
        mount = max(self.mount, changed.arm.mount_length)
        return replace(changed, arm=replace(changed.arm, mount_length=mount))

    def findings(self, value: float) -> tuple[Finding, ...]:
        """Return the findings that prove that no arm of a size, nor any beyond it, has a plan; with their causes."""
        if not is_covered(self.problem.arm):
            return ()
        found = failed(self.relaxed(value), self.size.checks, Deadline.after(self.seconds))
        return tuple(each for each in found if each.proved)

    def holds(self, value: float) -> tuple[bool, tuple[float, ...]]:
        """Return whether there is a proof for a value, and at what values it may end; without causes in space."""
        if not is_covered(self.problem.arm):
            return False, ()
        if self.problem.dimension == 3:
            quick = tuple(each for each in self.size.checks if each is not axis_path_exists)
            relaxed = self.relaxed(value)
            found = failed(relaxed, quick)
            closed = any(each.proved for each in found) or is_goal_closed_off(relaxed, Deadline.after(self.seconds))
        else:
            found = self.findings(value)
            closed = bool(found)
        ends = [
            each.bounds[key] for each in found if each.proved for key in _KEYS[self.size.name] if key in each.bounds
        ]
        return closed, tuple(ends)

    def easiest(self, easy: float, share: float) -> float | None:
        """Return the easiest value for which a proof was found; None without any.

        Args:
            easy: value for which there is no proof.
            share: relative precision.
        """
        size, hard = self.size, self.hardest
        closed, ends = self.holds(hard)
        if not closed:
            return None
        for _ in range(_MOST_PROBES):
            if size.close(easy, hard, share):
                break
            # A proof often says where it ends: close to that value two more decide it.
            near = (
                end * (1.0 + sign * _CLOSE) for end in ends for sign in (size.parameter.easier, -size.parameter.easier)
            )
            value = next((each for each in near if size.harder(each, easy) and size.harder(hard, each)), None)
            value = 0.5 * (hard + easy) if value is None else value
            value = size.step * float(np.round(value / size.step)) if size.step else value
            closed, found = self.holds(value)
            if closed:
                hard, ends = value, found
            else:
                easy = value
        return hard


_KEYS = {"length": ("arm.link_length",), "links": (), "radius": ("arm.radius",)}
"""Keys of the bounds of findings that are values of a size."""
