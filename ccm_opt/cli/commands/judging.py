"""Commands that judge: a written plan against its problem, and planners against each other."""

from pathlib import Path
from typing import Annotated

import typer

from ccm_opt.cli.command_group import command
from ccm_opt.cli.commands.options import Constraints, Folders, listed_or_given

app = typer.Typer()
"""The commands of this file."""


@command(
    app,
    "check",
    (
        "ccm-opt check runs/swan-neck",
        "ccm-opt check runs/swan-neck --constraint terms.py:camera_sees_valve",
    ),
)
def check_command(
    folders: Folders,
    *,
    constraint: Constraints = None,
) -> int:
    """Verify written plans again, from their files alone."""
    from ccm_opt.cli.checking import check_folders  # noqa: PLC0415 - loads numpy

    return check_folders(folders, tuple(constraint or ()))


@command(
    app,
    "compare",
    (
        "ccm-opt compare --suite open-space --count 10",
        "ccm-opt compare mine.toml --method nlp --method hill-climbing --workers 4",
    ),
)
def compare_command(
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Problem files, or names that `ccm-opt problems` lists.",
            metavar="[FILE…]",
            show_default=False,
            callback=listed_or_given,
        ),
    ] = None,
    *,
    suite: Annotated[
        list[str] | None,
        typer.Option(
            help="Suite of problems: shared, open-space, clutter-N or duct; in space space-clutter-N, space-elbow, "
            "space-wing-box, space-blade-row, space-tank and others. May be repeated."
        ),
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
    write_problems: Annotated[
        bool, typer.Option("--write-problems", help="Write every problem as a file, in problems/ of that folder.")
    ] = False,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Leave the pictures out.")] = False,
) -> int:
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
        write_problems=write_problems,
    )
    return compare_methods(options)
