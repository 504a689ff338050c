"""What is found where the arm touches something, in the plane and in space: what is missing, and what would do."""

from ccm_opt.diagnosis.words import point
from ccm_opt.errors import Finding
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.length_words import short_length
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.space.problem import AnyProblem


def contact_finding(
    problem: AnyProblem, key: str, message: str, where: FloatArray, obstacle: str, gap: float, play: float
) -> Finding:
    """One contact, with the radius and the clearance that would just end it.

    Args:
        problem: what was asked.
        key: of the pose in the problem file.
        message: what touches what, behind the key.
        where: the place, shape (d,) [m].
        obstacle: its name.
        gap: from the axis of the arm to the obstacle, less than 0 inside it [m].
        play: by how much tolerances may widen it [m].
    """
    radius = problem.arm.radius
    clearance = problem.workspace.clearance
    bounds = {}
    if (thinnest := gap + play - clearance) > 0.0:
        bounds["arm.radius"] = thinnest
    if (nearest := gap + play - radius) >= 0.0 and clearance > 0.0:
        bounds["workspace.clearance"] = nearest
    return Finding(
        "contact",
        f"{key}: {message}",
        key=key,
        place=point(where),
        measured=radius + clearance - gap,
        allowed=play,
        obstacles=(obstacle,),
        bounds=bounds,
    )


def gap_words(gap: float) -> str:
    """A gap in words [m]; what rounding leaves of one is none that a length tells anything of."""
    return short_length(gap) if gap > ROUNDING else "a hair"
