"""Find a configuration: guesses, windings and segment counts in turn, until one solves and passes the dense check."""

from collections.abc import Iterator
from itertools import islice, product

import numpy as np

from ccm_opt.continuum.configuration import Configuration
from ccm_opt.errors import ConfigurationNotFound
from ccm_opt.ground.angles import WHOLE_TURN
from ccm_opt.nlp.check import shortfalls
from ccm_opt.nlp.configuration_task import ConfigurationTask
from ccm_opt.nlp.infeasibility import FailedAttempt, beyond_reach, diagnose
from ccm_opt.nlp.initial_guess import curve_shares, initial_guess
from ccm_opt.nlp.multiple_shooting import build_configuration_nlp
from ccm_opt.nlp.path_profile import PathProfile, path_profile
from ccm_opt.nlp.polish import polished_configuration
from ccm_opt.nlp.solver import solve_nlp


def find_configuration(task: ConfigurationTask, most_attempts: int | None = None) -> Configuration:
    """A configuration that reaches the goal inside the corridor within the curvature limit.

    Tries one segment a region first, then more; for each the nearest winding of the tip heading, then its
    neighbours, and the surplus length to either side. Every answer is polished and densely checked.

    Args:
        task: poses, length, limits and corridor.
        most_attempts: give up after so many; all by default, at most ten. Most tasks need one.

    Returns:
        A checked configuration: tip within 1e-5 m, |κ| within the limit, inside the corridor.

    Raises:
        ConfigurationNotFound: no attempt passed; its diagnosis names the row that stood in the way.
    """
    if (obstacle := beyond_reach(task)) is not None:
        raise ConfigurationNotFound(obstacle)
    failures: list[FailedAttempt] = []
    for regions, profile, bulge in islice(attempts(task), most_attempts):
        outcome = attempt(task, regions, profile, bulge)
        if isinstance(outcome, Configuration):
            return outcome
        failures.append(outcome)
    raise ConfigurationNotFound(diagnose(task, failures))


def attempt(
    task: ConfigurationTask, regions: tuple[int, ...], profile: PathProfile, bulge: int
) -> Configuration | FailedAttempt:
    """One guess, one solve, one check.

    Args:
        task: what is to be found.
        regions: region of each segment.
        profile: headings along the path, with their whole turns.
        bulge: side of the surplus length.
    """
    tip_heading = None if task.goal_heading is None else profile.tip_heading
    nlp = build_configuration_nlp(task, regions, tip_heading)
    result = solve_nlp(nlp, initial_guess(nlp, profile, bulge))
    if not result.feasible:
        return FailedAttempt(nlp, result)
    configuration = polished_configuration(nlp, result.variables)
    missed = shortfalls(nlp, configuration)
    return FailedAttempt(nlp, result, missed) if missed else configuration


def attempts(task: ConfigurationTask) -> Iterator[tuple[tuple[int, ...], PathProfile, int]]:
    """Regions of the segments, path headings and side of the surplus length, most promising first."""
    profiles = winding_profiles(task)
    first, *others = segment_regions(task, profiles[0])
    # Most tasks need the first guess only; more segments cost more than another side or winding.
    yield first, profiles[0], 1
    yield first, profiles[0], -1
    for profile in profiles[1:]:
        yield first, profile, 1
    for regions in others:
        yield regions, profiles[0], 1
        yield regions, profiles[0], -1


def winding_profiles(task: ConfigurationTask) -> list[PathProfile]:
    """The path's headings with the fewest whole turns at its ends: the nearest winding, then its neighbours."""
    low, high = task.base_heading_range
    # A base that turns freely meets the path's heading as it is; a fixed one may have to wind round to it.
    base = (0, 1, -1) if high - low < WHOLE_TURN else (0,)
    tip = (0,) if task.goal_heading is None else (0, 1, -1)
    profiles = [path_profile(task, *turns) for turns in product(base, tip)]
    return sorted(profiles, key=lambda profile: profile.end_turns)[: task.settings.windings]


def segment_regions(task: ConfigurationTask, profile: PathProfile) -> list[tuple[int, ...]]:
    """Region of each segment: ``segments_per_region`` each, then the totals of the settings, shared by curve length."""
    count = len(task.corridor.regions)
    shares = np.full(count, task.segments_per_region)
    plans = [shares.copy()]
    lengths = curve_shares(task, profile)
    for total in task.settings.segment_totals:
        while shares.sum() < total:
            shares[np.argmax(lengths / shares)] += 1  # to the region whose segments are longest
        if shares.sum() > plans[-1].sum():
            plans.append(shares.copy())
    return [tuple(np.repeat(np.arange(count), plan).tolist()) for plan in plans]
