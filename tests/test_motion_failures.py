"""Why no motion was found: the evidence that failed searches leave."""

import json
from dataclasses import replace

import numpy as np

from ccm_opt.ground.deadline import Deadline
from ccm_opt.motion.failures import Failure, evidence, nothing_found
from tests.scenes import clutter, motion_task


def failure(name: str, remaining: float, wall: str) -> Failure:
    """A candidate that ended somewhere."""
    headings = np.full(24, remaining)
    return Failure(name, "the tip stopped", f"link 3 and {wall}, gap 1.00 mm", remaining, "", (3, wall, 1e-3), headings)


FAILURES = [failure("far", 0.4, "'post'"), failure("near", 0.1, "'door'"), failure("middle", 0.2, "'post'")]


def test_the_best_candidate_speaks_for_all() -> None:
    """The reason names the candidate that came nearest, how near, and what was tightest there."""
    task = motion_task(clutter(1, 5).problem())
    error = nothing_found(task, FAILURES)
    assert "3 candidates; the best (near) ended with the tip 100 mm" in error.diagnosis.reason
    assert "'door'" in error.diagnosis.reason


def test_evidence_is_ranked_and_plain() -> None:
    """Candidates stand in order of how near they came, walls by how often they were in the way; all is JSON."""
    found = evidence(sorted(FAILURES, key=lambda f: f.remaining))
    plain = json.loads(json.dumps(found))
    assert [item["name"] for item in plain["candidates"]] == ["near", "middle", "far"]
    assert plain["in_the_way"] == {"'post'": 2, "'door'": 1}
    assert plain["candidates"][0]["link"] == 3
    assert plain["nearest_pose"] == [0.1] * 24


def test_time_limit_is_said() -> None:
    """After the deadline the error is TimeLimitReached, with the same evidence."""
    task = replace(motion_task(clutter(1, 5).problem()), deadline=Deadline.after(0.0))
    error = nothing_found(task, FAILURES)
    assert type(error).__name__ == "TimeLimitReached"
    assert error.diagnosis.evidence["in_the_way"] == {"'post'": 2, "'door'": 1}
