"""Tolerances of the verifier, and how hard it looks."""

from dataclasses import dataclass, replace

from ccm_opt.problem.planning_problem import CONTACT_SHARE_OF_LENGTH
from ccm_opt.verification.checked_problem import CheckedProblem


@dataclass(frozen=True)
class VerificationSettings:
    """Numbers of the independent checks; the planners have their own, which are stricter.

    Lengths are shares of the arm's length, until ``for_problem`` makes metres of them.

    Attributes:
        contact_tolerance: gap that may be missing before a motion is refused, where the problem does not say.
            Taste: see ``problem.planning_problem.CONTACT_SHARE_OF_LENGTH``.
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
        along: sine of the angle to the way of the base up to which a link lies along it. Taste: over the way between
            two samples it goes aside by far less than any tolerance of contact.
        start_tolerance: largest error of a joint at the start [rad]. Taste.
        rest_share: share of the velocity limit that counts as rest. Taste.
        curve_tip_tolerance: distance of the arm's tip from the tip of the curve that it starts on. Taste.
        curve_shape_factor: a joint may be this times κ l² off its curve; the worst error of the paper's own mapping
            (section 5.3).
        curve_shape_slack: share of a link's length that a joint may be off beside that. Taste.
        half_turn_rounding: by which bends may fall short of half a turn and still count as one, by rounding [rad].
        keyframe_share: share of the second difference of its keyframes by which a motion may pass one of them. Derived:
            twice the sixth of a uniform cubic B-spline; 0.23 was seen beside clamped ends.
        clamped_share: share of the second difference of the third keyframe by which a motion may pass the second one
            besides, and likewise at the end. Derived: twice t³ / 6 at t = 0.407, where a clamped uniform cubic B-spline
            of even steps passes its second control point.
        curve_match: difference of a reported curve from that of its keyframe, as a share of the greatest curvature,
            that is rounding. Derived: a least-squares fit of some twenty numbers keeps some ten digits.
        followed_curve: difference of a link's heading from that of a curve that was planned first [rad]. Taste: the
            paper's planner samples headings, and was seen to miss 0.02 in segments that it has nearly shrunk away.
        simulated_angle: difference between a written simulation and another run of it that is rounding [rad, m]. Taste:
            machines and back ends were seen to differ by 1e-13.
        simulated_torque: the same for torques, as a share of the greatest.
        figure_share: share by which a written figure may differ from that of the arrays. Taste: far above rounding.
        figure_floor: difference of figures beside that share: figures of nothing but rounding are alike. Taste.
        resolution: travel below which a stretch of time is not halved again.
        report_resolution: the least gap that is reported is at most this much above the true one. Taste.
        most_report_pairs: pairs at one level of halving beyond which the report is no longer refined; the proof is.
        most_pairs: undecided pairs at one level of halving beyond which the verifier gives up, and refuses. Derived:
            some 200 MB of arrays.
        wall_probes: poses at which the nearest wall is looked up first, to know how far the search must look. Taste.
        pair_probes: poses at which all pairs of links are measured first, likewise. Taste.
        many_edges: walls with as many edges are looked at in runs of them first. Taste.
        edges_a_run: edges in a run. Taste: their chord is near all of them, and few runs are near the arm.
        rows_at_once: poses that follow each other whose links are looked for near walls together first. Measured: with
            16 the search takes half the time that it takes pose by pose, and hardly less with more.
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
    along: float = 1e-6
    start_tolerance: float = 1e-6
    rest_share: float = 1e-6
    curve_tip_tolerance: float = 1e-3
    curve_shape_factor: float = 1.08
    curve_shape_slack: float = 0.1
    half_turn_rounding: float = 1e-9
    keyframe_share: float = 1.0 / 3.0
    clamped_share: float = 0.0225
    curve_match: float = 1e-6
    followed_curve: float = 0.05
    simulated_angle: float = 1e-6
    simulated_torque: float = 1e-6
    figure_share: float = 1e-6
    figure_floor: float = 1e-9
    resolution: float = 1e-9
    report_resolution: float = 1e-4
    most_report_pairs: int = 100_000
    most_pairs: int = 2_000_000
    wall_probes: int = 48
    pair_probes: int = 24
    many_edges: int = 64
    edges_a_run: int = 16
    rows_at_once: int = 16

    def for_problem(self, problem: CheckedProblem) -> "VerificationSettings":
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
