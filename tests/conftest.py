"""Hooks of pytest, and problems and an artificial plan that several tests share."""

import os
import uuid
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck
from hypothesis import settings as hypothesis_settings
from scipy.interpolate import make_interp_spline

from ccm_opt.io.reading import parse_problem
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import Check, JointPath, JointStates, JointTrajectory, SimulatedMotion, Solution
from ccm_opt.robot.configuration import Configuration
from ccm_opt.robot.frames import joint_names, revolute_angles

from .drawn_cases import left_out_cases
from .planning_marker import plans

hypothesis_settings.register_profile(
    "random",
    derandomize=False,
    deadline=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow],
)
hypothesis_settings.load_profile("random")
"""Examples are random everywhere, also where the variable CI is set, for which Hypothesis would always use equal ones.
No test may fail because a machine is slow. A failing test prints a line that repeats it; so does the seed in the header
of the report."""

LONGEST = """
    docs_blocks hill_climbing_planner promises space_diagnosis space_reach retiming real_jobs followable_ways
    surroundings live_plan space_search pareto pipeline space_pose space_proofs surface_tree pinned_figures
    user_terms_in_space find_pose cli import_cost schemas user_terms_costs verification space_folder determinism
""".split()  # noqa: SIM905 - legible
"""Names of the slowest test files, slowest first; they are run first, so that none is left for the end."""

PROBLEMS = Path(__file__).parent.parent / "problems"

SMALL_PROBLEM = """\
schema = 1
name = "small"

[workspace]
bounds = [-1.0, -1.0, 1.0, 1.0]

[[workspace.obstacles]]
name = "post"
circle = { center = [0.0, 0.3], radius = 0.1 }

[arm]
links = 4
link_length = 0.1
radius = 0.02
base = [0.0, 0.0]
joint_limit_deg = 60.0

[limits]
velocity = 2.0
acceleration = 10.0

[start]
shape = "straight"

[goal]
position = [0.3, 0.1]
"""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option with which no case is left out."""
    parser.addoption("--all-cases", action="store_true", help="run all cases of the tests that are marked drawn")


def pytest_report_header(config: pytest.Config) -> str:
    """Return a line for the report's header that says how to repeat the random examples."""
    seed = config.getoption("--hypothesis-seed")
    if seed is None:
        return "examples: drawn at random; a failing test prints the line that repeats it"
    return f"examples: drawn with seed {seed}; repeat: python -m pytest --hypothesis-seed={seed}"


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """Return the number of test processes, one more than cores, since tests also wait for processes and clocks."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return cores if config.option.markexpr == "not planning" else cores + 1


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Draw cases, run the slowest files first, mark tests that plan, and draw fewer random examples.

    Of files that are named all cases are run. In a run of all files each property gets a third of its examples, and
    with ``-m "not planning"``, which takes about a minute, a quarter.
    """
    whole = not (config.option.all_cases or any(".py" in given for given in config.args))
    divisor = 4 if config.option.markexpr == "not planning" else 3 if whole else 1
    if whole:
        left_out = left_out_cases(items, _seed_of_cases(config))
        config.hook.pytest_deselected(items=list(left_out))
        items[:] = [item for item in items if item not in left_out]
    places = {f"test_{name}": place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path.stem, len(places)))
    for item in items:
        if config.option.markexpr and plans(item):
            item.add_marker(pytest.mark.planning)
    for law in {getattr(item, "function", None) for item in items}:
        own = getattr(law, "_hypothesis_internal_use_settings", None)
        if own is not None and divisor > 1:
            fewer = hypothesis_settings(own, max_examples=min(own.max_examples, max(own.max_examples // divisor, 3)))
            law._hypothesis_internal_use_settings = fewer  # type: ignore[union-attr]


def _seed_of_cases(config: pytest.Config) -> str:
    """Return the seed of the run, or else what all processes of this run have in common and no other run has."""
    worker: dict[str, str] = getattr(config, "workerinput", {})
    return str(config.getoption("--hypothesis-seed") or worker.get("testrunuid") or uuid.uuid4())


@pytest.fixture
def small_text() -> str:
    """Text of a valid problem file with a planar arm of four links and one obstacle."""
    return SMALL_PROBLEM


@pytest.fixture
def small_problem() -> Problem:
    """Problem with a planar arm of four links and one obstacle."""
    return parse_problem(SMALL_PROBLEM, "small.toml")


@pytest.fixture
def small_solution(small_problem: Problem) -> Solution:
    """Solution of the small problem with an artificial motion that bends every joint smoothly."""
    return make_solution(small_problem, np.full(small_problem.arm.links, 0.3))


def make_solution(problem: Problem, end: np.ndarray) -> Solution:
    """Return an artificial solution that moves from zero to given bend angles in one second by a quintic polynomial.

    Args:
        problem: the problem.
        end: final bend angles, shape (links,) [rad].
    """
    arm = problem.arm
    time = np.linspace(0.0, 1.0, 251)
    blend = [p(time)[:, None] for p in _smooth_step()]
    trajectory = JointTrajectory(time, blend[0] * end, blend[1] * end, blend[2] * end)
    states = [
        revolute_angles(arm, x)
        for x in (trajectory.bend_angles, trajectory.bend_velocities, trajectory.bend_accelerations)
    ]
    torques = np.zeros_like(states[0])
    keyframes = trajectory.bend_angles[::125]
    curve = Configuration.chain(arm.base, arm.base_heading, [arm.length / 2] * 2, [np.zeros(5)] * 2)
    spline = make_interp_spline(np.linspace(0.0, 1.0, 5), trajectory.bend_angles[::62][:5], k=3)
    return Solution(
        problem=problem,
        path=JointPath(spline, keyframes, (curve,) * len(keyframes), "made up"),
        trajectory=trajectory,
        joints=JointStates(joint_names(arm), states[0], states[1], states[2], torques),
        simulation=SimulatedMotion(states[0], torques, 1e-4, saturated=False),
        checks=(
            Check("goal position", 2e-7, 1e-3, "m", "tip, t = 1.000 s", passed=True),
            Check("wall clearance", float("inf"), 0.0, "m", "link 3, post", passed=True),
        ),
        metrics={"duration": 1.0, "tip_error": float("nan")},
        timings={"motion": 0.1, "retiming": 0.02},
        versions={"ccm_opt": "0.1.0"},
    )


def _smooth_step() -> list[Callable[[np.ndarray], np.ndarray]]:
    """Return the polynomial 10 t³ − 15 t⁴ + 6 t⁵ and its first two derivatives."""
    step = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    return [step, step.deriv(), step.deriv(2)]
