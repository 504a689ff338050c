"""The command line: one function a command, and exit codes.

Exit codes: 0 solved, 1 a bug, 2 bad input, 3 no plan or a plan that the verifier refuses, 130 cancelled. Of several
files all are tried; the exit code is the highest, but a bug is always 1.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from ccm_opt import __version__

app = typer.Typer(
    name="ccm-opt",
    help="Plan, time and verify motions of highly redundant manipulators.",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


@contextmanager
def _cancellable() -> Iterator[None]:
    """End with exit code 130 on Ctrl-C; Typer would say nothing."""
    try:
        yield
    except KeyboardInterrupt as interrupt:
        sys.stderr.write("error: cancelled\n")
        raise typer.Exit(130) from interrupt


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


@app.command()
def solve(
    files: Annotated[list[Path], typer.Argument(help="Problem files.", metavar="FILE…", show_default=False)],
    *,
    out: Annotated[Path, typer.Option(help="Where each problem's folder is written.")] = Path("runs"),
    method: Annotated[str | None, typer.Option(help="Planner, instead of the one in the file.")] = None,
    constraint: Annotated[
        list[str] | None, typer.Option(help="Own constraint, as module:function. May be repeated.")
    ] = None,
    cost: Annotated[list[str] | None, typer.Option(help="Own cost, as module:function. May be repeated.")] = None,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Leave the pictures out.")] = False,
    no_diagnosis: Annotated[
        bool, typer.Option("--no-diagnosis", help="Without a plan, do not look for what would help.")
    ] = False,
) -> None:
    """Solve problems; write OUT/<name>/ for each."""
    with _cancellable():
        from ccm_opt.cli.solving import OwnTerms, solve_files  # noqa: PLC0415 - loads numpy

        own = OwnTerms(tuple(constraint or ()), tuple(cost or ()))
        raise typer.Exit(solve_files(files, out, method, own, pictures=not no_pictures, explain=not no_diagnosis))


@app.command()
def check(
    folders: Annotated[
        list[Path], typer.Argument(help="Folders that solve wrote.", metavar="FOLDER…", show_default=False)
    ],
) -> None:
    """Verify written plans again, from their files alone."""
    with _cancellable():
        from ccm_opt.cli.checking import check_folders  # noqa: PLC0415 - loads numpy

        raise typer.Exit(check_folders(folders))


@app.command()
def compare(
    files: Annotated[
        list[Path] | None, typer.Argument(help="Problem files.", metavar="[FILE…]", show_default=False)
    ] = None,
    *,
    suite: Annotated[
        list[str] | None, typer.Option(help="Suite: shared, open-space, clutter-N, duct. May be repeated.")
    ] = None,
    count: Annotated[int | None, typer.Option(min=1, help="Problems of each suite.", show_default="20, or all")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first random problem.")] = 0,
    method: Annotated[
        list[str] | None, typer.Option(help="Method. May be repeated.", show_default="nlp and hill-climbing")
    ] = None,
    planner: Annotated[
        list[str] | None, typer.Option(help="Another planner as module:attribute. May be repeated.")
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes of this machine.")] = 1,
    dask: Annotated[str | None, typer.Option(help="Scheduler of a Dask cluster, instead of processes.")] = None,
    out: Annotated[Path, typer.Option(help="Folder of the journal, tables and pictures.")] = Path("runs/comparison"),
    time_limit: Annotated[
        float | None, typer.Option(min=0.001, help="Of every planner, in s.", show_default="the problem's")
    ] = None,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Leave the pictures out.")] = False,
) -> None:
    """Run planners on the same problems and compare what they find; go on where an earlier run stopped."""
    with _cancellable():
        from ccm_opt.cli.comparing import Wanted, compare_methods  # noqa: PLC0415 - loads numpy

        named = (files or (), suite or (), count, seed, method or (), planner or ())
        wanted = Wanted(*named, workers, dask, out, time_limit, pictures=not no_pictures)
        raise typer.Exit(compare_methods(wanted))


@app.command()
def describe(
    files: Annotated[list[Path], typer.Argument(help="Problem files.", metavar="FILE…", show_default=False)],
) -> None:
    """Print the arm of problems: link parameters, drives, masses."""
    with _cancellable():
        from ccm_opt.cli.describing import describe_files  # noqa: PLC0415 - loads numpy

        raise typer.Exit(describe_files(files))


@app.command()
def simulate(
    folders: Annotated[
        list[Path], typer.Argument(help="Folders that solve wrote.", metavar="FOLDER…", show_default=False)
    ],
    *,
    controller: Annotated[str | None, typer.Option(help="computed-torque or pd.")] = None,
    step: Annotated[float | None, typer.Option(min=1e-6, help="Integration step, in s.")] = None,
    bandwidth: Annotated[float | None, typer.Option(min=1e-3, help="Of computed torque and feed, in 1/s.")] = None,
    payload: Annotated[float | None, typer.Option(help="Mass at the tip, unknown to the controller, in kg.")] = None,
    mass_error: Annotated[float | None, typer.Option(help="Share by which the links are heavier.")] = None,
    friction: Annotated[float | None, typer.Option(help="Unknown viscous friction, in N m s/rad.")] = None,
    angle_noise_deg: Annotated[float | None, typer.Option(help="Of measured angles, in degrees.")] = None,
    velocity_noise: Annotated[float | None, typer.Option(help="Of measured speeds, in rad/s.")] = None,
    start_delay: Annotated[float | None, typer.Option(help="Brakes hold the arm so long at first, in s.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Of the noise.")] = None,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Leave the picture out.")] = False,
) -> None:
    """Simulate written plans again, with other settings and disturbances."""
    with _cancellable():
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


@app.command()
def export(
    folder: Annotated[Path, typer.Argument(help="Folder that solve wrote.", show_default=False)],
    *,
    kind: Annotated[str, typer.Option("--format", help="urdf, mjcf, yaml or csv.")],
    out: Annotated[Path | None, typer.Option(help="File to write.", show_default="standard output")] = None,
) -> None:
    """Write the arm or the motion of a written plan for other programs."""
    with _cancellable():
        from ccm_opt.cli.exporting import export_folder  # noqa: PLC0415 - loads numpy

        raise typer.Exit(export_folder(folder, kind, out))
