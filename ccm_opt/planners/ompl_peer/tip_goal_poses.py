"""Poses at a goal, from which OMPL's second tree grows: that of the whole arm, or some that have the tip there."""

import numpy as np

from ccm_opt.collision.certificate import Certificate
from ccm_opt.errors import Diagnosis, MotionNotFound
from ccm_opt.ground.arrays import FloatArray
from ccm_opt.ground.deadline import Deadline
from ccm_opt.motion.connect.goal_draws import GoalDraws
from ccm_opt.motion.connect.sampled_check import SampledCheck
from ccm_opt.motion.connect.target_draws import TargetDraws
from ccm_opt.motion.ends import Ends
from ccm_opt.planners.ompl_peer.ompl_settings import OmplSettings
from ccm_opt.problem import Problem


def poses_at_goal(
    problem: Problem, ends: Ends, certificate: Certificate, deadline: Deadline, settings: OmplSettings
) -> FloatArray:
    """Link headings of poses at the goal that touch nothing, shape (m ≥ 1, links) [rad].

    Raises:
        MotionNotFound: none was drawn within its share of the time.
    """
    if ends.goal_headings is not None:
        return ends.goal_headings[None]

    rng = np.random.default_rng(problem.planner.seed)
    check = SampledCheck.of(problem.arm, problem.workspace, settings.draws.sampling)
    drawn = GoalDraws(_any_shape(problem, ends, settings), ends.goal, check, settings.draws.goals).poses(rng)
    until = Deadline.after(settings.goal_share * problem.planner.time_limit)
    found: list[FloatArray] = []
    while len(found) < settings.goal_poses and not until.passed() and not deadline.passed():
        found += [pose for pose in next(drawn) if stands_free(certificate, pose)]
    if not found:
        reason = "no pose with the tip at the goal that touches nothing was drawn"
        raise MotionNotFound(Diagnosis(reason, "goal", ("raise planner.time_limit", "use planner.method nlp")))
    return np.array(found[: settings.goal_poses])


def stands_free(certificate: Certificate, headings: FloatArray) -> bool:
    """Whether a pose touches nothing, link headings (links,) [rad]."""
    return len(certificate.failures(np.stack((headings, headings)), depth=0)) == 0


def _any_shape(problem: Problem, ends: Ends, settings: OmplSettings) -> TargetDraws:
    """Draws of every shape that the joints allow; a base that is clamped stays where it is."""
    arm = problem.arm
    free = np.eye(arm.links)
    if ends.clamped:
        free[0, 0] = 0.0
    first = float(arm.bends(ends.start)[0])
    bound = float(arm.bend_limits[0])
    # As far as the base may turn at all: other planners are held to what winds the arm least.
    base = (first, first) if ends.clamped else (-bound, bound)
    return TargetDraws(arm, free, (ends.start, ends.start), arm.bend_limits, base, settings.draws)
