"""Checks of arms in space, and of goals on the way, in words: as a user says them, and never as the verifier does."""

import numpy as np
import pytest

from ccm_opt.problem import Stop, TipGoal, Tolerances
from ccm_opt.problem.solution import Check
from ccm_opt.viz.checks_section import checks_in_words
from ccm_opt.viz.document import PageUnits

MINUS = "\N{MINUS SIGN}"
MILLIMETRES = PageUnits("mm", 1e-3, 2)


@pytest.mark.parametrize(
    ("check", "words"),
    [
        (
            Check("goal direction", 0.001, 0.0175, "rad", "last link at t = 1.0 s", passed=True),
            ("Direction error at the goal", "0.06°", "at most 1°", "last link"),
        ),
        (
            Check("stop 2 direction", 0.0, 0.0175, "rad", "last link at t = 1.0 s", passed=True),
            ("Direction error at goal 2", "0.00°", "at most 1°", "last link"),
        ),
        (
            Check("goal via 1", 0.0217, 0.03, "m", "tip at t = 3.2 s", passed=True),
            ("Tip distance from via 1", "21.7 mm", "at most 30 mm", "tip"),
        ),
        (
            Check("stop 1 via 2", 0.0217, 0.03, "m", "tip at t = 3.2 s", passed=True),
            ("Tip distance from via 2 of goal 1", "21.7 mm", "at most 30 mm", "tip"),
        ),
        (
            Check("joints inside the guide", 0.25, 1.0, "tolerances", "joint 1 at t = 0.0 s", passed=True),
            ("Bends inside the guide", "25.0 %", "at most 100 %", "joint 1"),
        ),
        (
            Check("goal position", 4e-8, 1e-9, "m", "tip at t = 1.0 s", passed=False),
            ("Tip error at the goal", "4e-05 mm", "at most 1e-06 mm", "tip"),
        ),
        (
            Check("feed velocity", 0.089, 0.1, "m/s", "t = 4.6 s", passed=True),
            ("Feed velocity", "89.0 mm/s", "at most 100 mm/s", ""),
        ),
        (
            Check("feed range", 0.0, 0.0, "m", "t = 0.0 s", passed=True),
            ("Feed nearest to its limit", "0.00 mm", "0 mm", ""),
        ),
        (
            Check("axis_1 range", -0.2, -0.4, "m", "t = 1.8 s", passed=True),
            ("Axis 1 nearest to its limit", f"{MINUS}200 mm", f"{MINUS}400 mm", ""),
        ),
        (
            Check("stop 2 axis_3", 1e-3, 0.0175, "rad", "base", passed=True),
            ("Axis 3 error at goal 2", "0.06°", "at most 1°", "base"),
        ),
        (
            Check("joint velocity", 0.4, 0.5, "rad/s", "joint 3 (ball03_yaw) at t = 0.5 s", passed=True),
            ("Joint velocities", "0.400 rad/s", "at most 0.5 rad/s", "joint 3 a"),
        ),
        (
            Check("joint torque", 4.0, 5.0, "N m", "joint 3 (ball03_bend) at t = 0.5 s", passed=True),
            ("Joint torques", "4.00 N m", "at most 5 N m", "joint 3 b"),
        ),
    ],
    ids=lambda value: value.name if isinstance(value, Check) else "",
)
def test_checks_in_space_are_in_words(check: Check, words: tuple[str, str, str, str]) -> None:
    """Title, worst value, limit and place; the two bends of a joint are a and b, as in a problem file."""
    (row,) = checks_in_words((check,), MILLIMETRES, in_space=True)
    assert (row.title, row.worst, row.limit, row.where) == words


def test_a_rest_must_be_no_shorter_than_asked_for() -> None:
    """It is the one limit that is a least value: no share of it is used, and nothing is left of where but the time."""
    check = Check("stop 1 pause", 1.2, 1.0, "s", "from t = 10.74 s", passed=True)
    (row,) = checks_in_words((check,), MILLIMETRES)
    assert (row.title, row.limit, row.used, row.where, row.time) == ("Rest at goal 1", "at least 1 s", None, "", 10.74)


def test_titles_name_goals() -> None:
    """A goal's name follows its number; the end of a tour is "the goal"."""
    stops = [Stop(TipGoal(np.zeros(2), name=name), Tolerances()) for name in ("valve", "", "weld")]
    names = ("stop 1 position", "stop 2 position", "goal position")
    rows = checks_in_words([Check(name, 0.0, 1.0, "m", "", passed=True) for name in names], MILLIMETRES, stops)
    titles = {"Tip error at goal 1 ('valve')", "Tip error at goal 2", "Tip error at the goal ('weld')"}
    assert {row.title for row in rows} == titles


def test_a_joint_in_the_plane_has_one_bend() -> None:
    """Its revolute's name says no more than its number."""
    check = Check("joint velocity", 0.4, 0.5, "rad/s", "joint 3 (ball03_bend) at t = 0.5 s", passed=True)
    (row,) = checks_in_words((check,), MILLIMETRES)
    assert row.where == "joint 3"
