"""Tolerances of the verifier, and limits on its computing effort."""

from dataclasses import dataclass, replace

from ccm_opt.problem import Problem
from ccm_opt.problem.options import CONTACT_SHARE_OF_LENGTH


@dataclass(frozen=True)
class VerificationSettings:
    """Tolerances and work limits of the verifier; planners have their own, stricter settings.

    Lengths are fractions of the arm's length until ``for_problem`` converts them to metres.

    Attributes:
        contact_tolerance: amount by which a gap may fall short before a motion is rejected, unless the problem sets it.
            Heuristic: see ``problem.options.CONTACT_SHARE_OF_LENGTH``.
        touch: least distance that two link axes must keep. Derived: rounding of positions in a scene of a few arm
            lengths.
        goal_rounding: distance from the goal beyond its tolerance that counts as rounding. Derived: as ``touch``.
        largest_step: largest time between two samples [s]; guaranteed by the file format.
        time_rounding: time by which a step may be too long, or a pause too short, owing to rounding [s].
        bend_tolerance: bend beyond its limit that counts as rounding [rad].
        limit_tolerance: fraction by which velocity, acceleration, jerk and effort may exceed their limits. Heuristic.
        match: difference between bends and drive angles (revolutes) or their rates that counts as rounding [rad, rad/s,
            rad/s²].
        unseen_share: fraction of a joint's total change of velocity that may come from jumps of acceleration between
            samples. Heuristic: twice what the fastest motions of TOPP-RA, whose accelerations jump, were measured to
        need. unseen_floor: additional allowance, as a fraction of the velocity that the acceleration limit allows over
            the whole motion, for joints that hardly move. Heuristic.
        effort_mismatch: fraction of the peak effort by which reported efforts may differ from the verifier's own.
            Heuristic: two recursions with different orders of summation agree to about 1e-12.
        effort_floor: additional allowed difference of efforts for an arm of one metre [N m, N]; scales with the square
            of the arm's length.
        range_tolerance: position of the base beyond its range that counts as rounding. Derived: as ``touch``.
        inside: depth in the guide tube beyond which a joint counts as held. Derived: ten times ``touch``.
        held_tolerance: bend of a held joint that counts as rounding [rad]. Derived.
        passing_tolerance: bend that a joint may have, by linear interpolation between two samples, when it passes the
            hole of a guide tube [rad]. Heuristic.
        start_tolerance: largest error of a joint at the start [rad]. Heuristic.
        rest_share: fraction of the velocity limit below which a joint counts as at rest. Heuristic.
        curve_tip_tolerance: allowed distance of the arm's tip from the end of the curve that gives the start pose.
            Heuristic.
        half_turn_rounding: angle by which bends may fall short of half a turn and still count as one [rad].
        resolution: travel of a body in a time interval below which the interval is not halved again.
        report_resolution: largest excess of the reported least gap over the true one. Heuristic.
        report_share: largest excess of the reported least gap over the true one, as a fraction of that gap; the larger
            allowance applies. Heuristic: none.
        most_report_pairs: number of pairs at one level of halving beyond which only the proof, not the reported gap, is
            refined further.
        most_pairs: number of undecided pairs at one level of halving beyond which the verifier gives up and rejects the
            motion. Derived: about 200 MB of arrays.
    """

    contact_tolerance: float = CONTACT_SHARE_OF_LENGTH
    touch: float = 1e-9
    goal_rounding: float = 1e-9
    largest_step: float = 5e-3
    time_rounding: float = 1e-9
    bend_tolerance: float = 1e-9
    limit_tolerance: float = 1e-6
    match: float = 1e-9
    unseen_share: float = 0.05
    unseen_floor: float = 1e-3
    effort_mismatch: float = 1e-6
    effort_floor: float = 1e-9
    range_tolerance: float = 1e-9
    inside: float = 1e-8
    held_tolerance: float = 1e-9
    passing_tolerance: float = 1e-6
    start_tolerance: float = 1e-6
    rest_share: float = 1e-6
    curve_tip_tolerance: float = 1e-3
    half_turn_rounding: float = 1e-9
    resolution: float = 1e-9
    report_resolution: float = 1e-4
    report_share: float = 0.0
    most_report_pairs: int = 100_000
    most_pairs: int = 2_000_000

    def for_problem(self, problem: Problem) -> "VerificationSettings":
        """Return the settings for a problem: lengths in metres, and the problem's contact tolerance, if set."""
        length = problem.arm.length
        lengths = {name: length * getattr(self, name) for name in _LENGTHS}
        asked = problem.verification.contact_tolerance
        if asked is not None:
            lengths["contact_tolerance"] = asked
        return replace(self, **lengths, effort_floor=self.effort_floor * length**2)


_LENGTHS = (
    "contact_tolerance",
    "touch",
    "goal_rounding",
    "range_tolerance",
    "inside",
    "curve_tip_tolerance",
    "resolution",
    "report_resolution",
)
"""Names of the settings that are lengths, given as fractions of the arm's length."""
DEFAULT_VERIFICATION = VerificationSettings()
"""Default tolerances and work limits of the verifier."""
