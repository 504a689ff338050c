"""Long motions are cut short before they are optimised, and short ones are left alone."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from ccm_opt.planning.motion import Motion
from ccm_opt.planning.motion_task import MotionTask
from ccm_opt.planning.optimisation.optimise import thinned
from ccm_opt.planning.shortcuts import MANY_INTERVALS, straightened
from ccm_opt.planning.strategies import find_motion
from tests.scenes import clutter, motion_task, sweep_gaps, swept


def to_and_fro(seed: int, times: int) -> tuple[MotionTask, Motion]:
    """A found motion that goes there and back several times before it goes there."""
    task = motion_task(clutter(seed, 20).problem(), guessing=True)
    found = find_motion(replace(task, optimiser="none"))
    back = np.vstack((found.unknowns, found.unknowns[-2::-1]))
    coordinates = np.vstack((*(back[:-1] for _ in range(times)), found.unknowns))
    return task, replace(found, unknowns=coordinates, configurations=found.curve.configurations(coordinates))


@pytest.mark.drawn(1)
@pytest.mark.parametrize("seed", [50_001, 50_004])
def test_a_motion_to_and_fro_is_cut_short(seed: int) -> None:
    """What is left has the same ends, is certified, touches nothing in a dense sweep, and is much shorter."""
    task, long = to_and_fro(seed, 8)
    assert len(thinned(long, task)[0]) - 1 > MANY_INTERVALS
    short = straightened(long, task)
    assert short.travel < 0.5 * long.travel
    assert np.array_equal(short.unknowns[[0, -1]], long.unknowns[[0, -1]])
    assert short.curve.configurations(short.unknowns) == pytest.approx(short.configurations)
    assert len(task.certificate.failures(short.configurations)) == 0
    frames = [swept(a, b, 10) for a, b in pairwise(task.arm.headings(short.configurations))]
    assert min(sweep_gaps(task.arm, task.workspace, np.vstack(frames))) > 0.0


def test_a_short_motion_stays_as_it_is() -> None:
    """Few keyframes are cheap to optimise, and no motion is touched where none is to be optimised."""
    task, short = to_and_fro(50_004, 0)
    assert straightened(short, task) is short
    task, long = to_and_fro(50_004, 8)
    assert straightened(long, replace(task, optimiser="none")) is long
