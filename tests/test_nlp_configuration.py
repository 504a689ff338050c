"""The configuration NLP on open space and on hand-made corridors."""

import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from ccm_opt.core.errors import ConfigurationNotFound, ProblemError
from ccm_opt.ik import multiple_shooting as solver_module
from ccm_opt.ik.configuration_task import ConfigurationTask
from ccm_opt.ik.find_configuration import (
    attempts,
    find_configuration,
    heading_basis,
    initial_guess,
    polished_configuration,
    winding_profiles,
)
from ccm_opt.ik.infeasibility import FailedAttempt, broken_rows, shortfalls
from ccm_opt.ik.multiple_shooting import build_configuration_nlp, pack_variables, solve_nlp, unpack_variables
from ccm_opt.robot.configuration import Configuration
from ccm_opt.scene.corridor import Corridor
from tests.conftest import PROBLEMS
from tests.nlp_corridors import ANY_HEADING, box, corridor, open_task, random_pose, s_bend


def inside_somewhere(found: Configuration, way: Corridor, samples: int = 2_000) -> float:
    """Greatest distance by which a sampled point misses all regions of a corridor."""
    points = found.positions_at(np.linspace(0.0, found.length, samples))
    miss = [(points @ r.normals.T - r.offsets).max(axis=1) for r in way.regions]
    return float(np.min(miss, axis=0).max())


def s_bend_task(ratio: float, heading: float | None = 0.0) -> ConfigurationTask:
    """Reach the end of the S-bend with spare length."""
    way = s_bend()
    return ConfigurationTask(
        np.zeros(2), ANY_HEADING, ratio * way.route.length, 18.0, np.array([0.9, 0.5]), heading, way
    )


def test_reachable_poses_in_open_space_are_reached() -> None:
    """Twenty random poses are reached with tip, heading, length and curvature as asked (section 3)."""
    generator = np.random.default_rng(11)
    for _ in range(20):
        pose = random_pose(generator)
        task = open_task(pose)
        found = find_configuration(task)
        tip, heading = found.tip
        np.testing.assert_allclose(tip, pose.tip[0], atol=1e-5)
        assert np.remainder(heading - pose.tip[1] + 1.0, 2.0 * np.pi) == pytest.approx(1.0, abs=1e-6)
        assert found.base_heading == pytest.approx(pose.base_heading, abs=1e-12)
        assert found.length == pytest.approx(1.0, abs=1e-9)
        assert np.abs(found.curvature_at(np.linspace(0.0, found.length, 3_000))).max() <= task.curvature_limit


@pytest.mark.parametrize("ratio", [1.05, 1.2, 1.5])
def test_configuration_stays_in_its_corridor(ratio: float) -> None:
    """With spare length the curve is as long as the arm and stays inside the corridor on a dense sweep."""
    task = s_bend_task(ratio)
    found = find_configuration(task)
    assert found.length == pytest.approx(task.length, rel=1e-9)
    assert inside_somewhere(found, task.corridor) < 1e-6
    assert np.abs(found.curvature_at(np.linspace(0.0, found.length, 3_000))).max() <= task.curvature_limit


@pytest.mark.parametrize("ratio", [1.5, 2.0, 3.0])
def test_much_spare_length_finds_room(ratio: float) -> None:
    """In an open region the arm may be three times as long as the way."""
    goal = np.array([1.0 / ratio, 0.0])
    way = corridor((box(-1.0, -1.0, 1.0, 1.0),), [(0.0, 0.0), (1.0 / ratio, 0.0)])
    found = find_configuration(ConfigurationTask(np.zeros(2), ANY_HEADING, 1.0, 20.0, goal, 0.7, way))
    np.testing.assert_allclose(found.tip[0], goal, atol=1e-5)
    assert found.length == pytest.approx(1.0)


def test_free_goal_heading_bends_no_more_than_a_given_one() -> None:
    """Without a goal heading the tip is reached and the bending energy is not larger than with one."""

    def energy(found: Configuration) -> float:
        arc = np.linspace(0.0, found.length, 4_001)
        return float(np.trapezoid(found.curvature_at(arc) ** 2, arc))

    free, given = (find_configuration(s_bend_task(1.1, heading)) for heading in (None, 1.0))
    np.testing.assert_allclose(free.tip[0], [0.9, 0.5], atol=1e-5)
    assert energy(free) < energy(given)


def test_curvature_is_continuous_across_segments() -> None:
    """C_0 = κ_k: neighbouring segments share curvature and heading."""
    found = find_configuration(s_bend_task(1.1))
    for left, right in zip(found.segments[:-1], found.segments[1:], strict=True):
        assert left.curvature[-1] == right.curvature[0]
        assert left.end_heading == right.heading


def test_mount_may_stand_outside_its_region() -> None:
    """A base outside the first region starts with a straight stub of the mount's length, the rest stays inside."""
    way = corridor((box(0.01, -0.5, 1.2, 0.5),), [(0.0, 0.0), (0.8, 0.1)])
    task = ConfigurationTask(np.zeros(2), (0.0, 0.0), 1.0, 15.0, np.array([0.8, 0.1]), 0.0, way, mount_length=0.03)
    found = find_configuration(task)
    rest = found.positions_at(np.linspace(0.03, 1.0, 1_000))
    assert found.segments[0].length == pytest.approx(0.03)
    np.testing.assert_array_equal(found.segments[0].curvature, np.zeros(5))
    assert rest[:, 0].min() >= 0.01 - 1e-6
    np.testing.assert_allclose(found.tip[0], [0.8, 0.1], atol=1e-5)


@pytest.mark.parametrize("heading", [0.5, 1.5, None])
def test_goal_may_touch_the_wall(heading: float | None) -> None:
    """A goal on the very edge of its region is reached, and the curve stays inside."""
    way = corridor((box(-0.5, -0.5, 1.0, 0.3),), [(0.0, 0.0), (0.7, 0.3)])
    found = find_configuration(
        ConfigurationTask(np.zeros(2), ANY_HEADING, 1.0, 15.0, np.array([0.7, 0.3]), heading, way)
    )
    np.testing.assert_allclose(found.tip[0], [0.7, 0.3], atol=1e-5)
    assert inside_somewhere(found, way) <= 1e-6


def program_rows(task: ConfigurationTask) -> dict[int, set[str]]:
    """Names of the rows in the NLPs of all attempts, by segment; −1 stands for the rows of no segment."""
    names: dict[int, set[str]] = {}
    for regions, _, _ in attempts(task):
        for name in build_configuration_nlp(task, regions).program.row_names:
            names.setdefault(_segment_of(name), set()).add(name)
    return names


def _segment_of(name: str) -> int:
    prefix, found, _ = name.partition(":")
    return int(prefix.removeprefix("segment ")) if found and prefix.startswith("segment ") else -1


@pytest.mark.drawn(20, of="dear tests")
@pytest.mark.planning
def test_impossible_bend_names_the_row_in_the_way() -> None:
    """When no attempt succeeds the diagnosis names a row of the NLP, the solver's status and every attempt."""
    task = replace(s_bend_task(1.02, 1.5), curvature_limit=0.5)
    with pytest.raises(ConfigurationNotFound) as caught:
        find_configuration(task)
    evidence = caught.value.diagnosis.evidence
    worst = str(evidence["worst_row"])
    names = program_rows(task)
    assert worst in names[_segment_of(worst)]
    assert evidence["solver_status"]
    assert isinstance(evidence["violation"], float)
    assert evidence["violation"] > 0.0
    assert caught.value.diagnosis.advice
    rows = evidence["rows"]
    assert isinstance(rows, list)
    assert [row["violation"] for row in rows] == sorted((row["violation"] for row in rows), reverse=True)
    for row in rows:
        assert row["words"] in caught.value.diagnosis.reason
        assert 0.0 <= row["arc_length"] <= task.length * (1.0 + 1e-6)
        assert row["row"] in names[row["segment"]]


def test_a_row_of_no_segment_is_put_into_words() -> None:
    """An iterate that misses the base is said to; which rows IPOPT leaves open differs between processors."""
    task = s_bend_task(1.1)
    nlp = build_configuration_nlp(task)
    result = solve_nlp(nlp, initial_guess(nlp, winding_profiles(task)[0]))
    (broken,) = broken_rows(FailedAttempt(nlp, replace(result, broken={"base: y": 0.01})))
    assert (broken.constraint, broken.row, broken.segment) == ("length", "base: y", -1)
    assert broken.arc_length == pytest.approx(0.0, abs=1e-6)
    assert f"begins {10.0 * task.length:.3g} mm away from the base" in broken.words


def test_goal_beyond_the_arm_is_said_at_once() -> None:
    """A goal farther than the arm's length needs no solver; the message gives both figures."""
    way = corridor((box(-2.0, -2.0, 3.0, 2.0),), [(0.0, 0.0), (2.0, 0.0)])
    task = ConfigurationTask(np.zeros(2), ANY_HEADING, 1.0, 15.0, np.array([2.0, 0.0]), None, way)
    with pytest.raises(ConfigurationNotFound, match=r"2\.000 m from the base, but the arm is only 1\.000 m"):
        find_configuration(task)


def test_empty_heading_range_is_refused() -> None:
    """A range of base headings with its ends exchanged is a ProblemError."""
    with pytest.raises(ProblemError, match="must not be empty"):
        replace(s_bend_task(1.1), base_heading_range=(1.0, -1.0))


def test_every_row_has_a_name_and_bounds() -> None:
    """The NLP is data: names, bounds and expressions have one entry a row, and no name occurs twice in a block."""
    nlp = build_configuration_nlp(s_bend_task(1.1))
    program = nlp.program
    assert len(program.row_names) == program.constraints.numel() == len(program.bounds[0]) == len(program.bounds[1])
    assert len(nlp.lower) == len(nlp.upper) == program.variables.numel()
    assert len(nlp.parameters) == program.parameters.column.numel()
    assert nlp.regions == (0, 1, 2)


def test_programs_are_shared_by_tasks_of_one_size() -> None:
    """Two tasks with the same number of segments and half-planes use one program, which keeps its solver."""
    first, second = (build_configuration_nlp(s_bend_task(ratio)) for ratio in (1.1, 1.3))
    assert first.program is second.program


def test_pack_and_unpack_are_inverse() -> None:
    """States and controls survive the column of variables."""
    rng = np.random.default_rng(0)
    states, controls = rng.normal(size=(4, 5)), rng.normal(size=(3, 12))
    back = unpack_variables(pack_variables(states, controls))
    np.testing.assert_array_equal(back[0], states)
    np.testing.assert_array_equal(back[1], controls)


def test_own_costs_can_be_added() -> None:
    """A cost added to the NLP takes effect: the arm then starts with the curvature that it asks for."""
    task = s_bend_task(1.2)
    plain = build_configuration_nlp(task)
    nlp = plain.with_cost(1e6 * (plain.program.variables[3] - 1.5) ** 2)
    result = solve_nlp(nlp, initial_guess(nlp, winding_profiles(task)[0]))
    assert not result.broken
    assert result.variables[3] == pytest.approx(1.5, abs=1e-3)


def test_check_refuses_a_spoiled_configuration() -> None:
    """The dense check names every requirement that a bent copy of a good configuration misses."""
    task = s_bend_task(1.1)
    regions, profile, _ = next(attempts(task))
    nlp = build_configuration_nlp(task, regions, profile.tip_heading)
    good = polished_configuration(nlp, solve_nlp(nlp, initial_guess(nlp, profile)).variables)
    bent = Configuration.chain(
        good.base,
        good.base_heading + 0.1,
        [s.length for s in good.segments],
        [s.curvature * 4.0 for s in good.segments],
        [s.knots for s in good.segments],
    )
    names = {shortfall.name for shortfall in shortfalls(nlp, bent)}
    assert not shortfalls(nlp, good)
    assert {"tip position", "tip heading", "distance outside the corridor"} <= names


def test_heading_basis_reproduces_the_curve() -> None:
    """θ = θ_0 + rows @ values and its quadrature give the tip of the NumPy curve."""
    rng = np.random.default_rng(4)
    widths, values = rng.uniform(0.05, 0.15, (3, 4)), rng.normal(0.0, 5.0, 13)
    curve = Configuration.chain(
        np.zeros(2),
        0.2,
        widths.sum(axis=1).tolist(),
        [values[4 * k : 4 * k + 5] for k in range(3)],
        [tuple((np.cumsum(row)[:3] / row.sum()).tolist()) for row in widths],
    )
    rows, weights, last = heading_basis(widths)
    theta = 0.2 + rows @ values
    tip = [weights @ np.cos(theta), weights @ np.sin(theta)]
    np.testing.assert_allclose(tip, curve.tip[0], atol=1e-12)
    assert 0.2 + last @ values == pytest.approx(curve.tip[1], abs=1e-12)


@pytest.mark.parametrize(("name", "start", "goal"), [("base", -0.25, 0.9), ("goal", 0.0, 1.3)])
def test_end_outside_the_corridor_is_said_at_once(name: str, start: float, goal: float) -> None:
    """A base or goal outside its region needs no solver; the message says which and by how much."""
    task = s_bend_task(3.0)
    with pytest.raises(ConfigurationNotFound, match=f"the {name} is .* mm outside its region"):
        find_configuration(replace(task, base=np.array([start, 0.0]), goal=np.array([goal, 0.5])))


class InterruptedSolver:
    """Stands for an IPOPT that stops at once, as Ctrl-C makes it."""

    def __init__(self, status: str, *, signalled: bool) -> None:
        self.status, self.signalled = status, signalled

    def __call__(self, **arguments: object) -> dict[str, object]:
        """End at once."""
        if self.signalled:
            with suppress(KeyboardInterrupt):  # as CasADi does
                signal.raise_signal(signal.SIGINT)
        return {"x": arguments["x0"], "f": 0.0, "g": np.zeros(1), "lam_g": np.zeros(1)}

    def stats(self) -> dict[str, object]:
        """How it ended."""
        return {"return_status": self.status, "iter_count": 1}


@pytest.mark.parametrize(("status", "signalled"), [("User_Requested_Stop", False), ("NonIpopt_Exception_Thrown", True)])
def test_ctrl_c_stops_the_search(monkeypatch: pytest.MonkeyPatch, status: str, *, signalled: bool) -> None:
    """An interrupt that CasADi swallows is raised after all, and the handler of Ctrl-C is put back."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a background shell starts us with it ignored
    monkeypatch.setattr(solver_module, "built_solver", lambda *_, **__: InterruptedSolver(status, signalled=signalled))
    try:
        with pytest.raises(KeyboardInterrupt):
            find_configuration(s_bend_task(1.1))
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


THREADS = """
import sys
from concurrent.futures import ThreadPoolExecutor
import ccm_opt
problem = ccm_opt.load_problem(sys.argv[1])
with ThreadPoolExecutor(2) as threads:
    first, second = threads.map(ccm_opt.solve, [problem, problem])
assert (first.joints.angles == second.joints.angles).all()
assert (first.trajectory.time == second.trajectory.time).all()
print("equal")
"""


@pytest.mark.drawn(6, of="processes")
def test_two_threads_may_solve_at_once() -> None:
    """Two solves in two threads of one process end with the same plan; IPOPT by itself would crash."""
    command = [sys.executable, "-c", THREADS, str(PROBLEMS / "open-space.toml")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "equal\n"), done.stderr
