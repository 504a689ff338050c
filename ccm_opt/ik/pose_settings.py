"""Settings of the goal-pose NLP: size of its curve, weights of its objective, limits of the solver."""

import math
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ccm_opt.core.arrays import FloatArray
from ccm_opt.problem import Weights
from ccm_opt.robot.rigid_motions import NOMINAL_LINKS

TORQUE_SHARE = 0.9
"""Fraction of a torque limit that holding the pose may take, leaving the rest for motion and feedback (heuristic)."""
_CLEARANCE_WEIGHT = 10.0
"""Cost of having none of the preferred clearance, much higher than that of bending (heuristic)."""
_KNOT_WEIGHT = 4.0
"""Weight of uneven knots; leaves no direction of the variables without curvature (as the configuration NLP; measured:
with 0.05 scenes of clutter take 28 iterations in the median, with 4 they take 12, and the cost terms that describe
the pose grow by 0.1 %)."""
_BOW_WEIGHT = 1e-3
"""Weight of the deviation of the curvature from its chords between knots; for the same reason (heuristic)."""
_TORQUE_WEIGHT = 0.1
"""Weight of the mean square torque, as a fraction of the limits (heuristic)."""
_STRAY_WEIGHT = 1.0
"""Weight of the squared angles between links in space and the curve [1/rad²] (heuristic)."""


@dataclass(frozen=True)
class PoseSettings:
    """Settings of the goal-pose NLP; lengths are in units of the arm's length unless a unit is given.

    Attributes:
        segments: number of curvature segments for an arm of up to 24 links; the same as in the coordinates of the
            motion (derived).
        links_a_segment: number of links beyond 24 per additional segment. Measured in space: with too few
            segments most joints share a piece between knots, and arms of 36 links take a hundred iterations and more
            instead of fifteen, behind holes and in a tank with 36 and 60 links; with three segments, arms that are
            straight up to a hole take three times the iterations (``tests.benchmarks.bench_space_poses``).
        bending_weight: weight of ∫κ² ds, twice the elastic energy of a unit rod (measured: with 0.02 motions of the
            shared problems take up to 16 % longer than with a free end, with 0.01 up to 8 %).
        distance_weight: weight of the squared differences of all bends from a reference pose, the one at which the
            motion would end without a preferred pose [1/rad²] (measured: with 2 eleven motions take 0.8 % longer in
            the median, 14 % at most, than without any preferred clearance, with 0.5 it is 2.4 % and 30 %; with the
            start of the motion as the reference several took 40 % longer, since the start says nothing about the
            route). Halved in space, where a change of shape takes one of both bends (heuristic).
        tolerance: relative tolerance of the solver (heuristic).
        iterations: maximum number of iterations of one solution (measured: clutter takes 8 to 25; of arms in space on
            fixed bases, whose ends a search leaves far from smooth, one in four takes 30 to 80 among 40 and 80 bodies).
        rounds: maximum number of solutions, with new regions around the links in between (measured by
            ``tests.benchmarks.bench_goal_poses``: two or three are enough in most clutter).
        worthwhile: fraction by which a round must lower the cost for another round to follow; where the preferred
            clearance is not reached, a gain of that fraction of the clearance suffices too (heuristic).
        reach: distance from a link beyond which walls do not bound its region (heuristic).
        widened: maximum number of sides, and ``reach``, of each repetition with larger regions. One follows if a link
            moved farther than ``reach`` and met a wall, or has less clearance than its constraints imply because a side
            was left out (derived: no link moves farther than twice the arm's length, and seldom half of it).
        feasible: violation up to which a constraint counts as satisfied; one millionth of the arm (derived: below the
            certificate's own margin).
        binding: multiplier above which a constraint counts as shaping the pose; the objective is of order one
            (heuristic).
        behind: distance by which a surface in space may protrude through the side of a region that stands for it.
        most_sides: maximum number of sides of a link's region, the nearest ones (measured: in narrow passages half of
            the links need four, but others need 16 to 128, which would cost time at every link in every iteration).
        enough: fraction of the preferred clearance at which no further round is worth its time (heuristic).
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
        """Return the number of curvature segments of the curve for an arm with a number of links."""
        return self.segments + math.ceil(max(links - NOMINAL_LINKS, 0) / self.links_a_segment)

    def objective_weights(self, parts: tuple[str, ...], given: Weights, bends_a_joint: int) -> FloatArray:
        """Return the weights of cost terms of the objective, in the order of their names, shape (terms,).

        Args:
            parts: names of the cost terms, such as "bending".
            given: weights of the problem, which scale the terms "bending" and "distance".
            bends_a_joint: 1 in the plane, 2 in space.
        """
        weights = {
            "room": _CLEARANCE_WEIGHT,
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
        """Settings to be tried in turn: the present ones, then those with more sides and a longer reach."""
        return self, *(replace(self, most_sides=sides, reach=reach) for sides, reach in self.widened)


DEFAULT_POSES = PoseSettings()
"""Settings of the goal-pose NLP used if no others are given."""
