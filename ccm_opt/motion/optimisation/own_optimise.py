"""The driver where the user has constraints or costs: keyframes know their path parameter and stay on the equations."""

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ccm_opt.arrays import FloatArray
from ccm_opt.geometry.polyline import arc_lengths
from ccm_opt.motion.link_space import LinkSpace
from ccm_opt.motion.motion_task import Motion, MotionTask
from ccm_opt.motion.optimisation.keyframes import Failures, decimated, subdivided
from ccm_opt.motion.optimisation.own_terms import KeyframeTerms
from ccm_opt.motion.optimisation.sequential_convex import Program, sequential_convex
from ccm_opt.motion.optimisation.swept_motion import Sweep

if TYPE_CHECKING:
    from ccm_opt.user_terms.compiled_terms import UserTerms

INTERVALS = (24, 48, 96)
"""Numbers of intervals that are tried, until the motion is certified with its keyframes on the equations."""
LEG_DEPTH = 2
"""Bisections that a leg of the thinned motion may need for its certificate."""
ROUNDS = 24


def optimise_own(motion: Motion, task: MotionTask, program: Program) -> Motion:
    """Make a motion's cost, the user's own included, small within the user's constraints.

    Args:
        motion: certified, its keyframes on the user's equations.
        task: with the user's terms.
        program: the same without them.

    Returns:
        The last certified motion; the given one when its keyframes cannot be thinned.
    """
    terms, space = task.terms, motion.space
    if terms is None:
        return motion
    failures = partial(task.certificate.failures, depth=LEG_DEPTH)
    for intervals in INTERVALS:
        labelled = _thinned(motion, terms, lambda v: failures(space.headings(v[:, :-1])), intervals)
        own = KeyframeTerms(space, terms, labelled[:, -1])
        start = own.returned(labelled[:, :-1].copy())
        if not (own.met(Sweep(space, start)) and _within_limits(space, start)):
            continue
        if len(task.certificate.failures(space.headings(start))):
            continue
        coordinates = sequential_convex(replace(program, own=own), start, ROUNDS)
        return replace(motion, coordinates=coordinates, headings=space.headings(coordinates), u=own.u)
    return motion


def _within_limits(space: LinkSpace, coordinates: FloatArray) -> bool:
    return bool(np.all(np.abs(space.arm.bends(space.headings(coordinates))) <= space.arm.bend_limits))


def path_parameters(motion: Motion) -> FloatArray:
    """Path parameter of every keyframe: its own, or its share of the motion's length in joint space, shape (K,)."""
    if motion.u is not None:
        return motion.u
    bends = motion.space.arm.bends(motion.headings)
    way = arc_lengths(bends)
    shares: FloatArray = way / way[-1] if way[-1] > 0.0 else np.linspace(0.0, 1.0, len(way))
    return shares


def even_parameters(least: int, breaks: FloatArray) -> FloatArray:
    """Path parameters of keyframes, as even as may be, some of them at given places.

    Args:
        least: number of intervals; there may be up to half as many more when the places are met better so.
        breaks: places that a keyframe has to be at, shape (m,).
    """
    counts = np.arange(least, 3 * least // 2)[:, None]
    misses = np.max(np.abs(breaks - np.round(breaks * counts) / counts), axis=1, initial=0.0)
    count = least + int(np.argmin(np.round(misses, 9)))
    u = np.linspace(0.0, 1.0, count + 1)
    u[np.round(breaks * count).astype(np.intp)] = breaks
    return u


def _thinned(motion: Motion, terms: "UserTerms", failures: Failures, intervals: int) -> FloatArray:
    """Coordinates and path parameters at few keyframes, shape (K + 1, p + 1).

    On certified legs; where the path parameter counts, at even steps of it.
    """
    labelled = np.column_stack((motion.coordinates, path_parameters(motion)))
    if motion.u is not None:
        u = even_parameters(intervals, terms.breaks)
        return np.column_stack([*(np.interp(u, motion.u, column) for column in motion.coordinates.T), u])
    few = decimated(labelled, failures)
    turns = np.diff(motion.space.arm.bends(motion.space.headings(few[:, :-1])), axis=0)
    return subdivided(few, np.linalg.norm(turns, axis=1), intervals)
