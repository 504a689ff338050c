"""Numbers of the 1990 planner.

The paper gives none of them. They are this package's choice, made once so that the examples of its figures succeed,
and left alone since: the baseline is there to be compared with.
"""

from dataclasses import dataclass, field

from ccm_opt.baseline.distance import Precision


@dataclass(frozen=True)
class ClimbSettings:
    """How a hill climb chooses among candidate moves.

    Attributes:
        least_gain: a move counts as an improvement when it takes away at least this share of the distance. Taste.
        gain_while_pushed: the same while walls push: the climb is not drawn out for the sake of the push. Taste.
        easing: factor by which the push eases where push and distance balance, as the weight of a barrier does. Taste.
        least_push: weights of crowding below it are dropped. Taste.
        tried_at_once: candidates asked of the world in the first go, best first. Taste.
        more_each_go: factor on that number from go to go. Derived: asking for one costs nearly as much as for ten.
        most_tried: improving candidates asked in all before the climb counts as blocked. Taste.
        headway: a climb makes headway when it has taken away this share of the distance, which is a square. Taste.
    """

    least_gain: float = 1e-4
    gain_while_pushed: float = 0.02
    easing: float = 0.3
    least_push: float = 1e-6
    tried_at_once: int = 4
    more_each_go: int = 3
    most_tried: int = 96
    headway: float = 0.2


@dataclass(frozen=True)
class CrowdingSettings:
    """From where walls, the arm itself and its limits push, and at how many points.

    Attributes:
        kept_off: points nearer to contact than this share of the arm's length are pushed away. Taste.
        strained: share of the curvature's limit from which interpolation points are pushed back. Taste.
        points: chords of the configuration at whose ends walls push; even. Taste.
    """

    kept_off: float = 0.03
    strained: float = 0.3
    points: int = 48

    @property
    def self_points(self) -> int:
        """Chords at whose ends the arm pushes itself, every other end of the others."""
        return self.points // 2


@dataclass(frozen=True)
class SchemaSettings:
    """Strides, weights and tolerances of the nine schemas (section 4.2).

    Attributes:
        push: weight of the world's crowding beside the distance where a plan asks for it. Taste.
        patience: moves without headway after which a climb on the way of a plan ends: such climbs arrive soon or
            hardly ever. Taste.
        subgoal_spacing: distance of the subgoals of SCM-7, as a share of the arm's length. Taste.
        subgoal_turn: most that the tip turns from subgoal to subgoal [rad]. Taste.
        on_the_way: precision asked at the subgoals of SCM-7 but the last. Taste.
        stride: greatest change of heading anywhere on the curve between two steps of SCM-2 and SCM-8 [rad]. Taste.
        stride_samples: places on the curve where that change is looked at. Taste.
        held_precision: how exactly SCM-3 and SCM-6 preserve a pose. Taste.
        held_push: weight of the walls while a pose is held. Taste.
        held_patience: moves without headway after which the end of a segment counts as not to be held. Taste.
        relaxing: moves by which a shape is relaxed before its end is brought back. Taste.
        end_turn: most that SCM-6 changes the end's curvature in one step, times the segment's length [rad]. Taste.
        selected_precision: how near the end of a curve selected by SCM-4 comes to the goal; SCM-0 does the rest. Taste.
        selection_push: weight of the walls while a curve is selected. Taste.
        selection_steps: moves of that climb, at most. Taste.
        least_chord_ratio: least chord of SCM-4's first guess, as a share of its length. Taste.
        shortening: share by which SCM-4 shortens a segment that is too long, at a time. Taste.
        feed: length that SCM-3 and SCM-5 pass on in one step, as a share of the arm's. Taste.
        finest_feed: share of that step down to which a feed that meets an obstacle is halved. Taste.
    """

    push: float = 0.01
    patience: float = 15
    subgoal_spacing: float = 0.03
    subgoal_turn: float = 0.12
    on_the_way: Precision = field(default=Precision(2e-3, 2e-2))
    stride: float = 0.12
    stride_samples: int = 65
    held_precision: Precision = field(default=Precision(1.5e-4, 1.5e-3))
    held_push: float = 0.03
    held_patience: float = 20
    relaxing: int = 6
    end_turn: float = 0.3
    selected_precision: Precision = field(default=Precision(1e-3, 6e-3))
    selection_push: float = 0.05
    selection_steps: int = 1500
    least_chord_ratio: float = 0.25
    shortening: float = 0.03
    feed: float = 0.02
    finest_feed: float = 1.0 / 8.0


@dataclass(frozen=True)
class PlanSettings:
    """Numbers of the plans of sections 4.1 and 4.3; lengths are shares of the arm's where nothing else is said.

    Attributes:
        least_base_segment: length that the base segment keeps. Taste.
        boundary_ahead: length by which the boundary moves ahead. Taste.
        boundary_slide: share of that by which it slides with the feed. Taste.
        near_goal: the arm climbs to the goal when no more than this length is left of the curve to it. Taste.
        nothing_left: what is left of the curve counts as nothing below this length. Taste.
        taken_back: shares of the steps of SCM-8 that are taken back where SCM-7 cannot go on from its end. Taste.
        most_of_way: SCM-7 that gets farther than this share of its way does not begin earlier when it is stuck. Taste.
        last_climb: moves of SCM-0 after a merge, at most. Taste.
        merge_tolerance: how far headings may move when the segments are merged [rad]; the arm goes there by SCM-2.
            Taste.
        straight_runs: straight runs out of the first subgoal and into the goal that are tried. Taste.
        corner_distance: distance kept from corners where there is room. Taste.
        first_subgoals: places of the first subgoal on the route, from the base; the nearer, the tighter the fold, so
            the farther is tried first. Taste.
        near_subgoal: how near the first subgoal counts, for an arm of many segments. Taste.
        corner_spacing: corners nearer to each other than this share of the straight run are taken as one. Taste.
        track_samples: points of a track that are looked at for contact. Taste.
        sharpest_turn: share of the curvature's limit that a turn may use. Taste.
    """

    least_base_segment: float = 0.05
    boundary_ahead: float = 0.06
    boundary_slide: float = 0.4
    near_goal: float = 0.15
    nothing_left: float = 1e-6
    taken_back: tuple[float, ...] = (0.0, 0.25, 0.5, 0.75)
    most_of_way: float = 0.5
    last_climb: int = 300
    merge_tolerance: float = 0.1
    straight_runs: tuple[float, ...] = (0.08, 0.05, 0.03, 0.015)
    corner_distance: float = 0.04
    first_subgoals: tuple[float, ...] = (0.15, 0.08)
    near_subgoal: Precision = field(default=Precision(1.2e-3, 4e-3))
    corner_spacing: float = 0.7
    track_samples: int = 200
    sharpest_turn: float = 0.85


@dataclass(frozen=True)
class ClimbingSettings:
    """All numbers of the baseline's method; the sizes of operators' steps stand in ``StepSizes``.

    Attributes:
        climb: of single climbs.
        crowding: of the push of walls and limits.
        schemas: of the nine schemas.
        plans: of the plans made of them.
        field_cells: cells of the grid of distances along the longer side of the room. Taste.
    """

    climb: ClimbSettings = field(default_factory=ClimbSettings)
    crowding: CrowdingSettings = field(default_factory=CrowdingSettings)
    schemas: SchemaSettings = field(default_factory=SchemaSettings)
    plans: PlanSettings = field(default_factory=PlanSettings)
    field_cells: int = 160


DEFAULT_CLIMBING = ClimbingSettings()
"""The numbers that are used unless a world brings others."""


@dataclass(frozen=True)
class BaselineSettings:
    """What the planner around the schemas of hill climbing allows itself, and the numbers of these.

    Attributes:
        planning_share: share of the time limit that planning may use; timing and verification need the rest. Taste.
        plan_share: share of the time that is left that one plan may use, so that the others have their turn. Taste.
        joint_limit_share: share of the joint limits that moves use; the smooth path near them bends a little more.
            Taste.
        certified_gap: gap beyond contact that moves keep, as a share of the arm's length, so that the smooth path has
            somewhere to go. Taste.
        bisections: halvings of a move before it counts as blocked. Most candidate moves are discarded, so that
            fewer than the certificate's own pay. Taste.
        merging_tolerance: how far headings may move when segments of the start are merged [rad]; the follower's
            offset makes up for it exactly. Taste.
        route_inflation: inflation of the walls for routes beyond radius and clearance, as a share of the arm's length.
            Taste.
        types_tried: segment types that are tried, best first. The paper has five; the last is seldom any good. Taste.
        climbing: of the climbs, the schemas, and the plans made of them.
    """

    planning_share: float = 0.9
    plan_share: float = 0.6
    joint_limit_share: float = 0.99
    certified_gap: float = 1e-4
    bisections: int = 3
    merging_tolerance: float = 0.02
    route_inflation: float = 1e-3
    types_tried: int = 4
    climbing: ClimbingSettings = field(default_factory=ClimbingSettings)


DEFAULT_BASELINE = BaselineSettings()
"""What the planner takes when it is not given other settings."""
