"""User constraints and costs: what they may say, what is refused by name, and that they reach the command line."""

import json
import math
import threading
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import ccm_opt
from ccm_opt.cli.solving import solve_files
from ccm_opt.cli.written_plans import check_folders
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.errors import ProblemError
from ccm_opt.ik import compiled_terms as building
from ccm_opt.ik.compiled_terms import compile_terms
from ccm_opt.ik.quantities import Quantities
from ccm_opt.ik.terms import Constraint, Cost, Expression, Interval, load_terms
from ccm_opt.problem import Problem, TipGoal

from .conftest import PROBLEMS
from .scenes import make_arm, random_headings

OPEN_SPACE = PROBLEMS / "open-space.toml"
ARM = make_arm(8, base=np.array([0.3, -0.2]), base_heading=0.4)
SEEDS = st.integers(0, 2**32 - 1)


def value(expression: object, q: Quantities, headings: FloatArray) -> FloatArray:
    """An expression's value at link headings."""
    function = ca.Function("f", list(q.symbols), [ca.SX(expression)])
    return np.asarray(function(q.arm.bends(headings), 0.0, 0.5))


@settings(max_examples=15, deadline=None)
@given(SEEDS, st.floats(0.0, 1.0))
def test_quantities_are_those_of_the_arm(seed: int, share: float) -> None:
    """Angles, positions and points of the curve agree with the arm's own kinematics."""
    headings = random_headings(np.random.default_rng(seed), ARM)
    q, points = Quantities.from_arm(ARM), ARM.joint_positions(headings)
    np.testing.assert_allclose(value(q.joint_angles, q, headings)[:, 0], ARM.bends(headings), atol=1e-12)
    np.testing.assert_allclose(value(q.joint_positions, q, headings).T, points, atol=1e-12)
    np.testing.assert_allclose(value(q.tip, q, headings)[:, 0], points[-1], atol=1e-12)
    expected = shapely.LineString(points).interpolate(share, normalized=True)
    np.testing.assert_allclose(
        value(q.point_at(share * ARM.length), q, headings)[:, 0], (expected.x, expected.y), atol=1e-9
    )


@settings(max_examples=10, deadline=None)
@given(st.floats(-1.5, 1.5), st.floats(0.0, 1.0))
def test_an_arc_has_its_heading_and_curvature(bend: float, share: float) -> None:
    """Where every joint bends alike, curvature is bend over link length and the heading grows in proportion."""
    headings = ARM.headings(np.full(ARM.links, bend / ARM.links))
    q, s = Quantities.from_arm(ARM), share * ARM.length
    assert value(q.curvature_at(s), q, headings)[0, 0] == pytest.approx(bend / ARM.length, abs=1e-9)
    middle = np.clip(s, 0.5 * ARM.link_length, ARM.length - 0.5 * ARM.link_length)
    expected = headings[0] + bend / ARM.length * (middle - 0.5 * ARM.link_length)
    assert value(q.heading_at(s), q, headings)[0, 0] == pytest.approx(expected, abs=1e-9)


@settings(max_examples=10, deadline=None)
@given(SEEDS)
def test_membership_is_the_distance_to_the_sides(seed: int) -> None:
    """A point of a convex region has its distance to the outline as least margin; outside a margin is negative."""
    rng = np.random.default_rng(seed)
    region = shapely.MultiPoint(rng.uniform(-1.0, 1.0, (6, 2))).convex_hull
    q, headings = Quantities.from_arm(ARM), random_headings(rng, ARM)
    tip = shapely.Point(ARM.joint_positions(headings)[-1])
    least = value(q.inside(region), q, headings).min()
    if region.contains(tip):
        assert least == pytest.approx(region.exterior.distance(tip), abs=1e-9)
    else:
        assert least <= 1e-9


def foreign(q: Quantities) -> object:
    """An expression with a symbol of its own."""
    return q.tip[0] + ca.SX.sym("offset")


WRONG = [
    (Constraint("w", foreign, lower=0.0), "free symbol.*offset"),
    (Constraint("w", lambda q: q.tip, lower=[0.0, 0.0, 0.0]), "2 entries, but lower has 3"),
    (Constraint("w", lambda q: q.tip), "lower or an upper bound"),
    (Constraint("w", lambda q: q.tip[0], lower=1.0, upper=0.0), "lower bound exceeds"),
    (Constraint("w", lambda q: q.tip[0], lower=math.nan), "NaN"),
    (Constraint("w", lambda _: ca.MX.sym("x"), lower=0.0), "SX expression"),
    (Constraint("w", lambda _: "tip", lower=0.0), "SX expression"),
    (Constraint("w", lambda q: q.nothing, lower=0.0), "fails: AttributeError"),
    (Constraint("w", lambda q: 1.0 if q.tip[0] > 0.0 else 2.0, lower=0.0), "used as a number; .* ca.if_else for if"),
    (Constraint("w", lambda q: max(q.tip[0], q.tip[1]), lower=0.0), "used as a number; .* ca.fmax"),
    (Constraint("w", lambda q: math.sin(q.tip[0]) * q.tip[1], lower=0.0), "not a number; .* ca.sin for math.sin"),
    (Constraint("w", lambda q: q.point_at(9.0), lower=0.0), "arc length"),
    (Constraint("w", lambda _: ca.SX(0, 1), lower=0.0), "empty"),
    (Constraint("w", lambda q: q.inside(shapely.Polygon([(0, 0), (2, 0), (1, 0.1), (2, 2)])), lower=0.0), "convex"),
    (Cost("w", lambda q: q.tip), "expected a scalar"),
]


def leaves(_: object) -> None:
    """End the process."""
    raise SystemExit(0)


def interrupts(_: object) -> None:
    """Raise what Ctrl-C does."""
    raise KeyboardInterrupt


@pytest.mark.parametrize("function", [leaves, interrupts])
def test_a_term_that_would_end_the_process_is_refused_by_name(function: Expression) -> None:
    """Exits and interrupts that a user's function raises itself are defects of it like any other."""
    with pytest.raises(ProblemError, match=r"'w' fails: (SystemExit|KeyboardInterrupt)"):
        compile_terms(ARM, [Constraint("w", function, lower=0.0)], [])


def test_a_term_that_never_returns_is_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is given the stated time, and left behind."""
    monkeypatch.setattr(building, "TIME_TO_BUILD", 0.2)
    stop = threading.Event()
    with pytest.raises(ProblemError, match=r"'w' has not returned after 0\.2 s"):
        compile_terms(ARM, [Constraint("w", lambda _: stop.wait(), lower=0.0)], [])
    stop.set()


@pytest.mark.parametrize(("term", "message"), WRONG)
def test_what_makes_no_sense_is_refused_by_name(term: Constraint | Cost, message: str) -> None:
    """Every defect of an expression is told with the name of its constraint or cost."""
    constraints, costs = ([term], []) if isinstance(term, Constraint) else ([], [term])
    with pytest.raises(ProblemError, match=rf"'w'.*{message}"):
        compile_terms(ARM, constraints, costs)


def reaching_low() -> Problem:
    """The open space with a goal that the arm reaches with a low middle."""
    problem = ccm_opt.load_problem(OPEN_SPACE)
    return replace(problem, goal=TipGoal(np.array([0.8, 0.1])))


@pytest.mark.drawn(20, of="dear tests")
def test_a_bound_over_the_whole_motion_holds_at_every_sample() -> None:
    """The plan without the bound breaks it; the plan with it keeps it at all written samples, to 1e-6."""
    problem, middle, low = reaching_low(), slice(8, 17), 0.265
    assert ccm_opt.solve(problem).joint_positions[:, middle, 1].min() < low - 5e-3
    above = Constraint("high middle", lambda q: q.joint_positions[1, 8:17], lower=low)
    solution = ccm_opt.solve(problem, constraints=[above])
    assert solution.joint_positions[:, middle, 1].min() >= low - 1e-6
    check = next(check for check in solution.checks if check.name == "constraint high middle")
    assert check.passed
    assert check.worst <= check.limit == 1e-6
    assert solution.metrics["residual_high_middle"] == max(check.worst, 0.0)
    spare = solution.joint_positions[:, middle, 1].min() - low
    assert -check.worst == pytest.approx(spare, abs=1e-4)


def checks_of_own_terms(folder: Path, file: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Checked later, a constraint that is not given is named, and one that is given is held against the motion."""
    capfd.readouterr()
    assert check_folders([folder]) == 0
    assert "1 constraint was not checked: 'high middle'; give it with --constraint" in capfd.readouterr().err
    assert check_folders([folder], (f"{file}:high",)) == 0
    told = capfd.readouterr()
    assert "not checked" not in told.err
    assert "Your constraint “high" in told.out
    file.write_text(file.read_text().replace("lower=-0.1", "lower=0.5").replace("q.tip[0]", "q.path_parameter"))
    assert check_folders([folder], (f"{file}:high",)) == 3
    assert ": fails" in capfd.readouterr().out
    file.write_text("import ccm_opt\nlate = ccm_opt.Constraint('late', lambda q: q.path_parameter, lower=0.0)\n")
    assert check_folders([folder], (f"{file}:late",)) == 2
    assert "depends on q.path_parameter" in capfd.readouterr().err


def test_the_command_line_takes_own_terms(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """``--constraint`` and ``--cost`` reach the record of the output folder."""
    file = tmp_path / "mine.py"
    file.write_text(
        "import ccm_opt\n"
        "high = ccm_opt.Constraint('high middle', lambda q: q.joint_positions[1, 8:17], lower=-0.1)\n"
        "reach = ccm_opt.Cost('reach', lambda q: q.tip[0])\n"
    )
    out = tmp_path / "out"
    own = ((f"{file}:high",), (f"{file}:reach",))
    assert solve_files([OPEN_SPACE], out, terms=own, pictures=False) == 0
    record = json.loads((out / "open-space" / "solution.json").read_text())
    assert "constraint high middle" in [check["name"] for check in record["checks"]]
    assert record["metrics"]["cost_reach"] == pytest.approx(0.0, abs=1.0)
    checks_of_own_terms(out / "open-space", file, capfd)
    assert solve_files([OPEN_SPACE], out, terms=(("nowhere:x",), ()), pictures=False) == 2
    assert "nowhere:x" in capfd.readouterr().err


def test_constraints_at_the_start_are_checked_before_planning() -> None:
    """A start that breaks a constraint of the motion, or at which it is not finite, is refused by name."""
    problem = ccm_opt.load_problem(OPEN_SPACE)
    broken = Constraint("tip far left", lambda q: q.tip[0], upper=-5.0)
    with pytest.raises(ProblemError, match=r"'tip far left' contradicts the start: it is violated by 5\.\d+"):
        ccm_opt.solve(problem, constraints=[broken])
    endless = Constraint("endless", lambda q: 1.0 / (q.link_headings[0] - q.link_headings[0]), lower=0.0)
    with pytest.raises(ProblemError, match="'endless' is not finite at the start"):
        ccm_opt.solve(problem, constraints=[endless])


def test_decorators_name_terms_after_their_functions() -> None:
    """A decorated function is a constraint or cost with the function's name and the given bounds."""

    @ccm_opt.constraint(upper=1.0, where=Interval(0.0, 0.5))
    def tip_is_low(q: Quantities) -> object:
        return q.tip[1]

    @ccm_opt.cost(weight=2.0)
    def reach(q: Quantities) -> object:
        return q.tip[0]

    assert (tip_is_low.name, tip_is_low.upper, tip_is_low.where) == ("tip is low", 1.0, Interval(0.0, 0.5))
    assert (reach.name, reach.weight) == ("reach", 2.0)


def test_references_name_terms_in_files(tmp_path: Path) -> None:
    """``file.py:name`` loads a constraint, a list of them, and refuses what is none."""
    file = tmp_path / "mine.py"
    file.write_text(
        "import ccm_opt\n"
        "low = ccm_opt.Constraint('low', lambda q: q.tip[1], upper=1.0)\n"
        "both = [low, ccm_opt.Constraint('left', lambda q: q.tip[0], upper=1.0)]\n"
        "def bare(q):\n    return q.tip[0]\n"
    )
    assert [c.name for c in load_terms([f"{file}:low", f"{file}:both"], Constraint)] == ["low", "low", "left"]
    for reference, message in (
        (f"{file}:bare", "decorate"),
        (f"{file}:missing", "has no 'missing'"),
        ("nowhere", "module:function"),
        ("no.such.module:x", "loading .* fails: ModuleNotFoundError"),
        (f"{file}:low", "expected a Cost"),
    ):
        with pytest.raises(ProblemError, match=message):
            load_terms([reference], Cost if "Cost" in message else Constraint)
