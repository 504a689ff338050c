"""The numbers of the goal-pose NLP: the size of the curve, weights of the objective, and the solver's limits."""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Weights
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS

TORQUE_SHARE = 0.9
"""Share of a torque limit that holding the pose may take, so that moving and feedback have the rest (taste)."""
_ROOM_WEIGHT = 10.0
"""Cost of having no room at all, of the wanted gap; beside it bending costs little (taste)."""
_KNOT_WEIGHT = 4.0
"""Of uneven knots; leaves no direction of the variables without curvature (as the configuration NLP; measured: with
0.05 clutter takes 28 iterations in the median, with 4 it takes 12, and the parts that say something of the pose grow by
0.1 %)."""
_BOW_WEIGHT = 1e-3
"""Of what the curvature leaves its chords by between knots; likewise (taste)."""
_TORQUE_WEIGHT = 0.1
"""Of the mean square torque, as shares of its limits (taste)."""
_STRAY_WEIGHT = 1.0
"""Of the squared angles by which links in space point elsewhere than the curve [1/rad²] (taste)."""


@dataclass(frozen=True)
class PoseSettings:
    """How a goal pose is asked for; lengths are in units of the arm's length unless a unit is given.

    Attributes:
        segments: curvature segments of the curve of an arm of up to 24 links; as many as the coordinates of the motion
            have (derived).
        links_a_segment: arms of more links have one segment more for so many of them. Measured in space: with too few
            segments most joints share a piece between knots, and arms of 36 links take a hundred iterations and more
            instead of fifteen, behind holes and in a tank with 36 and 60 links; with three segments, arms that are
            straight up to a hole take three times the iterations (``tests.benchmarks.bench_space_poses``).
        bending_weight: of ∫κ² ds, twice the elastic energy of a unit rod (measured: with 0.02 the shared problems last
            up to 16 % longer than with a free end, with 0.01 up to 8 %).
        distance_weight: of the squared turns of all joints from the pose to stay near, where the motion would end by
            itself [1/rad²] (measured: with 2 eleven motions last 0.8 % longer in the median, 14 % at most, than without
            any wanted gap, with 0.5 it is 2.4 % and 30 %; squared turns from the start of the motion instead made some
            last 40 % longer, for they know nothing of the way). In space half of it, for the same change of shape is
            one of both bends (taste).
        tolerance: of the solver, relative (taste).
        iterations: most of one solution (measured: clutter takes 8 to 25; of arms in space on fixed bases, whose ends a
            search leaves far from smooth, one in four takes 30 to 80 among 40 and 80 bodies).
        rounds: most solutions, the regions drawn anew about the links between them (measured by
            ``tests.benchmarks.bench_goal_poses``: two or three are enough in most clutter).
        worthwhile: a further round is worth its time when the one before brought this share of the cost or, where the
            wanted gap is not reached, of that gap (taste).
        reach: walls farther away than this from a link make no side of its region (taste).
        widened: most sides, and reach, of regions that are drawn anew where a link has strayed farther than ``reach``
            and met a wall there, or has less room than its rows say, for a side that was left out (derived: no link
            strays farther than twice the arm's length, and seldom half of it).
        feasible: largest violation of a row that counts as kept; one millionth of the arm (derived: below the
            certificate's own spare).
        binding: a multiplier above this, beside an objective of order one, marks a row that shapes the pose (taste).
        behind: by how much a surface in space may stand out behind a side that covers it (as the distances have it).
        most_sides: of a link's region, the nearest (measured: in narrow passages half of the links need four, but some
            need 16 to 128, which every iteration would pay for at every link).
        enough: share of the wanted gap at which no further round is worth its time (taste).
    """

    segments: int = 5
    links_a_segment: float = 2.4
    bending_weight: float = 0.01
    distance_weight: float = 2.0
    tolerance: float = 1e-4
    iterations: int = 100
    rounds: int = 4
    worthwhile: float = 0.02
    reach: float = 0.25
    widened: tuple[tuple[int, float], ...] = ((24, 1.0), (128, 2.0))
    feasible: float = 1e-6
    binding: float = 1e-4
    behind: float = 1e-3
    most_sides: int = 8
    enough: float = 0.999

    def segments_for(self, links: int) -> int:
        """Return the curvature segments of the curve of an arm of so many links."""
        return self.segments + math.ceil(max(links - NOMINAL_LINKS, 0) / self.links_a_segment)

    def objective_weights(self, parts: tuple[str, ...], given: Weights, bends_a_joint: int) -> FloatArray:
        """Return the weights of the parts of the objective by their names, times those that a problem gives."""
        weights = {
            "room": _ROOM_WEIGHT,
            "bending": self.bending_weight * given.bending,
            "distance": self.distance_weight / bends_a_joint * given.path_length,
            "torque": _TORQUE_WEIGHT,
            "knots": _KNOT_WEIGHT,
            "bows": _BOW_WEIGHT,
            "stray": _STRAY_WEIGHT,
        }
        return np.array([weights[part] for part in parts])

    @property
    def widening(self) -> tuple[Self, ...]:
        """These settings, then with more sides, those to walls far away too."""
        return self, *(replace(self, most_sides=sides, reach=reach) for sides, reach in self.widened)


DEFAULT_POSES = PoseSettings()
"""Used where no other settings are given."""
