"""Seeds and tries: a seed decides what is drawn, and of several tries the best is taken and all are told."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

import ccm_opt
from ccm_opt.cli.commands import app
from ccm_opt.core.errors import CancelledWithPlan, Diagnosis, MotionNotFound, ProblemFileError, UnreachableGoal
from ccm_opt.core.progress import Stages
from ccm_opt.driver.pipeline import Plans, best_try, least_gap
from ccm_opt.driver.solution_assembly import draft_solution
from ccm_opt.driver.verified_plan import TermResults, VerifiedPlan
from ccm_opt.ik.compiled_terms import UserTerms
from ccm_opt.io.reading import parse_problem
from ccm_opt.planning.continuation import GuideCandidate
from ccm_opt.planning.search_run import sampled_order
from ccm_opt.problem import Problem
from tests.conftest import SMALL_PROBLEM
from tests.scenes import clutter, open_scene

SEVERAL = "[planner]\ntries = 3\nseed = 4\n"


@pytest.fixture(scope="module")
def plans() -> dict[str, VerifiedPlan]:
    """Two plans of different durations for one problem, as tries would find them."""
    problem = open_scene(3).problem()
    found = {}
    for name, share in (("fast", 1.0), ("slow", 0.5)):
        solution = ccm_opt.solve(replace(problem, planner=replace(problem.planner, effort_share=share)))
        found[name] = plan_of(solution)
    return found


def plan_of(solution: ccm_opt.Solution) -> VerifiedPlan:
    """The plan behind a solution."""
    return VerifiedPlan(solution.path, solution.trajectory, solution.joints, solution.checks, TermResults())


def with_gap(plan: VerifiedPlan, gap: float) -> VerifiedPlan:
    """The plan as if it kept another least gap [m]."""
    checks = (
        replace(check, worst=check.limit + gap) if "clearance" in check.name or "collision" in check.name else check
        for check in plan.checks
    )
    return replace(plan, checks=tuple(checks))


def asked(tries: int, seed: int = 0) -> Problem:
    """The problem of the plans, with several tries."""
    problem = open_scene(3).problem()
    return replace(problem, planner=replace(problem.planner, tries=tries, seed=seed, wanted_gap=0.02))


def answering(answers: dict[int, VerifiedPlan | BaseException]) -> Plans:
    """Gives each seed its answer."""

    def attempt(problem: Problem, _: UserTerms | None) -> VerifiedPlan:
        answer = answers[problem.planner.seed]
        if isinstance(answer, BaseException):
            raise answer
        return answer

    return attempt


def tried(problem: Problem, attempt: Plans) -> VerifiedPlan:
    """The best of the tries that a function makes."""
    return best_try(problem, None, attempt, partial(draft_solution, stages=Stages()))


def nothing(reason: str) -> MotionNotFound:
    """A search in vain."""
    return MotionNotFound(Diagnosis(reason, "motion"))


def test_the_shortest_roomy_try_is_taken(plans: dict[str, VerifiedPlan]) -> None:
    """A shorter motion with less room than the others is not taken; with as much it is, and all tries are told."""
    roomy = {0: with_gap(plans["slow"], 0.03), 1: nothing("none"), 2: with_gap(plans["fast"], 0.019)}
    best = tried(asked(3), answering(roomy))
    assert best.trajectory is plans["fast"].trajectory
    assert [each.seed for each in best.tries] == [0, 1, 2]
    assert [each.taken for each in best.tries] == [False, False, True]
    assert best.tries[1].reason == "none"
    assert best.tries[2].gap == pytest.approx(0.019)
    tight = {**roomy, 2: with_gap(plans["fast"], 0.001)}
    assert tried(asked(3), answering(tight)).trajectory is plans["slow"].trajectory


def test_tries_in_vain_say_what_the_first_said() -> None:
    """Without any plan the failure is that of the first try; a goal out of reach ends the tries at once."""
    failing = answering({7: nothing("first"), 8: nothing("second")})
    with pytest.raises(MotionNotFound, match="first"):
        tried(asked(2, seed=7), failing)
    with pytest.raises(UnreachableGoal):
        tried(
            asked(2),
            answering({0: UnreachableGoal(Diagnosis("far", "reach"))}),
        )


def test_tries_share_the_time(plans: dict[str, VerifiedPlan]) -> None:
    """Every try is given an equal share of the time that is left, and none is begun when it is over."""
    limits: list[float] = []

    def attempt(problem: Problem, _: UserTerms | None) -> VerifiedPlan:
        limits.append(problem.planner.time_limit)
        return plans["fast"]

    problem = asked(4)
    tried(problem, attempt)
    assert limits[0] == pytest.approx(problem.planner.time_limit / 4, rel=0.1)
    assert sum(limits) >= 0.9 * problem.planner.time_limit
    hurried = replace(problem, planner=replace(problem.planner, time_limit=1e-9))
    assert len(tried(hurried, attempt).tries) == 1


def test_a_cancelled_try_loses_no_plan(plans: dict[str, VerifiedPlan]) -> None:
    """On Ctrl-C the best plan so far is kept; before the first there is none to keep."""
    with pytest.raises(CancelledWithPlan) as kept:
        tried(asked(2), answering({0: plans["slow"], 1: KeyboardInterrupt()}))
    assert kept.value.solution.trajectory is plans["slow"].trajectory
    with pytest.raises(KeyboardInterrupt) as lost:
        tried(asked(2), answering({0: KeyboardInterrupt()}))
    assert not isinstance(lost.value, CancelledWithPlan)


@given(count=st.integers(0, 12), seed=st.integers(0, 50), put_off=st.floats(0.0, 1.0))
def test_every_candidate_has_its_turn(count: int, seed: int, put_off: float) -> None:
    """A seed changes the order alone, always in the same way; seed 0 leaves it."""
    candidates = [GuideCandidate(str(k), lambda: None) for k in range(count)]  # type: ignore[arg-type, return-value]
    drawn = [candidate.name for candidate in sampled_order(candidates, seed, put_off)]
    assert sorted(drawn, key=int) == [candidate.name for candidate in candidates]
    assert drawn == [candidate.name for candidate in sampled_order(candidates, seed, put_off)]
    if seed == 0:
        assert drawn == [candidate.name for candidate in candidates]


@pytest.mark.drawn(20, of="dear tests")
def test_a_seed_decides_the_plan() -> None:
    """The same seed gives the same motion to the last bit, and among a few seeds not all give the same."""
    scene = clutter(303)
    problem = scene.problem()

    def planned(seed: int) -> bytes:
        seeded = replace(problem, planner=replace(problem.planner, seed=seed))
        return ccm_opt.solve(seeded).path.spline.c.tobytes()

    first = planned(2)
    assert planned(2) == first
    assert planned(0) != first


def test_tries_stand_in_the_record(tmp_path: Path) -> None:
    """``planner.tries`` of a file is obeyed, and the record holds every try, one of them taken."""
    path = tmp_path / "small.toml"
    path.write_text(SMALL_PROBLEM + SEVERAL)
    ended = CliRunner().invoke(app, ["solve", str(path), "--out", str(tmp_path / "out"), "--no-pictures"])
    assert ended.exit_code == 0
    record = json.loads(next((tmp_path / "out").glob("*/solution.json")).read_text())
    assert [each["seed"] for each in record["tries"]] == [4, 5, 6]
    assert [each["taken"] for each in record["tries"]].count(True) == 1
    taken = next(each for each in record["tries"] if each["taken"])
    assert taken["duration"] == pytest.approx(record["metrics"]["duration_s"])
    assert record["problem"]["planner"]["tries"] == 3


def test_tries_of_a_planner_without_lots_are_refused() -> None:
    """The paper's planner draws nothing; the message names the key and its line. Tries below 1 are refused too."""
    with pytest.raises(ProblemFileError, match=r"line \d+: planner\.tries: \"hill-climbing\" samples nothing"):
        parse_problem(SMALL_PROBLEM + SEVERAL + 'method = "hill-climbing"\n')
    with pytest.raises(ProblemFileError, match=r"planner\.tries"):
        parse_problem(SMALL_PROBLEM + "[planner]\ntries = 0\n")


def test_the_least_gap_is_beyond_the_clearance(plans: dict[str, VerifiedPlan]) -> None:
    """What tries are compared by is what the verifier saw, the clearance taken off."""
    assert least_gap(with_gap(plans["fast"], 0.0125)) == pytest.approx(0.0125)
    assert np.isfinite(least_gap(plans["fast"]))
