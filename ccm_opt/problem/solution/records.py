"""Records kept with a plan: tries, goal pose, clearance, survived errors and the verdict of the simulation."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.configuration import Curve


@dataclass(frozen=True)
class SurvivedError:
    """The largest error of one kind under which a plan stays collision-free.

    Attributes:
        name: quantity in error: "joints", "link lengths", "base heading", "base position" or "walls", certified for
            errors of any sign that may vary with time; "payload" or "friction", found by simulation.
        size: largest error survived, in ``unit``.
        unit: "rad", "m", "kg" or "N m s/rad".
        where: limiting link, the obstacle or second link, and time, or the limiting verdict of the simulation, in
            words.
        time: time of the limiting contact [s]; None when nothing limits the error.
        link: number of the limiting link, from 1; None when none does.
        worst: signs of the errors of all bends, in the combination that leads to contact at the smallest error, shape
            (links,), in space (2 links,); 0 where the sign does not matter.
        place: limiting point on the link's axis, shape (2,), in space (3,) [m]; empty when nothing limits the error.
        limited: whether something limits the error; if not, larger errors were not checked.
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
    """The outcome of one of several tries at a problem, which differ in their seeds.

    Attributes:
        seed: seed of the try.
        duration: duration of the motion found [s]; None when the try found no motion.
        gap: least gap of the motion beyond the required clearance [m]; None when the try found no motion.
        reason: why the try found no motion; empty when it found one.
        taken: whether the motion of this try became the plan.
    """

    seed: int
    duration: float | None
    gap: float | None
    reason: str = ""
    taken: bool = False


SimulationOutcome = Literal["followed", "saturated", "strayed", "touched", "diverged", "not simulated"]


@dataclass(frozen=True)
class SimulationVerdict:
    """Whether the simulated arm followed its plan; the plan itself is verified independently of the simulation.

    Attributes:
        outcome: "followed"; "saturated", a drive met its limit; "strayed", a joint was far off its plan, 0.1 rad by
            default; "touched", the arm met a wall or itself; "diverged", the arm left the plan for good, and the run
            was stopped; "not simulated", no step was run.
        step: integration step of the simulation on which the verdict rests [s].
        reason: one sentence that names the joint or link, the time and the cause; empty when followed.
        joint: name of the revolute, or of the base axis, whose drive was at fault; empty for none.
        link: number of the link that touched, counted from 1; None when none did.
        obstacle: name of the wall that the link touched, or the other link's number in words; empty for none.
        time: when the fault began [s]; None when followed or not simulated.
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
    def followed(self) -> bool:
        """Whether the arm followed its plan with effort to spare and without contact."""
        return self.outcome == "followed"


FOLLOWED = SimulationVerdict("followed", 0.0)
"""Default verdict of a run that was not judged."""


@dataclass(frozen=True, eq=False, kw_only=True)
class GoalPoseRecord:
    """Record of the goal-pose NLP's solution; an arm of many links may have been solved with fewer.

    Attributes:
        reached: whether the motion ends in this pose.
        reason: why the motion does not end in this pose, in words; empty when it does.
        configuration: bends of every joint, and the feed where there is one, shape (c,) [rad, m].
        curve: the curve that the links follow.
        gap: least clearance of any link beyond radius and required clearance, capped at the preferred clearance [m].
        wanted_gap: clearance beyond radius and required clearance above which the objective rewards no more [m].
        costs: weighted terms of the objective by name; they sum to the objective.
        multipliers: multipliers of the constraints that shape the pose, by name, the largest first: the decrease of
            the objective if the constraint were relaxed by one unit (one arm's length, one radian, one unit of the
            user's).
        iterations: iterations of the solver.
        size: numbers of variables and constraint rows.
        status: the solver's return status.
        tried: number of poses solved for, including this one.
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
        """Value of the objective."""
        return float(sum(self.costs.values()))


# Why a stretch of a motion has less than the preferred clearance: a pose at which the arm rests is that tight, or the
# way is.
ShortCause = Literal["start", "stop", "goal", "passage"]
# What bounds the least gap that any motion can have.
GapBound = Literal["wanted gap", "start", "goal", "passage"]


@dataclass(frozen=True)
class NearPlace:
    """The gap between one link and the nearest wall or link, at one time.

    Attributes:
        gap: distance between the surfaces, for a wall less the required clearance [m]; the search distance where
            nothing is within it.
        wanted: preferred gap of this pair [m]; links that are close along the arm cannot have the full preferred
            clearance.
        time: time of this gap [s].
        link: number of the link, from 1; 0 where nothing is within the search distance.
        obstacle: name of the wall; empty where the other body is a link.
        second_link: number of the other link, from 1; 0 where the other body is a wall.
    """

    gap: float
    wanted: float
    time: float
    link: int
    obstacle: str = ""
    second_link: int = 0

    @property
    def pair(self) -> str:
        """Both bodies in words."""
        if not self.link:
            return "no obstacle within range"
        other = f"link {self.second_link}" if self.second_link else f"'{self.obstacle}'"
        return f"link {self.link} to {other}"


@dataclass(frozen=True)
class ShortStretch:
    """A stretch of the motion with less than the preferred clearance.

    Attributes:
        begin: time of its first sample [s].
        end: time of its last sample [s].
        nearest: the place in the stretch with the largest shortfall.
        cause: why the gap falls short.
    """

    begin: float
    end: float
    nearest: NearPlace
    cause: ShortCause


@dataclass(frozen=True)
class PossibleGap:
    """An upper bound on the least gap of any motion, which perhaps no motion attains.

    Attributes:
        value: the bound [m].
        by: what determines the bound, in words.
        walls: names of the two walls that determine the bound, which then holds for motions between them; empty where
            it holds for all motions.
    """

    value: float
    by: GapBound
    walls: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class ClearanceRecord:
    """The clearance of a timed motion over time, computed by ``driver.clearance_over_time``.

    Attributes:
        time: times of the samples, the motion's ends and stops among them, shape (N,) [s].
        wanted: preferred clearance [m]; 0 when none was requested.
        clearance: required distance between the surfaces of arm and walls, from which gaps to walls are counted [m].
        wall_gaps: least gap to a wall at the samples, shape (N,) [m].
        self_gaps: least gap between two links at the samples, shape (N,) [m].
        reach: search distance, at which the gaps in the arrays are capped [m].
        nearest: the least gap of the whole motion, including times between samples.
        ends: the least gap at the start, at every stop and at the goal, in order.
        short: stretches with less than the preferred clearance, in order.
        possible: upper bound on the attainable gap; None where it is not known.
        price: time by which the motion takes longer than the same plan without a preferred clearance [s]; None where
            this is not known.
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

    @property
    def gaps(self) -> FloatArray:
        """Least gap to anything at the samples, shape (N,) [m]."""
        return np.minimum(self.wall_gaps, self.self_gaps)

    @property
    def at_start(self) -> NearPlace:
        """The least gap of the start pose, which bounds the least gap of any motion from this pose."""
        return self.ends[0]

    @property
    def at_goal(self) -> NearPlace:
        """The least gap of the final pose."""
        return self.ends[-1]
