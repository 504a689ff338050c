"""Every command and option of ``ccm-opt``: one function a command, which hands over to the module of its name.

What each exit code means is in ``outcome``, what happens on Ctrl-C in ``cancelling``.
"""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from ccm_opt import __version__
from ccm_opt.cli.cancelling import report_cancelled


class CommandGroup(TyperGroup):
    """All commands; Ctrl-C while one of them loads its modules ends with exit code 130, where Typer's own is 1."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command that was asked for."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt as interrupt:
            raise typer.Exit(report_cancelled()) from interrupt


ProblemFiles = Annotated[list[Path], typer.Argument(help="Problem files.", metavar="FILE…", show_default=False)]
Constraints = Annotated[
    list[str] | None, typer.Option(help="User constraint, as module:function or file.py:function. May be repeated.")
]
Costs = Annotated[
    list[str] | None, typer.Option(help="User cost, as module:function or file.py:function. May be repeated.")
]

app = typer.Typer(
    name="ccm-opt",
    cls=CommandGroup,
    help="Plan, time and verify motions of highly redundant manipulators.",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def _show_version(wanted: bool) -> None:
    if wanted:
        sys.stdout.write(f"ccm-opt {__version__}\n")
        raise typer.Exit


@app.callback()
def _root(
    *,
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Plan, time and verify motions of highly redundant manipulators."""


@app.command("solve")
def solve_command(
    files: ProblemFiles,
    *,
    out: Annotated[Path, typer.Option(help="Folder in which each problem's folder is written.")] = Path("runs"),
    method: Annotated[str | None, typer.Option(help="Planner to use instead of the one in the file.")] = None,
    constraint: Constraints = None,
    cost: Costs = None,
    pareto: Annotated[
        bool, typer.Option("--pareto", help="Make five plans from the fastest to the roomiest, and recommend one.")
    ] = False,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Leave the pictures out.")] = False,
    no_diagnosis: Annotated[
        bool, typer.Option("--no-diagnosis", help="When there is no plan, do not look for what would help.")
    ] = False,
) -> None:
    """Solve problems; write OUT/<name>/ for each."""
    from ccm_opt.cli.solving import solve_files  # noqa: PLC0415 - loads numpy
    from ccm_opt.cli.term_references import TermReferences  # noqa: PLC0415

    terms = TermReferences(tuple(constraint or ()), tuple(cost or ()))
    raise typer.Exit(
        solve_files(files, out, method, terms, pictures=not no_pictures, explain=not no_diagnosis, several=pareto)
    )


@app.command("pose")
def pose_command(
    files: ProblemFiles,
    *,
    out: Annotated[Path, typer.Option(help="Folder in which each problem's folder is written.")] = Path("runs/poses"),
    constraint: Constraints = None,
    cost: Costs = None,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Leave the picture out.")] = False,
) -> None:
    """Find the best pose at the goal, without a motion to it; write OUT/<name>/ for each."""
    from ccm_opt.cli.posing import pose_files  # noqa: PLC0415 - loads numpy
    from ccm_opt.cli.term_references import TermReferences  # noqa: PLC0415

    terms = TermReferences(tuple(constraint or ()), tuple(cost or ()))
    raise typer.Exit(pose_files(files, out, terms, pictures=not no_pictures))


@app.command("reach")
def reach_command(
    files: ProblemFiles,
    *,
    out: Annotated[Path, typer.Option(help="Folder in which each problem's folder is written.")] = Path("runs/reach"),
    step: Annotated[
        float | None, typer.Option(help="Width of a cell, in m.", show_default="a sixteenth of the arm's length")
    ] = None,
    headings: Annotated[
        int | None, typer.Option(min=1, help="Headings that are tried in a cell.", show_default="16")
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help="Number of processes on this machine.")] = 1,
    dask: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, to run on its cluster instead.")
    ] = None,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Leave the picture out.")] = False,
) -> None:
    """Map where the tip can be in the room, and with which headings; write OUT/<name>/ for each."""
    from ccm_opt.cli.reaching import ReachOptions, reach_files  # noqa: PLC0415 - loads numpy

    options = ReachOptions(out, step, headings, workers, dask, pictures=not no_pictures)
    raise typer.Exit(reach_files(files, options))


@app.command("check")
def check_command(
    folders: Annotated[
        list[Path], typer.Argument(help="Folders that solve wrote.", metavar="FOLDER…", show_default=False)
    ],
) -> None:
    """Verify written plans again, from their files alone."""
    from ccm_opt.cli.checking import check_folders  # noqa: PLC0415 - loads numpy

    raise typer.Exit(check_folders(folders))


@app.command("compare")
def compare_command(
    files: Annotated[
        list[Path] | None, typer.Argument(help="Problem files.", metavar="[FILE…]", show_default=False)
    ] = None,
    *,
    suite: Annotated[
        list[str] | None,
        typer.Option(help="Suite of problems: shared, open-space, clutter-N or duct. May be repeated."),
    ] = None,
    count: Annotated[
        int | None, typer.Option(min=1, help="Number of problems from each suite.", show_default="20, or all")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first random problem.")] = 0,
    method: Annotated[
        list[str] | None, typer.Option(help="Method to compare. May be repeated.", show_default="nlp and hill-climbing")
    ] = None,
    planner: Annotated[
        list[str] | None, typer.Option(help="Another planner to compare, as module:attribute. May be repeated.")
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help="Number of processes on this machine.")] = 1,
    dask: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, to run on its cluster instead.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder of the journal, tables and pictures.")] = Path("runs/comparison"),
    time_limit: Annotated[
        float | None,
        typer.Option(min=0.001, help="CPU time for every planner, in s.", show_default="the problem's"),
    ] = None,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Leave the pictures out.")] = False,
) -> None:
    """Run planners on the same problems and compare what they find; continue where an earlier run stopped."""
    from ccm_opt.cli.comparing import CompareOptions, compare_methods  # noqa: PLC0415 - loads numpy

    options = CompareOptions(
        files=files or (),
        suites=suite or (),
        count=count,
        seed=seed,
        methods=method or (),
        planners=planner or (),
        workers=workers,
        dask=dask,
        out=out,
        time_limit=time_limit,
        pictures=not no_pictures,
    )
    raise typer.Exit(compare_methods(options))


@app.command("describe")
def describe_command(
    files: ProblemFiles,
) -> None:
    """Print the arm of problems: link parameters, drives, masses."""
    from ccm_opt.cli.describing import describe_files  # noqa: PLC0415 - loads numpy

    raise typer.Exit(describe_files(files))


@app.command("simulate")
def simulate_command(
    folders: Annotated[
        list[Path], typer.Argument(help="Folders that solve wrote.", metavar="FOLDER…", show_default=False)
    ],
    *,
    controller: Annotated[str | None, typer.Option(help="Controller: computed-torque or pd.")] = None,
    step: Annotated[float | None, typer.Option(min=1e-6, help="Integration step, in s.")] = None,
    bandwidth: Annotated[
        float | None, typer.Option(min=1e-3, help="Bandwidth of computed torque and of the feed axis, in 1/s.")
    ] = None,
    payload: Annotated[float | None, typer.Option(help="Mass at the tip, unknown to the controller, in kg.")] = None,
    mass_error: Annotated[
        float | None, typer.Option(help="Fraction by which the links are heavier than the controller believes.")
    ] = None,
    friction: Annotated[
        float | None, typer.Option(help="Viscous friction, unknown to the controller, in N m s/rad.")
    ] = None,
    angle_noise_deg: Annotated[float | None, typer.Option(help="Noise of the measured angles, in degrees.")] = None,
    velocity_noise: Annotated[float | None, typer.Option(help="Noise of the measured velocities, in rad/s.")] = None,
    start_delay: Annotated[
        float | None, typer.Option(help="How long the brakes hold the arm before it starts, in s.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the noise.")] = None,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Leave the picture out.")] = False,
) -> None:
    """Simulate written plans again, with other settings and disturbances."""
    from math import radians  # noqa: PLC0415

    from ccm_opt.cli.simulating import Overrides, simulate_folders  # noqa: PLC0415 - loads numpy

    options = {"controller": controller, "step": step, "bandwidth": bandwidth}
    disturbances = {
        "payload": payload,
        "mass_error": mass_error,
        "friction": friction,
        "angle_noise": None if angle_noise_deg is None else radians(angle_noise_deg),
        "velocity_noise": velocity_noise,
        "start_delay": start_delay,
        "seed": seed,
    }
    raise typer.Exit(simulate_folders(folders, Overrides(options, disturbances), pictures=not no_pictures))


@app.command("tolerance")
def tolerance_command(
    folders: Annotated[
        list[Path], typer.Argument(help="Folders that solve wrote.", metavar="FOLDER…", show_default=False)
    ],
    *,
    no_simulation: Annotated[
        bool, typer.Option("--no-simulation", help="Leave out payload and friction, which are found by simulations.")
    ] = False,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Leave the picture out.")] = False,
) -> None:
    """Say which errors of joints, links, base, walls and loads written plans survive."""
    from ccm_opt.cli.tolerating import tolerance_of_folders  # noqa: PLC0415 - loads numpy

    code = tolerance_of_folders(folders, simulated=not no_simulation, pictures=not no_pictures)
    raise typer.Exit(code)


@app.command("export")
def export_command(
    folder: Annotated[Path, typer.Argument(help="Folder that solve wrote.", show_default=False)],
    *,
    kind: Annotated[str, typer.Option("--format", help="Format: urdf, mjcf, yaml or csv.")],
    out: Annotated[Path | None, typer.Option(help="File to write.", show_default="standard output")] = None,
) -> None:
    """Write the arm or the motion of a written plan for other programs."""
    from ccm_opt.cli.exporting import export_folder  # noqa: PLC0415 - loads numpy

    raise typer.Exit(export_folder(folder, kind, out))
