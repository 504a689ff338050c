"""Numbers of the 1990 planner.

The paper gives none of them. They are this package's choice, made once so that the examples of its figures succeed,
and left alone since: the baseline is there to be compared with.
"""

from dataclasses import dataclass, field

from ccm_opt.baseline.distance import Precision


@dataclass(frozen=True)
class CrowdingSettings:
    """From where walls, the arm itself and its limits push, and at how many points.

    Attributes:
        points: chords of the configuration at whose ends walls push; even. Taste.
    """

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
        on_the_way: precision asked at the subgoals of SCM-7 but the last. Taste.
        stride: greatest change of heading anywhere on the curve between two steps of SCM-2 and SCM-8 [rad]. Taste.
        held_precision: how exactly SCM-3 and SCM-6 preserve a pose. Taste.
        selected_precision: how near the end of a curve selected by SCM-4 comes to the goal; SCM-0 does the rest. Taste.
        shortening: share by which SCM-4 shortens a segment that is too long, at a time. Taste.
        feed: length that SCM-3 and SCM-5 pass on in one step, as a share of the arm's. Taste.
    """

    push: float = 0.01
    patience: float = 15
    on_the_way: Precision = field(default=Precision(2e-3, 2e-2))
    stride: float = 0.12
    held_precision: Precision = field(default=Precision(1.5e-4, 1.5e-3))
    selected_precision: Precision = field(default=Precision(1e-3, 6e-3))
    shortening: float = 0.03
    feed: float = 0.02


@dataclass(frozen=True)
class PlanSettings:
    """Numbers of the plans of sections 4.1 and 4.3; lengths are shares of the arm's where nothing else is said.

    Attributes:
        corner_distance: distance kept from corners where there is room. Taste.
        near_subgoal: how near the first subgoal counts, for an arm of many segments. Taste.
    """

    corner_distance: float = 0.04
    near_subgoal: Precision = field(default=Precision(1.2e-3, 4e-3))


@dataclass(frozen=True)
class ClimbingSettings:
    """All numbers of the baseline's method; the sizes of operators' steps stand in ``StepSizes``.

    Attributes:
        crowding: of the push of walls and limits.
        schemas: of the nine schemas.
        plans: of the plans made of them.
    """

    crowding: CrowdingSettings = field(default_factory=CrowdingSettings)
    schemas: SchemaSettings = field(default_factory=SchemaSettings)
    plans: PlanSettings = field(default_factory=PlanSettings)


DEFAULT_CLIMBING = ClimbingSettings()
"""The numbers that are used unless a world brings others."""


@dataclass(frozen=True)
class BaselineSettings:
    """What the planner around the schemas of hill climbing allows itself, and the numbers of these.

    Attributes:
        plan_share: share of the time that is left that one plan may use, so that the others have their turn. Taste.
        certified_gap: gap beyond contact that moves keep, as a share of the arm's length, so that the smooth path has
            somewhere to go. Taste.
        climbing: of the climbs, the schemas, and the plans made of them.
    """

    plan_share: float = 0.6
    certified_gap: float = 1e-4
    climbing: ClimbingSettings = field(default_factory=ClimbingSettings)


DEFAULT_BASELINE = BaselineSettings()
"""What the planner takes when it is not given other settings."""
