"""How much room a motion keeps: its gaps over time, where they are least, and what stands against more."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from ccm_opt.ground.arrays import FloatArray

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
    """The room that a timed motion keeps at all times; ``verification.room_over_time`` makes it.

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
