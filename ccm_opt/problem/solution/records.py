"""Records stored with a plan: planning attempts, goal pose, clearance, tolerated errors, and simulation outcome."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.configuration import Curve


@dataclass(frozen=True)
class ToleratedError:
    """The maximum error of one kind under which a plan remains collision-free.

    Attributes:
        name: quantity in error: "joints", "link lengths", "base heading", "base position" or "walls", certified for
            errors of any sign that may vary over time; "payload" or "friction", determined by simulation.
        size: maximum magnitude of the error, in ``unit``.
        unit: "rad", "m", "kg" or "N m s/rad".
        where: what limits the error, in words: the link, the obstacle or second link, and the time of a contact, or the
            outcome of a simulation.
        time: time of the limiting contact [s]; None if no contact limits the error.
        link: number of the link in contact, from 1; None if no contact limits the error.
        worst: sign of the error of every joint angle, in the combination that leads to contact at the smallest
            magnitude. An arm of n links has n entries, in space 2 n; an entry is 0 where the sign has no effect.
        place: point on the axis of the link in contact, 2 or 3 coordinates [m]; empty if no contact limits the
            error.
        limited: whether a contact or a simulation limits the error; if False, ``size`` is the largest error that was
            checked, so a lower bound.
    """

    name: str
    size: float
    unit: str
    where: str
    time: float | None = None
    link: int | None = None
    worst: tuple[float, ...] = ()
    place: tuple[float, ...] = ()
    limited: bool = True


@dataclass(frozen=True)
class TryRecord:
    """The outcome of one of several planning attempts, which differ in their seeds.

    Attributes:
        seed: seed of the attempt.
        duration: duration of the motion found [s]; None if no motion was found.
        gap: minimum clearance of the motion beyond the required clearance [m]; None if no motion was found.
        reason: reason why no motion was found; empty if one was found.
        taken: whether the motion of this attempt became the plan.
    """

    seed: int
    duration: float | None
    gap: float | None
    reason: str = ""
    taken: bool = False


SimulationOutcome = Literal["followed", "saturated", "strayed", "touched", "diverged", "not simulated", "not modelled"]


@dataclass(frozen=True)
class SimulationVerdict:
    """Outcome of a simulation: whether the simulated arm followed the plan, and if not, when and why.

    The plan itself is verified independently of the simulation.

    Attributes:
        outcome: "followed"; "saturated", a drive reached its effort limit; "strayed", a joint deviated far from the
            plan, by default 0.1 rad; "touched", the arm collided with an obstacle or itself; "diverged", tracking was
            lost and the simulation stopped; "not simulated", no step was simulated; "not modelled", as arms of this
            kind cannot be simulated.
        step: integration step of the simulation [s].
        reason: sentence that names joint or link, time and cause of the failure; empty if the arm followed.
        joint: name of the revolute joint, or of the feed axis, that failed; empty for none.
        link: number of the link that collided, from 1; None for none.
        obstacle: name of the obstacle that the link touched, or the other link in words; empty for none.
        time: time at which the failure began [s]; None if the arm followed or was not simulated.
        advice: possible remedies, most promising first.
    """

    outcome: SimulationOutcome
    step: float
    reason: str = ""
    joint: str = ""
    link: int | None = None
    obstacle: str = ""
    time: float | None = None
    advice: tuple[str, ...] = ()

    @property
    def is_run(self) -> bool:
        """Whether any step was simulated."""
        return self.outcome not in {"not simulated", "not modelled"}

    @property
    def is_failure(self) -> bool:
        """Whether the arm did not follow the plan, or could not be simulated although its dynamics are modelled."""
        return self.outcome not in {"followed", "not modelled"}

    @property
    def followed(self) -> bool:
        """Whether the simulated arm followed the plan without saturation and without collision."""
        return self.outcome == "followed"


FOLLOWED = SimulationVerdict("followed", 0.0)
"""Outcome of a simulation in which the arm followed the plan; also the default of a motion that was not assessed."""


@dataclass(frozen=True, eq=False, kw_only=True)
class GoalPoseRecord:
    """Solution of the nonlinear program (NLP) for a goal pose, possibly for an arm with fewer links than the problem's.

    Attributes:
        reached: whether the motion ends in this pose.
        reason: reason why the motion does not end in this pose; empty if it does.
        configuration: bend angles of all joints, then any feed, shape (c,) [rad, m].
        curve: backbone curve that the links follow.
        gap: minimum clearance beyond the required clearance, capped at ``wanted_gap`` [m].
        wanted_gap: preferred clearance beyond the required clearance, above which more has no effect on the cost [m].
        costs: weighted terms of the objective by name; they sum to the objective.
        multipliers: Lagrange multipliers of the active constraints by name, the largest first. Each is the rate at
            which the objective decreases as the constraint is relaxed, per arm length, per radian, or per unit of a
            user's constraint.
        iterations: number of iterations of the solver.
        size: number of variables and number of scalar constraints.
        status: return status of the solver.
        tried: number of poses optimised, including this one.
    """

    reached: bool
    reason: str
    configuration: FloatArray
    curve: Curve
    gap: float
    wanted_gap: float
    costs: Mapping[str, float]
    multipliers: Mapping[str, float]
    iterations: int
    size: tuple[int, int]
    status: str
    tried: int = 1

    @property
    def cost(self) -> float:
        """Value of the objective at the solution."""
        return float(sum(self.costs.values()))


# Cause of a clearance below the preferred one: the start pose, an intermediate or the final goal, or a passage between.
ShortCause = Literal["start", "stop", "goal", "passage"]
# Cause of an upper bound on the minimum clearance of any motion.
GapBound = Literal["wanted gap", "start", "goal", "passage"]
# What keeps the least clearance on the way from growing, in the optimisation of a motion.
ClearanceLimit = Literal[
    "walls",
    "links",
    "joint limits",
    "feed",
    "base axes",
    "goal",
    "via places",
    "constraints",
    "costs",
    "length",
    "steps",
    "time",
    "smooth path",
    "path of the tip",
    "not optimised",
]


@dataclass(frozen=True)
class NearPlace:
    """The clearance between one link and the nearest obstacle or link, at one time.

    Attributes:
        gap: distance between the surfaces, for an obstacle minus the required clearance [m]; the search distance if
            nothing is nearer.
        wanted: preferred clearance of this pair [m]; less than the plan's preferred clearance for two links that are
            few joints apart.
        time: time of this clearance [s].
        link: number of the link, from 1; 0 if nothing is within the search distance.
        obstacle: name of the obstacle; empty if the other body is a link.
        second_link: number of the other link, from 1; 0 if the other body is an obstacle.
        name: name of the link in messages: its number, its section if that bends evenly, or the body on it; empty for
            its number.
        second_name: that of the other link.
    """

    gap: float
    wanted: float
    time: float
    link: int
    obstacle: str = ""
    second_link: int = 0
    name: str = ""
    second_name: str = ""

    @property
    def pair(self) -> str:
        """Both bodies in words, for example "link 3 to 'post'", or "section 2 to the tool"."""
        if not self.link:
            return "no obstacle within range"
        second = self.second_name or f"link {self.second_link}"
        other = second if self.second_link else f"'{self.obstacle}'"
        return f"{self.name or f'link {self.link}'} to {other}"


@dataclass(frozen=True)
class ShortStretch:
    """A time interval of a motion in which the clearance is below the preferred clearance.

    Attributes:
        begin: time of the first sample of the interval [s].
        end: time of the last sample of the interval [s].
        nearest: bodies and time of the largest shortfall.
        cause: cause of the shortfall.
    """

    begin: float
    end: float
    nearest: NearPlace
    cause: ShortCause


@dataclass(frozen=True)
class PossibleGap:
    """An upper bound on the minimum clearance of any motion that solves the problem; not necessarily attained.

    Attributes:
        value: the bound [m].
        by: cause of the bound.
        walls: names of the two obstacles that determine the bound, which then holds for motions between them; empty
            if the bound holds for all motions.
    """

    value: float
    by: GapBound
    walls: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class ClearanceRecord:
    """The clearance of a motion over time, at N samples.

    Attributes:
        time: times of the samples, including both ends and all stops of the motion, shape (N,) [s].
        wanted: preferred clearance beyond the required clearance [m]; 0 if none was requested.
        clearance: required distance between arm and obstacles, which is subtracted from distances to obstacles [m].
        wall_gaps: minimum clearance to obstacles, beyond the required clearance, shape (N,) [m].
        self_gaps: minimum distance between two links, shape (N,) [m].
        reach: search distance, at which the arrays are capped [m].
        nearest: minimum clearance of the whole motion, including times between samples.
        ends: minimum clearance at the start, at every stop and at the goal, in order.
        short: time intervals with less than the preferred clearance, in order.
        possible: upper bound on the clearance of any motion; None if unknown.
        price: additional duration compared with a plan without preferred clearance [s]; None if unknown.
        limited_by: for each leg with less than the preferred clearance between its ends, what kept the clearance from
            growing; empty if unknown.
    """

    time: FloatArray
    wanted: float
    clearance: float
    wall_gaps: FloatArray
    self_gaps: FloatArray
    reach: float
    nearest: NearPlace
    ends: tuple[NearPlace, ...]
    short: tuple[ShortStretch, ...] = ()
    possible: PossibleGap | None = None
    price: float | None = None
    limited_by: tuple[ClearanceLimit, ...] = ()

    @property
    def gaps(self) -> FloatArray:
        """Minimum clearance to obstacles and between links, at every sample, shape (N,) [m]."""
        return np.minimum(self.wall_gaps, self.self_gaps)

    @property
    def at_start(self) -> NearPlace:
        """Minimum clearance in the start pose, an upper bound for any motion from this pose."""
        return self.ends[0]

    @property
    def at_goal(self) -> NearPlace:
        """Minimum clearance in the final pose."""
        return self.ends[-1]
