"""The numbers of the goal-pose NLP: the size of the curve, weights of the objective, and the solver's limits."""

import sys
from dataclasses import dataclass, replace


@dataclass(frozen=True)
class PoseSettings:
    """How a goal pose is asked for; lengths are in units of the arm's length unless a unit is given.

    Attributes:
        segments: curvature segments of the curve; as many as the coordinates of the motion have, so that the pose that
            the search arrived at is a starting point without a fit (derived).
        window: spline pieces on either side of the one in which a joint lies at first, among which the joint may come
            to lie while knots move. A wider one costs building time, a narrower one holds the knots (measured: with 1
            building takes three quarters of the time that 2 takes, and the poses of clutter are the same).
        least_piece: least share of its segment that a piece between knots keeps (as the configuration NLP has it).
        torque_share: share of a torque limit that holding the pose may take, so that moving and feedback have the rest
            (taste).
        limit_share: share of a joint limit that a pose may use (as the steps of the motion have it).
        room_weight: cost of having no room at all, of the wanted gap; beside it bending costs little (taste).
        bending_weight: of ∫κ² ds, twice the elastic energy of a unit rod (measured: with 0.02 the shared problems last
            up to 16 % longer than with a free end, with 0.01 up to 8 %).
        knot_weight: of uneven knots; leaves no direction of the variables without curvature (as the configuration NLP;
            measured: with 0.05 clutter takes 28 iterations in the median, with 4 it takes 12, and the parts that say
            something of the pose grow by 0.1 %).
        bow_weight: of what the curvature leaves its chords by between knots; likewise (taste).
        distance_weight: of the squared turns of all joints from the pose to stay near, where the motion would end by
            itself [1/rad²] (measured: with 2 eleven motions last 0.8 % longer in the median, 14 % at most, than without
            any wanted gap, with 0.5 it is 2.4 % and 30 %; squared turns from the start of the motion instead made some
            last 40 % longer, for they know nothing of the way).
        torque_weight: of the mean square torque, as shares of its limits (taste).
        tolerance: of the solver, relative (taste).
        iterations: most iterations of one solution (measured: clutter takes 8 to 25).
        first_barrier: where the barrier starts; small, for a pose of the arm is known (taste).
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
        region_sizes: numbers of sides that programs are built for, so that poses share solvers (measured: of 42 clutter
            scenes all need eight or fewer).
        enough: share of the wanted gap at which no further round is worth its time (taste).
    """

    segments: int = 5
    window: int = 1
    least_piece: float = 0.08
    torque_share: float = 0.9
    limit_share: float = 0.98
    room_weight: float = 10.0
    bending_weight: float = 0.01
    knot_weight: float = 4.0
    bow_weight: float = 1e-3
    distance_weight: float = 2.0
    torque_weight: float = 0.1
    tolerance: float = 1e-4
    iterations: int = 100
    first_barrier: float = 1e-2
    rounds: int = 4
    worthwhile: float = 0.02
    reach: float = 0.25
    far_reach: float = 2.0
    feasible: float = 1e-6
    binding: float = 1e-4
    most_sides: int = 8
    more_sides: int = 16
    region_sizes: tuple[int, ...] = (8, 16, 32, 64, 128)
    enough: float = 0.999

    @property
    def widening(self) -> tuple["PoseSettings", ...]:
        """These settings, then with more sides, then with all of them, those to walls far away too."""
        more = replace(self, most_sides=self.more_sides)
        everything = replace(self, most_sides=sys.maxsize, reach=self.far_reach)
        return self, more, everything
