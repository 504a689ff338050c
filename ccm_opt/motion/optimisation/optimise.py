"""The driver: thin a certified motion to few keyframes, optimise them all at once, keep what is certified."""

from dataclasses import asdict
from functools import partial

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.collision.certificate import Certificate
from ccm_opt.geometry.polyline import path_length
from ccm_opt.motion.motion_task import Motion, MotionTask
from ccm_opt.motion.optimisation.clearance_rows import motion_rows
from ccm_opt.motion.optimisation.interior_point import interior_point
from ccm_opt.motion.optimisation.keyframes import decimated, subdivided
from ccm_opt.motion.optimisation.own_optimise import optimise_own
from ccm_opt.motion.optimisation.sequential_convex import Program, sequential_convex
from ccm_opt.motion.optimisation.sweep_regions import WallSegments
from ccm_opt.problem import Weights

INTERVALS = 20
"""Least number of intervals; a motion that needs more legs to be certified keeps them."""
LEG_DEPTH = 2
"""Bisections that a leg of the thinned motion may need for its certificate."""
MARGIN = 1e-3
"""Gap that rows ask for beyond contact, as a share of the arm's length."""
REACH = 2.5
"""Walls and links farther apart than this many links, at most ``LARGEST_LINK`` of the arm each, make no rows."""
LARGEST_LINK = 1.0 / 36.0
"""Share of the arm's length."""

ACTIVE = 1.1
"""Rows nearer to their bound than this many such links enter the QP."""


def optimise(motion: Motion, task: MotionTask, margin: float = MARGIN) -> Motion:
    """Shorten a certified motion in its homotopy class.

    Args:
        motion: piecewise linear in its link space, certified.
        task: arm, room, goal and deadline.
        margin: gap that rows ask for beyond contact, as a share of the arm's length.

    Returns:
        The last certified motion: with a shorter joint path (or whatever the task's weights ask for) and few
        keyframes, with the same start; the given one when nothing shorter was found.
    """
    certificate = task.certificate
    if task.optimiser == "none" or len(motion.coordinates) < 2 or task.deadline.passed():
        return motion
    program = _program(motion, task, margin)
    if task.terms is not None:
        return optimise_own(motion, task, program)
    coordinates = thinned(motion, certificate)
    solve = interior_point if task.optimiser == "interior-point" else sequential_convex
    optimised = solve(program, coordinates)
    return _better(motion, optimised, plain=task.weights == Weights())


def thinned(motion: Motion, certificate: Certificate, intervals: int = INTERVALS) -> FloatArray:
    """Coordinates at few keyframes on certified legs, at least ``intervals`` of them, shape (K + 1, p)."""
    space = motion.space
    few = decimated(motion.coordinates, lambda v: certificate.failures(space.headings(v), LEG_DEPTH))
    turns = np.diff(space.arm.bends(space.headings(few)), axis=0)
    return subdivided(few, np.linalg.norm(turns, axis=1), intervals)


def travel(motion: Motion) -> float:
    """Length of the joint path, Σ |Δq| [rad]."""
    bends = motion.space.arm.bends(motion.headings)
    return path_length(bends)


def _program(motion: Motion, task: MotionTask, margin: float) -> Program:
    length = task.arm.length
    link = min(task.arm.link_length, LARGEST_LINK * length)
    make_rows = partial(
        motion_rows,
        workspace=task.workspace,
        segments=WallSegments.of(task.workspace),
        margin=margin * length,
        reach=REACH * link,
    )
    return Program(
        motion.space,
        task.goal_in(motion.space),
        task.goal_headings is not None,
        make_rows,
        task.certificate.failures,
        ACTIVE * link,
        task.deadline,
        normalised(task.weights),
        task.slowness,
    )


def normalised(weights: Weights) -> Weights:
    """The same weights in proportion, the largest of those on turns 1: prices and damping are made for that."""
    largest = max(weights.path_length, weights.smoothness, weights.duration)
    scale = largest if largest > 0.0 else 1.0
    return Weights(**{name: value / scale for name, value in asdict(weights).items()})


def _better(motion: Motion, coordinates: FloatArray, *, plain: bool) -> Motion:
    """The optimised motion; with the plain weights only if it is shorter, else the given one."""
    optimised = Motion(motion.space, coordinates, motion.space.headings(coordinates), motion.candidate)
    return optimised if not plain or travel(optimised) < travel(motion) else motion
