"""Numbers of the 1990 planner.

The paper gives none of them. They are this package's choice, made once so that the examples of its figures succeed,
and left alone since: the baseline is there to be compared with.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class BaselineSettings:
    """What the planner around the schemas of hill climbing allows itself.

    Attributes:
        plan_share: share of the time that is left that one plan may use, so that the others have their turn. Taste.
        certified_gap: gap beyond contact that moves keep, as a share of the arm's length, so that the smooth path has
            somewhere to go. Taste.
    """

    plan_share: float = 0.6
    certified_gap: float = 1e-4


DEFAULT_BASELINE = BaselineSettings()
"""What the planner takes when it is not given other settings."""
