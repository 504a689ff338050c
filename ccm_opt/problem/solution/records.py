"""Records of what was tried, verified and measured about a plan."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.robot.configuration import Curve


@dataclass(frozen=True)
class SurvivedError:
    """The largest error of one kind with which a plan keeps clear of everything.

    Attributes:
        name: what is wrong: "joints", "link lengths", "base heading", "base position" or "walls", certified for errors
            of any sign that may change with time; "payload" or "friction", found by simulations.
        size: the largest error that is survived, in ``unit``.
        unit: "rad", "m", "kg" or "N m s/rad".
        where: link, obstacle or link, and time that limit it, or the verdict that does, in words.
        time: when [s]; None when nothing limits it.
        link: number of the link that limits it, from 1; None when none does.
        worst: signs of the errors of all bends that lead there soonest, shape (links,), in space (2 links,); 0 where
            they do not matter.
        place: where that is on the link's axis, shape (2,), in space (3,) [m]; empty when nothing limits it.
        limited: whether something limits it; if not, it is only that larger errors were not looked at.
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
    """What came of one of several tries of a problem, which differ in their seeds.

    Attributes:
        seed: of the try.
        duration: of its motion [s]; None when there is none.
        gap: least gap beyond the clearance that the motion keeps [m]; None when there is none.
        reason: why there is no motion, or empty.
        taken: whether it is the plan.
    """

    seed: int
    duration: float | None
    gap: float | None
    reason: str = ""
    taken: bool = False


SimulationOutcome = Literal["followed", "saturated", "strayed", "touched", "diverged", "not simulated"]


@dataclass(frozen=True)
class SimulationVerdict:
    """Whether the simulated arm followed its plan, which is verified whatever the simulation says.

    Attributes:
        outcome: "followed"; "saturated", a drive met its limit; "strayed", some joint was far off its plan, 0.1 rad
            by default; "touched", the arm met a wall or itself; "diverged", the arm left the plan for good, and the run
            was stopped; "not simulated", no step was run.
        step: integration step of the run that is judged [s].
        reason: one sentence: which joint or link, when, and why; empty when followed.
        joint: name of the revolute, or of the axis that carries the base, whose drive was at fault; empty for none.
        link: number of the link that touched, counted from 1; None when none did.
        obstacle: name of the wall, or number of the other link in words, that it touched; empty for none.
        time: when it began [s], None when followed or not simulated.
        advice: what would help, most promising first.
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
        """Whether the arm followed its plan with effort to spare and touched nothing."""
        return self.outcome == "followed"


FOLLOWED = SimulationVerdict("followed", 0.0)
"""Stands for the verdict on a run that nobody judged."""


@dataclass(frozen=True, eq=False, kw_only=True)
class GoalPoseRecord:
    """What is kept of the goal-pose program's answer; an arm of many links may have been asked for with fewer.

    Attributes:
        reached: whether the motion ends in this pose.
        reason: why it does not, in words; empty when it does.
        configuration: the bends of every joint, and the feed where there is one, shape (c,) [rad, m].
        curve: the curve that the links follow.
        gap: least room of any link beyond radius and clearance, at most the wanted gap [m].
        wanted_gap: room beyond radius and clearance above which more was worth nothing [m].
        costs: weighted parts of the objective by name; they sum to it.
        multipliers: of the rows that shape the pose, by name: how much the objective would fall for one unit of the
            row (one arm's length, one radian, one unit of the user's); the largest first.
        iterations: of the solver.
        size: numbers of variables and rows.
        status: the solver's own word for how it stopped.
        tried: how many poses were asked for, this one among them.
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
        """The objective."""
        return float(sum(self.costs.values()))


# Why a motion has less than the wanted gap for a while: a pose at which it rests has less itself, or the way has.
ShortCause = Literal["start", "stop", "goal", "passage"]
# What bounds the gap that a motion can keep.
GapBound = Literal["wanted gap", "start", "goal", "passage"]


@dataclass(frozen=True)
class NearPlace:
    """Where one link is near something, at one time.

    Attributes:
        gap: beyond contact: between the surfaces, the clearance subtracted where the other is a wall [m]; where nothing
            is within reach, the reach.
        wanted: gap that is wanted of this pair [m]; links that are not far apart along the arm cannot keep it all.
        time: when [s].
        link: from 1; 0 where nothing is within reach.
        obstacle: name of the wall; empty where the other is a link.
        second_link: from 1; 0 where the other is a wall.
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
            return "nothing is near"
        other = f"link {self.second_link}" if self.second_link else f"'{self.obstacle}'"
        return f"link {self.link} to {other}"


@dataclass(frozen=True)
class ShortStretch:
    """A stretch of the motion that has less than the wanted gap.

    Attributes:
        begin: its first sample [s].
        end: its last sample [s].
        nearest: where most is missing in it.
        cause: why.
    """

    begin: float
    end: float
    nearest: NearPlace
    cause: ShortCause


@dataclass(frozen=True)
class PossibleGap:
    """An upper bound on the least gap of motions; perhaps none keeps as much.

    Attributes:
        value: [m].
        by: what decides it.
        walls: names of two walls between which the motion leads, where they decide: then it bounds motions that lead
            between them; otherwise all motions.
    """

    value: float
    by: GapBound
    walls: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class RoomRecord:
    """The room that a timed motion keeps at all times; ``driver.room_over_time`` makes it.

    Attributes:
        time: of the samples whose gaps follow, the motion's ends and stops among them, shape (N,) [s].
        wanted: gap that was wanted [m]; 0 when none was.
        clearance: that walls must be kept beyond contact of the surfaces; gaps begin where it ends [m].
        wall_gaps: least gap to a wall at those samples, shape (N,) [m].
        self_gaps: least gap between two links at those samples, shape (N,) [m].
        reach: gaps beyond it are not told apart and stand as this in the arrays [m].
        nearest: the least gap of the whole motion, between samples too.
        ends: the least gap at the start, at every stop and at the goal, in order.
        short: stretches that have less than the wanted gap, in order.
        possible: the gap that can be kept; None where it is not known.
        price: time that the wanted gap costs against the same plan without one [s]; None where that is not known.
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
        """The least gap of the start pose, which no motion can better."""
        return self.ends[0]

    @property
    def at_goal(self) -> NearPlace:
        """The least gap of the last pose."""
        return self.ends[-1]
