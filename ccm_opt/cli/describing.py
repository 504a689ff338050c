"""``ccm-opt describe``: the arm of a problem, above all its table of link parameters (section 5.2, Figure 6)."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from rich.table import Table

from ccm_opt.cli.drawing_notes import tell_of_drawing
from ccm_opt.cli.outcome import SOLVED, print_result, run_all
from ccm_opt.cli.outside_files import outside_allowed
from ccm_opt.cli.tables import columned_table, report_console
from ccm_opt.files.problem_file import load_problem
from ccm_opt.files.problem_file.problem_data import problem_data
from ccm_opt.ground.length_units import in_unit
from ccm_opt.jointed.arm import Arm
from ccm_opt.jointed.frames import dh_table, joint_names
from ccm_opt.problem import Problem
from ccm_opt.space.problem import in_the_plane

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
        problem = load_problem(file, changes=changes, allow_outside=outside_allowed())
        return _describe(in_the_plane(problem, "ccm-opt describe"))

    return run_all(files, describe)


def _describe(problem: Problem) -> int:
    tell_of_drawing(problem)

    def show() -> None:
        console = report_console()
        for line in arm_lines(problem):
            console.print(line, markup=False)
        console.print(parameter_table(problem))
        console.print(link_table(problem.arm))

    return print_result(show, SOLVED, lambda: _data(problem))


def _data(problem: Problem) -> dict[str, object]:
    """The arm in the layout of a problem file, and its link parameters in SI units and radians, for programs."""
    whole = problem_data(replace(problem, length_unit="m"))
    rows = zip(joint_names(problem.arm), dh_table(problem.arm), strict=True)
    parameters = [{"joint": name, **row._asdict()} for name, row in rows]
    return {"status": "described", "name": problem.name, "arm": whole["arm"], "limits": whole["limits"]} | {
        "link_parameters": parameters
    }


def arm_lines(problem: Problem) -> list[str]:
    """The arm in a few lines."""
    arm = problem.arm
    gravity = problem.simulation.gravity
    unit = problem.length_unit

    def number(length: float) -> str:
        return f"{in_unit(length, unit):.9g}"

    def words(length: float) -> str:
        return f"{number(length)} {unit}"

    base = f"({number(arm.base[0])}, {number(arm.base[1])}) {unit}, heading {np.rad2deg(arm.base_heading):.6g} deg"
    lines = [
        f"{problem.name}: {arm.links} links of {words(arm.link_length)}, {3 * arm.links} revolutes, axes {arm.axes}",
        f"base at {base}; radius {words(arm.radius)}, length {words(arm.length)}",
        f"mass {np.sum(arm.masses):.6g} kg, payload {arm.payload:g} kg; gravity {gravity.tolist()} m/s²",
    ]
    lines += [
        f"feed axis from {number(axis.low)} to {words(axis.high)} along the base heading, "
        f"guide tube ends at {words(axis.hole)}"
        for axis in arm.base_axes
    ]
    return lines


def parameter_table(problem: Problem) -> Table:
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


def link_table(arm: Arm) -> Table:
    """Mass and moments of inertia of every link; the two frames between, of no mass, are left out."""
    table = columned_table("links", ("link", "mass [kg]", "axial [kg m²]", "transverse [kg m²]", "bend limit [deg]"))
    limits = np.rad2deg(arm.bend_limits)
    for k in range(arm.links):
        inertia = (f"{arm.inertia_axial[k]:.6g}", f"{arm.inertia_transverse[k]:.6g}")
        table.add_row(f"link{k + 1:02d}", f"{arm.masses[k]:g}", *inertia, f"{limits[k]:.6g}")
    return table
