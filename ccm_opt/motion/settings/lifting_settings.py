"""Settings of lifting: taking a motion over to an arm of many links."""

from dataclasses import dataclass


@dataclass(frozen=True)
class LiftingSettings:
    """Numbers of the repair of a lifted motion.

    Attributes:
        repairs: rounds in which keyframes of intervals that fail the certificate are pushed clear. Taste; what six do
            not mend is planned on the task's own links.
        margin: planning margin of a repair, as a share of the arm's length. Taste.
        reach: contacts nearer than this make rows of a repair, as a share of the arm's length. Taste.
        coordinate_weight: of the coordinates themselves against link headings, which ties down what no link heading
            shows. Taste.
    """

    repairs: int = 6
    margin: float = 1.5e-3
    reach: float = 0.02
    coordinate_weight: float = 1e-4
