"""The numbers of the goal-pose NLP: the size of the curve, weights of the objective, and the solver's limits."""

import sys
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class PoseSettings:
    """How a goal pose is asked for; lengths are in units of the arm's length unless a unit is given.

    Attributes:
        segments: curvature segments of the curve; as many as the coordinates of the motion have, so that the pose that
            the search arrived at is a starting point without a fit (derived).
        bending_weight: of ∫κ² ds, twice the elastic energy of a unit rod (measured: with 0.02 the shared problems last
            up to 16 % longer than with a free end, with 0.01 up to 8 %).
        distance_weight: of the squared turns of all joints from the pose to stay near, where the motion would end by
            itself [1/rad²] (measured: with 2 eleven motions last 0.8 % longer in the median, 14 % at most, than without
            any wanted gap, with 0.5 it is 2.4 % and 30 %; squared turns from the start of the motion instead made some
            last 40 % longer, for they know nothing of the way).
        tolerance: of the solver, relative (taste).
        rounds: most solutions, the regions drawn anew about the links between them (measured by
            ``tests.benchmarks.bench_goal_poses``: two or three are enough in most clutter).
        worthwhile: a further round is worth its time when the one before brought this share of the cost or, where the
            wanted gap is not reached, of that gap (taste).
        reach: walls farther away than this from a link make no side of its region (taste).
        far_reach: the same where a link has strayed farther than ``reach`` and met a wall there (derived: no link
            strays farther than twice the arm's length, and seldom half of it).
        feasible: largest violation of a row that counts as kept; one millionth of the arm (derived: below the
            certificate's own spare).
        binding: a multiplier above this, beside an objective of order one, marks a row that shapes the pose (taste).
        most_sides: of a link's region, the nearest (measured: in narrow passages half of the links need four, but some
            need 16 to 128, which every iteration would pay for at every link).
        more_sides: the same where a pose has less room than its rows say, for a side that was left out (taste).
        enough: share of the wanted gap at which no further round is worth its time (taste).
    """

    segments: int = 5
    bending_weight: float = 0.01
    distance_weight: float = 2.0
    tolerance: float = 1e-4
    rounds: int = 4
    worthwhile: float = 0.02
    reach: float = 0.25
    far_reach: float = 2.0
    feasible: float = 1e-6
    binding: float = 1e-4
    most_sides: int = 8
    more_sides: int = 16
    enough: float = 0.999

    @property
    def widening(self) -> tuple["PoseSettings", ...]:
        """These settings, then with more sides, then with all of them, those to walls far away too."""
        more = replace(self, most_sides=self.more_sides)
        everything = replace(self, most_sides=sys.maxsize, reach=self.far_reach)
        return self, more, everything
