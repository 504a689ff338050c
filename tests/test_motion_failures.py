"""Why no motion was found: the evidence that failed searches leave."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ccm_opt.core.deadline import Deadline
from ccm_opt.core.errors import MotionNotFound, TimeLimitReached
from ccm_opt.planning.search import Failure, StrategyInVain, evidence, nothing_found
from ccm_opt.planning.strategies import find_motion
from ccm_opt.viz.document import PageUnits
from ccm_opt.viz.failure_page import finding_marks
from tests.scenes import clutter, motion_task


def failure(name: str, remaining: float, wall: str) -> Failure:
    """A candidate that ended somewhere."""
    return Failure(name, "the tip stopped", remaining, ("link 3", wall, 1e-3), np.full(24, remaining), np.zeros(24))


EXHAUSTED = (StrategyInVain("candidates", 3, exhausted=True), StrategyInVain("RRT-Connect", 1, exhausted=True))
FAILURES = [failure("far", 0.4, "'post'"), failure("near", 0.1, "'door'"), failure("middle", 0.2, "'post'")]


def test_the_best_candidate_speaks_for_all() -> None:
    """The reason names the candidate that came nearest, how near, and what was tightest there."""
    task = motion_task(clutter(1, 5).problem())
    error = nothing_found(task, FAILURES, EXHAUSTED)
    assert "3 candidates; the best (near) ended with the tip 100.0 mm" in error.diagnosis.reason
    assert "'door'" in error.diagnosis.reason


@pytest.mark.parametrize("left", [900.0, 0.0])
def test_what_held_the_best_attempt_is_told_and_drawn(left: float) -> None:
    """Its joints at their limits and the wall beside it are named, with what to do; time alone is never the advice."""
    problem = clutter(1, 5).problem()
    task = replace(motion_task(problem), deadline=Deadline.after(left))
    bends = np.zeros(task.arm.links)
    bends[[2, 4]] = task.arm.bend_limits[[2, 4]] * [1.0, -1.0]
    best = replace(failure("near", 0.1, "'door'"), pose=bends, bends=bends)
    cut = StrategyInVain("RRT-Connect", 0, exhausted=left > 0.0)
    diagnosis = nothing_found(task, [best], (cut,)).diagnosis
    assert "joints 3 and 5 at the limit of" in diagnosis.reason
    assert any(line.startswith("raise arm.joint_limit_deg (not tried): ") for line in diagnosis.advice)
    assert any("'door'" in line and "link 3" in line for line in diagnosis.advice)
    marks = finding_marks(problem, diagnosis, PageUnits.of_page(problem))
    (arm,) = [mark["points"] for mark in marks if mark["kind"] == "arm"]
    assert np.array(arm) == pytest.approx(problem.arm.joint_positions_at(best.pose), abs=1e-5)


def test_evidence_is_ranked_and_plain() -> None:
    """Candidates stand in order of how near they came, walls by how often they were in the way; all is JSON."""
    found = evidence(sorted(FAILURES, key=lambda f: f.remaining))
    plain = json.loads(json.dumps(found))
    assert [item["name"] for item in plain["candidates"]] == ["near", "middle", "far"]
    assert plain["in_the_way"] == {"'post'": 2, "'door'": 1}
    assert plain["candidates"][0]["link"] == "link 3"
    assert plain["nearest_pose"] == [0.1] * 24


def test_what_was_exhausted_is_said() -> None:
    """When every strategy is exhausted the failure is none of time, and words and record say how much was tried."""
    error = nothing_found(motion_task(clutter(1, 5).problem()), FAILURES, EXHAUSTED)
    assert isinstance(error, MotionNotFound)
    assert error.diagnosis.reason.endswith("; exhausted: candidates (3 attempts), RRT-Connect (1 attempt)")
    strategies = json.loads(json.dumps(error.diagnosis.evidence["strategies"]))
    assert strategies[0] == {"name": "candidates", "attempts": 3, "exhausted": True}


def test_time_limit_is_said() -> None:
    """A strategy that the time cut short makes the failure one of time, with the same evidence and what was cut."""
    task = replace(motion_task(clutter(1, 5).problem()), deadline=Deadline.after(0.0))
    error = nothing_found(task, FAILURES, (EXHAUSTED[0], StrategyInVain("RRT-Connect", 0, exhausted=False)))
    assert isinstance(error, TimeLimitReached)
    assert error.diagnosis.evidence["in_the_way"] == {"'post'": 2, "'door'": 1}
    assert "exhausted: candidates (3 attempts); not begun: RRT-Connect" in error.diagnosis.reason


def test_a_search_in_vain_lists_its_strategies() -> None:
    """Every strategy that applies stands in the record, in turn; without time none is called exhausted."""
    task = replace(motion_task(clutter(1, 5).problem()), deadline=Deadline.after(0.0))
    with pytest.raises(TimeLimitReached) as caught:
        find_motion(task)
    listed = caught.value.diagnosis.evidence["strategies"]
    assert isinstance(listed, list)
    assert [each["name"] for each in listed] == ["arcs at the limits", "candidates", "RRT-Connect again"]
    assert not any(each["exhausted"] for each in listed)
