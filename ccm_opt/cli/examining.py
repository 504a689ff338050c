"""The commands ``describe``, ``simulate`` and ``tolerance``: data of an arm, simulation of a plan, tolerated errors."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from ccm_opt.cli.loading import report_scene
from ccm_opt.cli.outcome import SOLVED, print_result, run_all, simulation_exit_code
from ccm_opt.cli.output import output
from ccm_opt.cli.tables import columned_table, peak_torque, report_console, result_units, value_table, verdict_cells
from ccm_opt.core.arrays import FloatArray, IntArray
from ccm_opt.core.errors import ProblemError, VerificationError
from ccm_opt.core.files import put_file_or_refuse
from ccm_opt.core.length_words import in_unit, span_words
from ccm_opt.driver.verified_plan import failed_checks
from ccm_opt.io.folder import TOLERANCE_FILES
from ccm_opt.io.problem_data import problem_data
from ccm_opt.io.reading import load_problem
from ccm_opt.io.reading_back import SavedMotion, load_any_problem, load_motion
from ccm_opt.io.records import tolerance_data, tolerance_json
from ccm_opt.problem import Problem
from ccm_opt.problem.solution import SimulatedMotion, ToleratedError
from ccm_opt.robot.arc_sections import ArcSections
from ccm_opt.robot.arm import Arm
from ccm_opt.robot.frames import dh_table, joint_names
from ccm_opt.robot.tool import RigidBody
from ccm_opt.verification.verifier import verify
from ccm_opt.viz.clearance_section import tolerated_error_words

_DRIVE = ("velocity [rad/s]", "acceleration [rad/s²]", "torque [N m]", "rotor [kg m²]", "friction [N m s/rad]")
"""Column headings of the drive of a revolute joint."""


def describe_files(files: Sequence[Path], changes: Sequence[str] = ()) -> int:
    """Print the arm of every problem file and return the exit code; after a failure the other files are still tried.

    Args:
        files: problem files.
        changes: overrides of keys of the problem files, each ``key.path=value``.

    Returns:
        The exit code, see ``outcome``.
    """

    def describe(file: Path) -> int:
        return _describe(load_problem(file, changes=changes, allow_outside=output().allow_outside))

    return run_all(files, describe)


def _describe(problem: Problem) -> int:
    report_scene(problem)

    def show() -> None:
        console = report_console()
        for line in arm_lines(problem):
            console.print(line, markup=False)
        if problem.arm.sections is not None:
            console.print(section_table(problem, problem.arm.sections))
            return
        console.print(parameter_table(problem))
        console.print(link_table(problem.arm))

    return print_result(show, SOLVED, lambda: _data(problem))


def _data(problem: Problem) -> dict[str, object]:
    """Return arm and limits in the layout of a problem file, and link parameters, for JSON output.

    Lengths are in metres. Link parameters are Denavit–Hartenberg parameters with angles in radians; sections that bend
    evenly have none.
    """
    whole = problem_data(replace(problem, length_unit="m"))
    told = {"status": "described", "name": problem.name, "arm": whole["arm"], "limits": whole["limits"]}
    if problem.arm.sections is not None:
        return told
    rows = zip(joint_names(problem.arm), dh_table(problem.arm), strict=True)
    return told | {"link_parameters": [{"joint": name, **row._asdict()} for name, row in rows]}


def arm_lines(problem: Problem) -> list[str]:
    """Return a few lines of text about a problem: links, base, masses, gravity, base axes, and several goals."""
    arm = problem.arm
    gravity = problem.simulation.gravity
    unit = problem.length_unit

    def number(length: float) -> str:
        return f"{in_unit(length, unit):.9g}"

    def words(length: float) -> str:
        return f"{number(length)} {unit}"

    base = f"({', '.join(number(value) for value in arm.base)}) {unit}, {_pointing(problem)}"
    if arm.sections is None:
        each, radii = span_words(arm.lengths, words), arm.radii
        layout = f"{arm.links} links of {each}, {3 * arm.links} revolutes, axes {arm.axes}"
    else:
        each, radii = span_words(arm.sections.lengths, words), arm.sections.radii
        layout = f"{len(arm.sections.counts)} sections of {each} that bend evenly, in {sum(arm.sections.counts)} arcs"
    lines = [
        f"{problem.name}: {layout}",
        f"base at {base}; radius {span_words(radii, words)}, length {words(arm.length)}",
        f"mass {np.sum(arm.masses):.6g} kg, payload {arm.payload:g} kg; gravity {gravity.tolist()} m/s²",
    ]
    along = "the base's direction" if problem.dimension == 3 else "the base heading"
    lines += [
        f"feed axis from {number(axis.low)} to {words(axis.high)} along {along}, guide tube ends at {words(axis.hole)}"
        for axis in (() if arm.feed is None else (arm.feed,))
    ]
    lines += [
        f"base axis {axis_name} {'revolute' if axis.revolute else 'prismatic'}, from {axis.low:.9g} to {axis.high:.9g} "
        f"{axis.unit}, direction {_components(axis.direction)}"
        for axis_name, axis in zip(arm.coordinates.base_names, arm.carrier, strict=bool(arm.carrier))
    ]
    lines += [f"body on link {body.link % arm.links + 1}: {_weight_and_size(body)}" for body in arm.bodies]
    if arm.tool is not None:
        tip = f"({', '.join(number(value) for value in arm.tool.tip)}) {unit}"
        pointing = _components(arm.tool.direction)
        lines.append(f"tool: {_weight_and_size(arm.tool)}, tip at {tip} in the frame of the end, direction {pointing}")
    if problem.stops:
        planner = problem.planner
        ends = {"free": "", "last": ", the last one at the end", "start": ", and back to the start"}[planner.end]
        lines.append(f"{len(problem.goals)} goals in {planner.order} order{ends}")
    return lines


def _weight_and_size(body: RigidBody) -> str:
    """Return the mass of a body on a link and the number of capsules that cover it, in words."""
    return f"{body.mass:g} kg, covered by {len(body.bodies)} capsule{'s' if len(body.bodies) != 1 else ''}"


def _pointing(problem: Problem) -> str:
    """Return the orientation of the arm's base in words."""
    if problem.dimension == 3:
        return f"direction {_components(problem.arm.direction)}, up {_components(problem.arm.up)}"
    return f"heading {np.rad2deg(problem.arm.base_heading):.6g} deg"


def _components(vector: FloatArray) -> str:
    # Adding 0.0 turns a negative zero into a zero.
    return f"({', '.join(f'{value + 0.0:.6g}' for value in vector.round(12))})"


def parameter_table(problem: Problem) -> Table:
    """Return a table of the standard Denavit–Hartenberg parameters and the drive of every revolute joint.

    The transform from one frame to the next is A = Rz(θ + offset) Tz(d) Tx(a) Rx(α).
    """
    arm = problem.arm
    limits = problem.limits
    unit = problem.length_unit
    columns = ("joint", "offset [deg]", f"d [{unit}]", f"a [{unit}]", "alpha [deg]", *_DRIVE)
    table = columned_table("link parameters", columns)
    rotors = np.broadcast_to(arm.rotor_inertia, (3 * arm.links,))
    friction = np.broadcast_to(arm.friction, (3 * arm.links,))
    torque = ["none"] * (3 * arm.links) if limits.torque is None else [f"{value:g}" for value in limits.torque]
    for j, (name, row) in enumerate(zip(joint_names(arm), dh_table(arm), strict=True)):
        offset = f"{np.rad2deg(row.offset):g}"
        lengths = (f"{in_unit(length, unit):.9g}" for length in (row.d, row.a))
        geometry = (offset, *lengths, f"{np.rad2deg(row.alpha):g}")
        drive = (f"{limits.velocity[j]:g}", f"{limits.acceleration[j]:g}", torque[j])
        table.add_row(name, *geometry, *drive, f"{rotors[j]:g}", f"{friction[j]:g}")
    return table


def section_table(problem: Problem, sections: ArcSections) -> Table:
    """Return a table of the sections that bend evenly: their shape, their tendons, and the drives of their bends.

    Limits, inertia and friction are those of the bends of whole sections.
    """
    arm, limits, unit = problem.arm, problem.limits, problem.length_unit
    shape = ("section", f"length [{unit}]", f"radius [{unit}]", "arcs", "tendons", "bend limit [deg]")
    table = columned_table("sections", (*shape, *_DRIVE))

    def words(length: float) -> str:
        return f"{in_unit(length, unit):.9g}"

    def of_sections(values: FloatArray | float, factors: FloatArray | IntArray | int = 1) -> list[str]:
        """Return the values of the bends of each section: those of its joints times a factor."""
        of_joints = sections.of_drives(np.broadcast_to(values, (3 * arm.links,))).reshape(len(sections.counts), -1)
        whole = of_joints * np.reshape(factors, (-1, 1))
        return [", ".join(dict.fromkeys(f"{value:g}" for value in pair)) for pair in whole]

    torques = ["none"] * len(sections.counts) if limits.torque is None else of_sections(limits.torque)
    rates = (of_sections(each, sections.counts) for each in (limits.velocity, limits.acceleration))
    passive = (of_sections(each, 1.0 / sections.counts) for each in (arm.rotor_inertia, arm.friction))
    drives = zip(*rates, torques, *passive, strict=True)
    tendons = sections.tendons or (None,) * len(sections.counts)
    for k, (given, drive) in enumerate(zip(tendons, drives, strict=True)):
        table.add_row(
            f"section {k + 1}",
            words(sections.lengths[k]),
            ", ".join(dict.fromkeys(words(radius) for radius in sections.radii[k])),
            f"{sections.counts[k]}",
            "none" if given is None else f"{given.number} at {words(given.radius)} {unit}",
            f"{np.rad2deg(sections.limits[k]):.6g}",
            *drive,
        )
    return table


def link_table(arm: Arm) -> Table:
    """Return a table of mass, moments of inertia and joint limit of every link, without massless frames."""
    table = columned_table("links", ("link", "mass [kg]", "axial [kg m²]", "transverse [kg m²]", "bend limit [deg]"))
    limits = np.rad2deg(arm.bend_limits.reshape(arm.links, -1))
    for k in range(arm.links):
        inertia = (f"{arm.inertia_axial[k]:.6g}", f"{arm.inertia_transverse[k]:.6g}")
        table.add_row(
            f"link{k + 1:02d}",
            f"{arm.masses[k]:g}",
            *inertia,
            ", ".join(dict.fromkeys(f"{limit:.6g}" for limit in limits[k])),
        )
    return table


PICTURE = "simulation.png"
"""File name of the picture of a simulation in the plan's folder."""


def simulate_folders(
    folders: Sequence[Path], options: Mapping[str, Any], disturbances: Mapping[str, Any], *, pictures: bool
) -> int:
    """Simulate the plan in every output folder and return the exit code; after a failure the others are still tried.

    Args:
        folders: output folders of ``ccm-opt solve``.
        options: values of ``SimulationOptions`` by name; None keeps the value of the problem.
        disturbances: values of ``Disturbances`` by name; None keeps the value of the problem.
        pictures: whether to draw ``simulation.png`` into the folder.

    Returns:
        The exit code: 4 if the simulated arm does not follow a plan.
    """
    return run_all(folders, lambda folder: _simulate(folder, options, disturbances, pictures=pictures))


def _with_settings(problem: Problem, options: Mapping[str, Any], disturbances: Mapping[str, Any]) -> Problem:
    """Return a problem with other simulation settings; None keeps the value of the problem.

    Raises:
        ProblemError: a setting is invalid; the message names the setting.
    """
    given, changed = ({k: v for k, v in each.items() if v is not None} for each in (options, disturbances))
    for name, value in changed.items():
        least = -1.0 if name == "mass_error" else 0.0  # a mass error of -1 leaves an arm without mass
        if value < least:
            raise ProblemError(f"--{name.replace('_', '-')} must be at least {least:g}, got {value:g}")
    changed_disturbances = replace(problem.simulation.disturbances, **changed)
    return replace(problem, simulation=replace(problem.simulation, **given, disturbances=changed_disturbances))


def _simulate(folder: Path, options: Mapping[str, Any], disturbances: Mapping[str, Any], *, pictures: bool) -> int:
    recorded = load_any_problem(folder)
    problem = _with_settings(recorded, options, disturbances)
    motion = load_motion(folder, recorded.arm)
    from ccm_opt.driver.closed_loop import simulate_and_check  # noqa: PLC0415 - loads casadi
    from ccm_opt.dynamics.simulation.simulation_record import check_options  # noqa: PLC0415 - likewise

    # Recorded options were checked before planning; those of the command line are checked here.
    check_options(problem.arm, problem.simulation)
    simulated, figures = simulate_and_check(problem, motion.trajectory, motion.joints)
    if pictures and simulated.verdict.is_run:
        from ccm_opt.viz.simulated_motion import simulation_png  # noqa: PLC0415 - loads matplotlib

        picture = simulation_png(problem, motion.trajectory, motion.joints, simulated)
        put_file_or_refuse(folder / PICTURE, picture)
    code = simulation_exit_code(problem.name, simulated.verdict)
    return print_result(
        lambda: _print(problem, motion, simulated, figures),
        code,
        lambda: {
            "name": problem.name,
            "status": simulated.verdict.outcome,
            "simulation": asdict(simulated.verdict),
            "metrics": dict(figures),
        },
    )


def _print(problem: Problem, motion: SavedMotion, simulated: SimulatedMotion, figures: Mapping[str, float]) -> None:
    units = result_units(problem)
    table = value_table(f"{problem.name}: simulation")
    table.add_row("controller", problem.simulation.controller, "", f"step {problem.simulation.step:g} s")
    if problem.simulation.controller == "pd":
        table.add_row("gains", *_describe_gains(problem))
    for name, value in vars(problem.simulation.disturbances).items():
        if value and name != "seed":
            table.add_row(name.replace("_", " "), f"{float(value):.4g}", "", "unknown to the controller")
    for name, value in figures.items():
        words, _, unit = name.rpartition("_")
        limit = f"≥ {units.given(problem.workspace.clearance, 'm')}" if "wall" in name else ""
        table.add_row(words.replace("_", " "), units.shown(value, unit), limit, "")
    if simulated.verdict.is_run:
        peak, bound, _, where = peak_torque(problem, simulated.torques, motion.joints.names)
        table.add_row("peak torque", peak, bound, where)
    outcome, _, _, reason = verdict_cells(simulated.verdict)
    table.add_row("simulation", outcome, "", reason)
    report_console().print(table)


def _describe_gains(problem: Problem) -> tuple[str, str, str]:
    """Return table cells for the gains of the PD controller: value, empty limit, and whether given or tuned."""
    from ccm_opt.dynamics.simulation.controller import gains  # noqa: PLC0415 - loads casadi

    options = problem.simulation
    stiffness = gains(problem.arm, options)[0]
    given = options.proportional_gain is not None or options.derivative_gain is not None
    least = f"{stiffness.min():.4g}"
    most = f"{stiffness.max():.4g}"
    value = f"{most} N m/rad" if least == most else f"{least} to {most} N m/rad"
    return value, "", "as given" if given else f"tuned for {options.bandwidth:g} 1/s"


def examine_tolerance(folders: Sequence[Path], *, simulated: bool, pictures: bool) -> int:
    """Compute the errors that the plan in every output folder tolerates, and return the exit code.

    Args:
        folders: output folders of ``ccm-opt solve``.
        simulated: whether maximum payload and friction are computed too, by simulation.
        pictures: whether to draw ``tolerance.png`` into the folder.

    Returns:
        The exit code: 3 if a folder holds no plan that passes every check.
    """
    return run_all(folders, lambda folder: _look_at(folder, simulated=simulated, pictures=pictures))


def _look_at(folder: Path, *, simulated: bool, pictures: bool) -> int:
    problem = load_any_problem(folder)
    motion = load_motion(folder, problem.arm)
    # The certificate assumes that the plan itself touches nothing.
    if failures := failed_checks(verify(problem, motion.trajectory, motion.joints)):
        raise VerificationError(failures)
    from ccm_opt.driver.robustness import motion_tolerance  # noqa: PLC0415 - loads casadi

    errors = motion_tolerance(problem, motion.trajectory, motion.joints, simulated=simulated)
    record, picture = TOLERANCE_FILES
    put_file_or_refuse(folder / record, tolerance_json(problem.name, errors).encode())
    if pictures:
        from ccm_opt.viz.simulated_motion import tolerance_png  # noqa: PLC0415 - loads matplotlib

        put_file_or_refuse(folder / picture, tolerance_png(problem, motion.trajectory, errors[0]))
    return print_result(
        lambda: report_console().print(tolerance_table(problem, errors)),
        SOLVED,
        lambda: {"name": problem.name, "status": "certified", "tolerance": tolerance_data(errors)},
    )


def tolerance_table(problem: Problem, errors: Sequence[ToleratedError]) -> Table:
    """Return a table of the errors that a plan tolerates, each with the check that limits it."""
    table = columned_table(f"{problem.name}: tolerated errors, one at a time", ("", "up to", "required", "limited by"))
    table.columns[-1].justify = "left"
    table.columns[-1].no_wrap = False
    units = result_units(problem)
    in_space = problem.dimension == 3
    required = problem.joint_error
    for error in errors:
        wrong, size, where = tolerated_error_words(error, units, in_space=in_space)
        limit = f"≥ {units.given(required, 'rad')}" if error.name == "joints" and required > 0.0 else ""
        table.add_row(wrong, size, limit, escape(where))
    return table
