"""Every key and argument works in the plane and in space, or is refused where it does nothing."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ccm_opt
from ccm_opt.core.errors import NoPlanFound, ProblemFileError, UnreachableGoal
from ccm_opt.io.reading import load_problem, parse_problem
from ccm_opt.planning.pose_beginnings import PoseSearchSettings
from ccm_opt.planning.tip_reach import ReachSettings
from ccm_opt.problem import TipGoal
from ccm_opt.problem.options import Weights
from ccm_opt.verification.verification_settings import VerificationSettings

from .command_runs import CommandLine
from .conftest import SMALL_PROBLEM

IN_SPACE = """\
schema = 1
space = 3
name = "small"

[workspace]

[[workspace.obstacles]]
name = "post"
sphere = { center = [0.2, 0.17, 0.0], radius = 0.1 }

[arm]
links = 4
link_length = 0.1
radius = 0.02
base = { position = [0.0, 0.0, 0.0], direction = [1.0, 0.0, 0.0] }
joint_limit_deg = 60.0

[limits]
velocity = 2.0
acceleration = 10.0

[start]
shape = "straight"

[goal]
position = [0.3, 0.1, 0.05]
"""
TEXTS = {"plane": SMALL_PROBLEM.replace("[0.0, 0.3], radius", "[0.2, 0.17], radius"), "space": IN_SPACE}
dimensions = pytest.mark.parametrize("dimension", list(TEXTS))
"""In the plane and in space."""


@cache
def usual(dimension: str) -> Any:
    """The plan of the problem as it stands."""
    return ccm_opt.solve(problem_in(dimension))


@cache
def problem_in(dimension: str) -> Any:
    """The same problem in the plane, or in space."""
    return parse_problem(TEXTS[dimension])


def planned(dimension: str, **options: object) -> Any:
    """The plan with other planner options."""
    problem = problem_in(dimension)
    return ccm_opt.solve(replace(problem, planner=replace(problem.planner, **options)))


CHANGES: dict[str, dict[str, Any]] = {
    "optimiser": {"optimiser": "none"},
    "retiming": {"retiming": "paul"},
    "effort_share": {"effort_share": 0.5},
    "wanted_gap": {"wanted_gap": 0.1},
    **{
        f"weights.{name}": {"weights": Weights(**{name: 30.0})}
        for name in ("path_length", "smoothness", "bending", "clearance", "duration")
    },
}
"""Options by the key that they change."""


@pytest.mark.drawn(6)
@dimensions
@pytest.mark.parametrize("key", list(CHANGES))
def test_an_option_of_the_planner_changes_the_motion(dimension: str, key: str) -> None:
    """A motion that is planned under another value is another one, and as verified."""
    other = planned(dimension, **CHANGES[key])
    assert all(check.passed for check in other.checks)
    mine, theirs = other.trajectory.positions, usual(dimension).trajectory.positions
    assert mine.shape != theirs.shape or not np.allclose(mine, theirs, rtol=0.0, atol=1e-9)


@dataclass(frozen=True)
class Refused:
    """A key that does nothing somewhere.

    Attributes:
        text: of a problem.
        lines: of ``[planner]``.
        key: that is refused.
    """

    text: str
    lines: str
    key: str


PAPER = 'method = "hill-climbing"\n'
REFUSED = {
    "routes-space": Refused(IN_SPACE, "routes = 7", "planner.routes"),
    "method-space": Refused(IN_SPACE, PAPER, "planner.method"),
    "mapping-space": Refused(IN_SPACE, 'mapping = "even-joints"', "planner.mapping"),
    "tries-paper": Refused(SMALL_PROBLEM, f"{PAPER}tries = 2", "planner.tries"),
    "seed-paper": Refused(SMALL_PROBLEM, f"{PAPER}seed = 3", "planner.seed"),
    "optimiser-paper": Refused(SMALL_PROBLEM, f'{PAPER}optimiser = "none"', "planner.optimiser"),
    "weights-paper": Refused(SMALL_PROBLEM, f"{PAPER}weights = {{ bending = 2 }}", "planner.weights"),
    "wanted-gap-paper": Refused(SMALL_PROBLEM, f"{PAPER}wanted_gap = 0.01", "planner.wanted_gap"),
}


@pytest.mark.parametrize("each", REFUSED.values(), ids=list(REFUSED))
def test_a_key_without_effect_is_refused_with_its_line(
    each: Refused, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command ends with exit code 2 and names file, line and key."""
    head, _, rest = each.text.partition("[planner]\n")
    text = f"{head}[planner]\n{each.lines}\n{rest}" if rest else f"{each.text}\n[planner]\n{each.lines}\n"
    file = tmp_path / "own.toml"
    file.write_text(text)
    with pytest.raises(ProblemFileError) as caught:
        load_problem(file)
    (issue,) = caught.value.issues
    assert issue.key == each.key
    name = each.key.rpartition(".")[2]
    assert text.splitlines()[issue.line - 1].startswith(name)
    done = CommandLine(capsys)("solve", file, "--out", tmp_path / "out")
    assert done.code == 2
    assert f"line {issue.line}: {each.key}" in done.err + done.out


@dimensions
def test_the_same_is_refused_of_problems_made_in_python(dimension: str) -> None:
    """What a file would be refused for, a problem from Python is refused for by every verb that plans."""
    problem = problem_in(dimension)
    paper = replace(problem, planner=replace(problem.planner, method="hill-climbing", seed=3))
    for verb in (ccm_opt.solve, ccm_opt.find_pose, ccm_opt.LivePlan):
        with pytest.raises(ccm_opt.ProblemError, match=r"planner\.(seed|method): .hill-climbing"):
            verb(paper)


VERBS: dict[str, Callable[..., Any]] = {"solve": ccm_opt.solve, "find_pose": ccm_opt.find_pose}


@dimensions
@pytest.mark.parametrize("verb", VERBS.values(), ids=list(VERBS))
def test_what_is_proved_is_refused_before_anything_is_planned(dimension: str, verb: Callable[..., Any]) -> None:
    """A goal out of reach, and a constraint that contradicts the goal, are refused in the unit of the file."""
    problem = replace(problem_in(dimension), length_unit="in")
    far = TipGoal(10.0 * problem.goal.position)
    heard: list[str] = []
    with pytest.raises(UnreachableGoal) as caught:
        verb(replace(problem, goal=far), progress=lambda told: heard.append(told.stage))
    assert " in" in caught.value.diagnosis.reason
    assert " mm" not in caught.value.diagnosis.reason
    assert set(heard) <= {"dynamics model", "necessary checks", "diagnosis", "changes that would help"}
    aside = ccm_opt.Constraint("aside", lambda q: q.tip[0], lower=5.0, where="goal")
    with pytest.raises(NoPlanFound, match="constraint 'aside' cannot hold at the goal"):
        verb(problem, constraints=[aside])


@pytest.mark.drawn(1)
@dimensions
def test_settings_reach_every_verb(dimension: str) -> None:
    """Numbers that are handed over are those that count."""
    problem = problem_in(dimension)
    strict = ccm_opt.Settings(verification=VerificationSettings(largest_step=1e-5))
    with pytest.raises(ccm_opt.VerificationError, match="samples"):
        ccm_opt.solve(problem, settings=strict)
    with pytest.raises(ccm_opt.VerificationError, match="samples"):
        ccm_opt.LivePlan(problem, settings=strict)
    wide = ccm_opt.Settings(reach=ReachSettings(step=0.5, step_in_space=0.5))
    assert ccm_opt.reach_map(problem, headings=1, settings=wide).step == 0.5 * problem.arm.length
    few = ccm_opt.Settings(poses=PoseSearchSettings(drawn=1))
    drawn = [each for each in ccm_opt.find_pose(problem, settings=few).outcomes if each.start.startswith("drawn")]
    assert len(drawn) <= 1


@dimensions
def test_every_plan_tells_what_error_of_the_joints_it_survives(dimension: str) -> None:
    """The plan of a short motion has its tolerance and its room, and its goal can be changed on the way."""
    solution = usual(dimension)
    (joints,) = solution.tolerance
    assert joints.name == "joints"
    assert joints.size > 0.0
    assert solution.room is not None
    assert "tolerance" in solution.timings
