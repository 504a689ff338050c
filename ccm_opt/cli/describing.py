"""``ccm-opt describe``: the arm of a problem, above all its table of link parameters (section 5.2, Figure 6)."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.table import Table

from ccm_opt.cli.loading import outside_allowed
from ccm_opt.cli.notes import tell_of_drawing, tell_of_meshes, tell_of_odd_rates
from ccm_opt.cli.outcome import SOLVED, print_result, run_all
from ccm_opt.cli.tables import columned_table, report_console
from ccm_opt.core.arrays import FloatArray
from ccm_opt.core.length_words import in_unit
from ccm_opt.io.problem_data import problem_data
from ccm_opt.io.reading import load_problem
from ccm_opt.io.space_problem_data import space_problem_data
from ccm_opt.problem.space_problem import AnyProblem, SpaceProblem
from ccm_opt.robot.driven_arm import DrivenArm
from ccm_opt.robot.frames import dh_table, joint_names

_DRIVE = ("velocity [rad/s]", "acceleration [rad/s²]", "torque [N m]", "rotor [kg m²]", "friction [N m s/rad]")
"""Columns of a revolute's drive."""


def describe_files(files: Sequence[Path], changes: Sequence[str] = ()) -> int:
    """Describe the arm of every file; all are tried.

    Args:
        files: problem files.
        changes: keys of the problem files that are set to other values, each ``key.path=value``.

    Returns:
        The exit code.
    """

    def describe(file: Path) -> int:
        return _describe(load_problem(file, changes=changes, allow_outside=outside_allowed()))

    return run_all(files, describe)


def _describe(problem: AnyProblem) -> int:
    if isinstance(problem, SpaceProblem):
        tell_of_meshes(problem)
    else:
        tell_of_drawing(problem)
    tell_of_odd_rates(problem)

    def show() -> None:
        console = report_console()
        for line in arm_lines(problem):
            console.print(line, markup=False)
        console.print(parameter_table(problem))
        console.print(link_table(problem.arm))

    return print_result(show, SOLVED, lambda: _data(problem))


def _data(problem: AnyProblem) -> dict[str, object]:
    """The arm in the layout of a problem file, and its link parameters in SI units and radians, for programs."""
    if isinstance(problem, SpaceProblem):
        # The arm is told alone, so that it does not matter where meshes are.
        elsewhere = [obstacle.name for obstacle in problem.workspace.obstacles]
        whole = space_problem_data(replace(problem, length_unit="m"), elsewhere)
    else:
        whole = problem_data(replace(problem, length_unit="m"))
    rows = zip(joint_names(problem.arm), dh_table(problem.arm), strict=True)
    parameters = [{"joint": name, **row._asdict()} for name, row in rows]
    return {"status": "described", "name": problem.name, "arm": whole["arm"], "limits": whole["limits"]} | {
        "link_parameters": parameters
    }


def arm_lines(problem: AnyProblem) -> list[str]:
    """The arm in a few lines."""
    arm = problem.arm
    gravity = problem.simulation.gravity
    unit = problem.length_unit

    def number(length: float) -> str:
        return f"{in_unit(length, unit):.9g}"

    def words(length: float) -> str:
        return f"{number(length)} {unit}"

    base = f"({', '.join(number(value) for value in arm.base)}) {unit}, {_pointing(problem)}"
    lines = [
        f"{problem.name}: {arm.links} links of {words(arm.link_length)}, {3 * arm.links} revolutes, axes {arm.axes}",
        f"base at {base}; radius {words(arm.radius)}, length {words(arm.length)}",
        f"mass {np.sum(arm.masses):.6g} kg, payload {arm.payload:g} kg; gravity {gravity.tolist()} m/s²",
    ]
    along = "the base's direction" if isinstance(problem, SpaceProblem) else "the base heading"
    lines += [
        f"feed axis from {number(axis.low)} to {words(axis.high)} along {along}, guide tube ends at {words(axis.hole)}"
        for axis in arm.base_axes
    ]
    return lines


def _pointing(problem: AnyProblem) -> str:
    """How the base is turned."""
    if isinstance(problem, SpaceProblem):
        return f"direction {_components(problem.arm.direction)}, up {_components(problem.arm.up)}"
    return f"heading {np.rad2deg(problem.arm.base_heading):.6g} deg"


def _components(vector: FloatArray) -> str:
    # A zero that rounding made negative is a zero.
    return f"({', '.join(f'{value + 0.0:.6g}' for value in vector.round(12))})"


def parameter_table(problem: AnyProblem) -> Table:
    """Standard Denavit–Hartenberg parameters of every revolute, A = Rz(θ + offset) Tz(d) Tx(a) Rx(α), and its drive."""
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


def link_table(arm: DrivenArm) -> Table:
    """Mass and moments of inertia of every link; the two frames between, of no mass, are left out."""
    table = columned_table("links", ("link", "mass [kg]", "axial [kg m²]", "transverse [kg m²]", "bend limit [deg]"))
    # In space a joint has two bends, within the same limit.
    limits = np.rad2deg(arm.bend_limits.reshape(arm.links, -1)[:, 0])
    for k in range(arm.links):
        inertia = (f"{arm.inertia_axial[k]:.6g}", f"{arm.inertia_transverse[k]:.6g}")
        table.add_row(f"link{k + 1:02d}", f"{arm.masses[k]:g}", *inertia, f"{limits[k]:.6g}")
    return table
