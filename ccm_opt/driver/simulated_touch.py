"""Where the simulated arm first touches a wall or itself: what it does is looked at as strictly as what was planned."""

from dataclasses import dataclass, replace

import numpy as np

from ccm_opt.driver.seen_arm import Seen, Touch
from ccm_opt.ground.rounding import ROUNDING
from ccm_opt.jointed.frames import bends_from_revolutes
from ccm_opt.problem import Problem
from ccm_opt.solution import JointTrajectory, SimulatedMotion
from ccm_opt.verification.bisection import Verdict
from ccm_opt.verification.link_motion import ChainMotion
from ccm_opt.verification.selfcollision import nearest_links
from ccm_opt.verification.verification_settings import DEFAULT_VERIFICATION, VerificationSettings
from ccm_opt.verification.wall_clearance import nearest_wall


def chain_motion(problem: Problem, trajectory: JointTrajectory, simulated: SimulatedMotion) -> ChainMotion | None:
    """What the simulated arm does, linear between samples; None when no step was run, or the arm left its plane."""
    angles = simulated.angles
    if simulated.verdict.outcome == "not simulated" or len(angles) < 2:
        return None
    # Obstacles are known in the plane alone, which yaws and rolls beyond rounding leave.
    if max(np.max(np.abs(angles[:, place::3])) for place in (0, 2)) > ROUNDING:
        return None
    positions = np.column_stack((bends_from_revolutes(problem.arm, angles), simulated.base_positions))
    return ChainMotion(problem.arm, trajectory.time, positions)


def seen_in_plane(
    problem: Problem,
    trajectory: JointTrajectory,
    simulated: SimulatedMotion,
    settings: VerificationSettings = DEFAULT_VERIFICATION,
) -> Seen | None:
    """What a simulated arm comes near to; None when no step was run, or the arm left its plane.

    Args:
        problem: walls and arm.
        trajectory: the plan, for its times.
        simulated: what the arm did.
        settings: of the proofs that it is free of contact.
    """
    chain = chain_motion(problem, trajectory, simulated)
    if chain is None:
        return None
    found = approaches(problem, chain, settings)
    # An arm that was stopped out of control stands still from there on, so whatever it touches it touched before.
    touch = None if found.touch is None else first_touch(problem, chain, found.touch, settings)
    walls = np.inf if found.walls is None else found.walls[0].nearest.gap
    return Seen(touch, walls, None if found.itself is None else found.itself.nearest.gap)


@dataclass(frozen=True)
class Approaches:
    """The nearest approach of a motion to walls and of the arm to itself; the search for it ends at a contact.

    Attributes:
        walls: with the name of the wall; None when the whole arm counts as its mount.
        itself: None when links may meet, or cannot.
    """

    walls: tuple[Verdict, str] | None
    itself: Verdict | None

    @property
    def touch(self) -> Touch | None:
        """A contact, walls before links; None when there is none."""
        if self.walls is not None and not self.walls[0].proved:
            near = self.walls[0].nearest
            return Touch(near.link + 1, f"'{self.walls[1]}'", near.time)
        if self.itself is not None and not self.itself.proved:
            near = self.itself.nearest
            return Touch(near.link + 1, f"link {near.other + 1}", near.time)
        return None


def approaches(
    problem: Problem, motion: ChainMotion, settings: VerificationSettings = DEFAULT_VERIFICATION
) -> Approaches:
    """The nearest approaches of a motion."""
    settings = settings.for_problem(problem)
    # The clearance is for plans: a lack of it, which would end the search sooner, must not hide a contact.
    bare = replace(problem.workspace, clearance=0.0)
    itself = nearest_links(motion, settings) if problem.arm.self_collision else None
    return Approaches(nearest_wall(motion, bare, settings), itself)


def first_touch(
    problem: Problem, motion: ChainMotion, some: Touch, settings: VerificationSettings = DEFAULT_VERIFICATION
) -> Touch:
    """The first contact of a motion, to within a step of its samples.

    Args:
        problem: walls and arm.
        motion: of the arm.
        some: any contact of the motion.
        settings: of the proofs that a part of it is free of contact.
    """
    # The motion up to sample ``late`` touches; that up to ``early`` does not, unless the motion begins in contact.
    early = 0
    late = max(int(np.searchsorted(motion.time, some.time)), 1)
    while late - early > 1:
        middle = (early + late) // 2
        touch = approaches(problem, _part(motion, 0, middle), settings).touch
        if touch is None:
            early = middle
        else:
            late = middle
    return approaches(problem, _part(motion, late - 1, late), settings).touch or some


def _part(motion: ChainMotion, first: int, last: int) -> ChainMotion:
    """The motion from one sample to another."""
    samples = slice(first, last + 1)
    return ChainMotion(motion.arm, motion.time[samples], motion.positions[samples])
