"""``ccm-opt simulate``: run a written plan through the closed loop again, with other settings and disturbances."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ccm_opt.cli.outcome import code_of_simulation, print_result, run_all
from ccm_opt.cli.tables import peak_torque, report_console, units_of, value_table, verdict_cells
from ccm_opt.core.files import put_file
from ccm_opt.errors import ProblemError
from ccm_opt.io.reading_back import SavedMotion, load_any_problem, load_motion
from ccm_opt.problem.space_problem import AnyProblem, SpaceProblem
from ccm_opt.solution import SimulatedMotion

PICTURE = "simulation.png"
"""Name of the picture in the folder."""


@dataclass(frozen=True)
class Overrides:
    """Settings given on the command line; None leaves what the plan was made with.

    Attributes:
        options: of ``SimulationOptions`` by name.
        disturbances: of ``Disturbances`` by name.
    """

    options: Mapping[str, Any]
    disturbances: Mapping[str, Any]

    def applied(self, problem: AnyProblem) -> AnyProblem:
        """The problem with these settings.

        Raises:
            ProblemError: naming the setting that is impossible.
        """
        given = {name: value for name, value in self.options.items() if value is not None}
        changed = {name: value for name, value in self.disturbances.items() if value is not None}
        for name, value in changed.items():
            least = -1.0 if name == "mass_error" else 0.0  # an error of -1 is an arm without mass
            if value < least:
                raise ProblemError(f"--{name.replace('_', '-')} must be at least {least:g}, got {value:g}")
        disturbances = replace(problem.simulation.disturbances, **changed)
        return replace(problem, simulation=replace(problem.simulation, **given, disturbances=disturbances))


def simulate_folders(folders: Sequence[Path], overrides: Overrides, *, pictures: bool) -> int:
    """Simulate every folder; all are tried.

    Args:
        folders: output folders of ``ccm-opt solve``.
        overrides: settings other than the recorded ones.
        pictures: whether to draw ``simulation.png`` into the folder.

    Returns:
        The exit code: 4 when the simulated arm does not follow a plan.
    """
    return run_all(folders, lambda folder: _simulate(folder, overrides, pictures=pictures))


def _simulate(folder: Path, overrides: Overrides, *, pictures: bool) -> int:
    recorded = load_any_problem(folder)
    problem = overrides.applied(recorded)
    motion = load_motion(folder, recorded.arm)
    from ccm_opt.driver.closed_loop import simulate_and_check  # noqa: PLC0415 - loads casadi
    from ccm_opt.dynamics.simulation.simulation_checks import check_options  # noqa: PLC0415 - likewise

    # What was recorded was checked before the plan was made; what the command line says is checked here.
    check_options(problem.arm, problem.simulation)
    simulated, figures = simulate_and_check(problem, motion.trajectory, motion.joints)
    if pictures:
        _draw(folder, problem, motion, simulated)
    code = code_of_simulation(problem.name, simulated.verdict)
    return print_result(
        lambda: _print(problem, motion, simulated, figures), code, lambda: _data(problem, simulated, figures)
    )


def _data(problem: AnyProblem, simulated: SimulatedMotion, figures: Mapping[str, float]) -> dict[str, object]:
    """What the simulated arm did, for programs."""
    return {
        "name": problem.name,
        "status": simulated.verdict.outcome,
        "simulation": asdict(simulated.verdict),
        "metrics": dict(figures),
    }


def _draw(folder: Path, problem: AnyProblem, motion: SavedMotion, simulated: SimulatedMotion) -> None:
    from ccm_opt.viz import simulated_motion  # noqa: PLC0415 - loads matplotlib

    if isinstance(problem, SpaceProblem):
        picture = simulated_motion.space_simulation_png(problem, motion.trajectory, motion.joints, simulated)
    else:
        picture = simulated_motion.simulation_png(problem, motion.trajectory, motion.joints, simulated)
    try:
        put_file(folder / PICTURE, picture)
    except OSError as error:
        raise ProblemError(f"cannot write {folder / PICTURE}: {error.strerror or error}") from error


def _print(problem: AnyProblem, motion: SavedMotion, simulated: SimulatedMotion, figures: Mapping[str, float]) -> None:
    units = units_of(problem)
    table = value_table(f"{problem.name}: simulated")
    table.add_row("controller", problem.simulation.controller, "", f"step {problem.simulation.step:g} s")
    if problem.simulation.controller == "pd":
        table.add_row("gains", *_words_of_gains(problem))
    for name, value in _disturbed(problem).items():
        table.add_row(name.replace("_", " "), f"{value:.4g}", "", "unknown to the controller")
    for name, value in figures.items():
        words, _, unit = name.rpartition("_")
        limit = f"≥ {units.given(problem.workspace.clearance, 'm')}" if "wall" in name else ""
        table.add_row(words.replace("_", " "), units.shown(value, unit), limit, "")
    in_space = isinstance(problem, SpaceProblem)
    peak, bound, _, where = peak_torque(
        simulated.torques, problem.limits.torque, motion.joints.names, in_space=in_space
    )
    table.add_row("peak torque", peak, bound, where)
    outcome, _, _, reason = verdict_cells(simulated.verdict)
    table.add_row("simulation", outcome, "", reason)
    report_console().print(table)


def _words_of_gains(problem: AnyProblem) -> tuple[str, str, str]:
    """Gains of the joints' PD law: value, nothing where a limit would stand, and where they come from."""
    from ccm_opt.dynamics.simulation.controller import gains  # noqa: PLC0415 - loads casadi

    options = problem.simulation
    stiffness = gains(problem.arm, options).proportional
    given = options.proportional_gain is not None or options.derivative_gain is not None
    least = f"{stiffness.min():.4g}"
    most = f"{stiffness.max():.4g}"
    value = f"{most} N m/rad" if least == most else f"{least} to {most} N m/rad"
    return value, "", "as given" if given else f"suit the arm at {options.bandwidth:g} 1/s"


def _disturbed(problem: AnyProblem) -> dict[str, float]:
    values = vars(problem.simulation.disturbances)
    return {name: float(value) for name, value in values.items() if value and name != "seed"}
