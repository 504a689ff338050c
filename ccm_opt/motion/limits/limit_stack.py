"""Where limits are put together: what a step, and what the optimisation of a motion, has to keep.

A new limit that always holds is one more line here; its rows, checks and words stand in a file of its own.
"""

from ccm_opt.collision.certificate import Certificate
from ccm_opt.collision.contact_finder import ContactFinder
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.motion.limits.contact_limit import ContactLimit
from ccm_opt.motion.limits.gate_lines import GateLines
from ccm_opt.motion.limits.gate_rails import GateRails
from ccm_opt.motion.limits.joint_limit import JointLimit
from ccm_opt.motion.limits.limit import Limit
from ccm_opt.motion.limits.turn_limit import TurnLimit
from ccm_opt.motion.settings.step_settings import StepSettings


def assembled_limits(
    finder: ContactFinder,
    certificate: Certificate,
    settings: StepSettings,
    user_limits: tuple[Limit, ...] = (),
    wanted_gap: float = 0.0,
    rails: tuple[FloatArray, ...] = (),
    gates: GateLines | None = None,
    guide_tubes: tuple[Limit, ...] = (),
) -> tuple[Limit, ...]:
    """All limits of a motion, in the order of their rows; true checks run backwards, the costly one of contact last.

    Args:
        finder: of contacts, with the margin to keep.
        certificate: of contact between keyframes.
        settings: of the step.
        user_limits: what the user asks for; usually none.
        wanted_gap: room that the optimisation of a motion asks for where there is so much [m].
        rails: middle lines of narrow gates, each of shape (k, 2) [m].
        gates: the lines across them; None where there are none.
        guide_tubes: what holds a part of the arm straight; nothing where the base is fixed. Last, for what a user's
            equations move has to be straight again.
    """
    drawn: tuple[Limit, ...] = ()
    if gates is not None:
        drawn = (GateRails(rails, gates, settings.rails.play * finder.margin, settings.rails),)
    return (
        ContactLimit(finder, certificate, settings, wanted_gap, gates),
        TurnLimit(),
        JointLimit(settings),
        *drawn,
        *user_limits,
        *guide_tubes,
    )
