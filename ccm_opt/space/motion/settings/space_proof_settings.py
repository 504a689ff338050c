"""Numbers of the proof of a motion and of the smooth path that is proved.

Lengths are in nominal links u = L / 24 unless said otherwise.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class SpaceCertificateSettings:
    """Of the proof that a motion touches nothing.

    Attributes:
        depth: how often an interval may be halved; taste: at twelve a step has been cut into four thousand.
        step_depth: the same for a step of the search, of which a shorter one is tried instead; measured in clutter.
        spare: gap that is proved beyond contact, for the path between its samples [u].
        least_spare: the same where a start or a goal of the whole arm has no more than twice as much [u]; measured: a
            straight arm of a metre is lifted off a table 1.5 µm below it, and hardly off one at 1 µm.
        slack: share of a link's motion by which distances may be told too small at first; walks along finely meshed
            walls are shorter so, and where it does not prove enough they are made again without.
    """

    depth: int = 12
    step_depth: int = 5
    spare: float = 0.002
    least_spare: float = 1.2e-5
    slack: float = 0.3


@dataclass(frozen=True)
class SpaceSmoothPathSettings:
    """Of the smooth path through joint space.

    Attributes:
        samples: of a span between which the path is proved as if it were linear.
        feed: of the base over a span, at most; less than half of what joints stay straight beyond the guide tube,
            so that none is bent on a span on which the tube holds it [u].
        user_samples: of a span at which users' constraints are looked at, which are not proved between; taste.
        looks: places for every keyframe of the motion at which the room of the path is looked at.
        lost_room: share of the wanted gap by which a path may lack more of it than its motion does; taste.
        roomy_refinements: how often legs of the control polygon are halved to keep room; a path has ever more corners.
        refinements: how often legs of the control polygon are halved.
        most_control: control points beyond which none are added.
        limit_slack: by how much rounding may carry coordinates beyond their limits [rad, m].
    """

    samples: int = 4
    user_samples: int = 32
    feed: float = 0.12
    looks: int = 5
    lost_room: float = 0.02
    roomy_refinements: int = 2
    refinements: int = 16
    most_control: int = 400
    limit_slack: float = 1e-8
