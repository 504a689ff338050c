"""Tolerances of the verifier, and how hard it looks."""

from dataclasses import dataclass, replace

from ccm_opt.problem import Problem
from ccm_opt.problem.options import CONTACT_SHARE_OF_LENGTH


@dataclass(frozen=True)
class VerificationSettings:
    """Numbers of the independent checks; the planners have their own, which are stricter.

    Lengths are shares of the arm's length, until ``for_problem`` makes metres of them.

    Attributes:
        contact_tolerance: gap that may be missing before a motion is refused, where the problem does not say.
            Taste: see ``problem.options.CONTACT_SHARE_OF_LENGTH``.
        touch: gap that axes without width keep. Derived: rounding of positions in a room of some arm's lengths.
        goal_rounding: distance from the goal beyond its tolerance that is rounding. Derived: likewise.
        largest_step: largest time between two samples [s]; the promise of the file format.
        time_rounding: time by which a step may be longer, or a pause shorter, than it should, by rounding [s].
        bend_tolerance: bend beyond its limit that counts as rounding [rad].
        limit_tolerance: share by which velocity, acceleration, jerk and effort may pass their limits. Taste.
        match: difference between bends and revolutes that counts as rounding [rad, rad/s, rad/s²].
        unseen_share: share of the velocity that a joint gains and loses which jumps of acceleration between samples may
            account for. Taste: twice what the fastest motions of TOPP-RA, whose accelerations jump, were seen to need.
        unseen_floor: the same as a share of what the acceleration limit allows over the whole motion, for joints that
            hardly move. Taste.
        effort_mismatch: share of the peak effort by which reported efforts may differ from the verifier's own. Taste:
            two recursions in other orders of summation agree to some 1e-12.
        effort_floor: difference of efforts beside that share, for an arm of a metre [N m, N]; it grows like torques.
        range_tolerance: position of the base beyond its range that is rounding. Derived: as ``touch``.
        inside: a joint is held when it is farther than this inside the guide tube. Derived: ten times as much.
        held_tolerance: bend of a held joint that is rounding [rad]. Derived.
        passing_tolerance: bend that a joint may have, by linear interpolation between two samples, when it passes the
            hole of a guide tube [rad]. Taste.
        start_tolerance: largest error of a joint at the start [rad]. Taste.
        rest_share: share of the velocity limit that counts as rest. Taste.
        curve_tip_tolerance: distance of the arm's tip from the tip of the curve that it starts on. Taste.
        half_turn_rounding: by which bends may fall short of half a turn and still count as one, by rounding [rad].
        resolution: travel below which a stretch of time is not halved again.
        report_resolution: the least gap that is reported is at most this much above the true one. Taste.
        report_share: the same as a share of that gap, where that is more. Taste: none.
        most_report_pairs: pairs at one level of halving beyond which the report is no longer refined; the proof is.
        most_pairs: undecided pairs at one level of halving beyond which the verifier gives up, and refuses. Derived:
            some 200 MB of arrays.
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
        """The same with lengths in metres, for a problem's arm, and with the contact tolerance that it asks for."""
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
"""Settings that are lengths."""
DEFAULT_VERIFICATION = VerificationSettings()
"""What every verification uses unless it is given others."""
