"""Settings of the continuation: of a single step, of following a guide, and of settling on the goal."""

from dataclasses import dataclass, field, replace

import numpy as np


@dataclass(frozen=True)
class RailSettings:
    """Numbers of the rails through narrow gates, and of the lines across them.

    Attributes:
        weight: on a joint's distance from the middle of its gate beyond a part of the play, against a nominal link's
            distance. Taste: with three times as much joints cannot give way to the goal.
        play: that part, in planning margins. Taste.
        beside: joints farther off than this are not on the rail, in nominal links. Taste.
        places: of a gate's middle line at which it is measured where it is narrowest. Taste.
        narrowest: by this share more than the least distance to walls still counts as narrowest. Taste: a hundredth
            of a gate's width; lines before a rounded wall, where there is room aside, refuse motions that exist.
        short: a stretch shorter than this many radii of the gate has one line, not one at either end. Taste.
        same: lines nearer to each other than this share of a rail are one. Derived: rails of two paths through one gate
            differ by rounding.
        across: a line is crossed where that is no farther from its middle, in nominal links. Taste.
        catching_up: most that a step asks a crossing to move towards the middle, in nominal links. Taste.
        newton_steps: most steps onto the middles. Taste.
        exact: distance from the middles that is left, as a share of the arm's length. Taste: a thousandth of the play.
        largest_turn: a pose that needs larger turns of links to cross in the middle is left as it is [rad]. Taste.
        ridge: share of the diagonal of the normal equations. Taste.
    """

    weight: float = 30.0
    play: float = 0.5
    beside: float = 0.5
    places: int = 61
    narrowest: float = 1e-3
    short: float = 0.15
    same: float = 2e-3
    across: float = 0.25
    catching_up: float = 0.02
    newton_steps: int = 5
    exact: float = 1e-6
    largest_turn: float = 0.15
    ridge: float = 1e-9


@dataclass(frozen=True)
class StepSettings:
    """Numbers of a single step.

    Attributes:
        limit_share: share of a joint limit that planning uses; what accepted poses and splines overshoot stays below
            the limit. Taste.
        full_limit_share: the same where the ends, or what keeps the arm off its goal, ask for more. Derived: what rows
            and polishing may err by is a hundredth of a degree at most.
        keep_share: share of the planning margin that every accepted pose keeps. Taste.
        largest_turn: largest turn of a link in one step [rad], so that the linearised rows hold. Taste.
        closing_share: share of its gap beyond the margin by which a near pair may close in one step. Derived: two
            links that move towards each other close it at most together.
        mending_share: share of what a gap lacks to its margin that a step asks for. Taste.
        firm_share: the same that rows ask for, where there is such a step; usually nothing. Taste.
        narrow_firm_share: the same where margins are narrow. Taste.
        push_weight: weight on mending gaps inside their margin, against a nominal link's distance. Taste.
        near_joint_limit: bends nearer to their limit than this get rows in the optimisation [rad]. Taste: a little
            more than a step turns a joint.
        ridge: keeps the step's Hessian definite where no term reaches. Taste.
        narrow_ridge: the same where margins are narrow. Measured: beside the heavy weights there the solver does not
            tell a Hessian with the usual ridge definite, and takes 600 iterations where 10 do.
        gate_ridge: the same in gates, with their equations. Measured on an arm of 48 links in two doors: with the
            narrow ridge a step took 1165 iterations, with this one 2.
        blend_ridge: the same on coordinates that blend a goal of the whole arm in. Measured on a chain in a horn, 12 to
            96 links: with the usual one a step along a guide's path took 36 to 280 iterations of its QP or never ended,
            with this one 3 to 7.
        iterations_a_row: most iterations of the QP to a row: a jammed arm would go on in vain, but 192 links need
            more than 24 in all. Taste.
        backtracks: halvings of a step before it is given up. Taste.
        narrow_margin: planning margin below which steps are smaller, in nominal links. Taste: the usual narrow one.
        rails: of what draws joints to the middle of narrow gates.
    """

    limit_share: float = 0.98
    full_limit_share: float = 0.9995
    keep_share: float = 0.4
    largest_turn: float = 0.15
    closing_share: float = 0.5
    mending_share: float = 0.5
    firm_share: float = 0.0
    narrow_firm_share: float = 0.5
    push_weight: float = 30.0
    near_joint_limit: float = 0.25
    ridge: float = 1e-9
    narrow_ridge: float = 1e-6
    gate_ridge: float = 1e-5
    blend_ridge: float = 1e-6
    iterations_a_row: int = 8
    backtracks: int = 6
    narrow_margin: float = 0.024
    rails: RailSettings = field(default_factory=RailSettings)

    def narrowed(self, margin: float) -> "StepSettings":
        """The numbers for a planning margin, in nominal links: where it is small, so are the steps.

        Linearised rows err by the square of the turn. What pushes the arm out of its margin has to grow as the margin
        gets smaller, or the guide would hold it at the very edge, where no step is left.
        """
        share = margin / self.narrow_margin
        if share >= 1.0:
            return self
        turn = self.largest_turn * float(np.sqrt(share))
        return replace(
            self,
            largest_turn=turn,
            push_weight=self.push_weight / share,
            firm_share=self.narrow_firm_share,
            ridge=self.narrow_ridge,
        )


@dataclass(frozen=True)
class ContinuationSettings:
    """Numbers of following a guide, and of settling on the goal where it ends.

    Attributes:
        bending: weight on the curve's curvature in every step, against a nominal link's distance. Taste: it decides
            only what nothing else does.
        jerk: weight on the differences of the curvature from knot to knot. Taste.
        patience: steps without progress before a guide is given up. Taste.
        pauses: poses nearer than this to the one before are dropped [rad], the first that leaves the motion
            certified; a path that almost stands still in places cannot be timed well. Taste.
        mends: times that poses are put between those in gates between which the motion is not certified. Taste.
        settle_steps: most steps of settling on the goal. Taste.
        settle_least: settling steps that are taken even if the arm hardly moves. Taste.
        settle_moved: turn of a link below which the arm hardly moves [rad]. Taste.
        settle_growth: growth of the goal's weight from step to step. Taste.
        still_weight: weight on standing still while settling, for all links together. Taste.
        polish_distance: distance from the goal at which polishing is tried, in nominal links. Taste.
        polish_turn: turn of the tip's heading from the goal's at which polishing is tried [rad]. Taste.
    """

    bending: float = 1e-4
    jerk: float = 1e-4
    patience: int = 60
    pauses: tuple[float, ...] = (0.02, 1e-3)
    mends: int = 3
    settle_steps: int = 150
    settle_least: int = 20
    settle_moved: float = 1e-5
    settle_growth: float = 0.2
    still_weight: float = 0.5
    polish_distance: float = 0.1
    polish_turn: float = 0.1


@dataclass(frozen=True)
class GoalSettings:
    """Numbers of drawing the tip onto the goal, and of putting it there exactly.

    Attributes:
        polish_tolerance: tip error [arm lengths] and heading error [rad] that the polish stops at. Derived: three
            orders below what the verifier allows.
        reached: times that tolerance which still counts as on the goal. Taste.
        polish_steps: most steps of Newton's method. Taste: it converges in four or never.
        heading_step: largest turn onto the goal's heading that a step asks for [rad]. Taste.
        distance_step: largest advance onto the goal that a step asks for, in nominal links. Taste.
        inwards: share of the room about a goal's position, and about its heading, by which a tip outside is led in
            beyond the edge. Taste.
        heading_weight: weight of the heading, and of what limits miss at the goal, beside the position. Taste.
        least_share: singular values below this share of the largest count as none where equations may depend on each
            other. Taste.
    """

    polish_tolerance: float = 1e-9
    reached: float = 10.0
    polish_steps: int = 12
    heading_step: float = 0.3
    distance_step: float = 1.5
    inwards: float = 0.1
    heading_weight: float = 0.3
    least_share: float = 1e-10

    @property
    def on_goal(self) -> float:
        """Errors up to this count as none [arm lengths] and [rad]."""
        return self.reached * self.polish_tolerance


@dataclass(frozen=True)
class TrackingSettings:
    """Numbers of tracking a reference motion under constraints that depend on the path parameter u.

    Attributes:
        first_advance: first step of u. Taste.
        largest_advance: largest step of u. Taste.
        least_advance: step of u below which tracking is given up. Taste.
        growth: of the step of u after each that was met. Taste.
        arrival: u where tracking ends and the arm settles on the goal. Taste.
        steps: that may be needed to meet the constraints at a new u. Taste.
        largest_turn: largest turn towards the reference that a step asks for [rad]. Taste.
        pull_weight: weight of the reference, against a nominal link's distance. Taste.
        still_weight: weight of standing still. Taste.
    """

    first_advance: float = 1.0 / 80.0
    largest_advance: float = 1.0 / 40.0
    least_advance: float = 1e-4
    growth: float = 1.5
    arrival: float = 0.98
    steps: int = 24
    largest_turn: float = 0.3
    pull_weight: float = 0.1
    still_weight: float = 0.02
