"""Commands that look for motions, poses and places of a problem."""

from pathlib import Path
from typing import Annotated

import typer

from ccm_opt.cli.choices import MethodChoice
from ccm_opt.cli.command_group import command
from ccm_opt.cli.commands.options import Changes, Constraints, Costs, FigureFormatOption, ProblemFiles, listed_or_given
from ccm_opt.cli.loading import no_search_for_cycles

app = typer.Typer()
"""The commands of this file."""


@command(
    app,
    "solve",
    (
        "ccm-opt solve problems/swan-neck.toml",
        "ccm-opt solve problems/*.toml --out runs --no-pictures",
        "ccm-opt solve mine.toml --set arm.radius=0.02 --time-limit 10",
        "ccm-opt solve mine.toml --constraint terms.py:camera_sees_valve",
        "cat mine.toml | ccm-opt solve - --json",
    ),
)
def solve_command(
    files: ProblemFiles,
    *,
    out: Annotated[Path, typer.Option(help="Folder in which each problem's folder is written.")] = Path("runs"),
    method: Annotated[MethodChoice | None, typer.Option(help="Planner to use instead of the one in the file.")] = None,
    time_limit: Annotated[
        float | None,
        typer.Option(min=0.001, help="CPU time for planning, in s.", show_default="the file's planner.time_limit"),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of the search.", show_default="the file's planner.seed")
    ] = None,
    changes: Changes = None,
    constraint: Constraints = None,
    cost: Costs = None,
    pareto: Annotated[
        bool, typer.Option("--pareto", help="Make five plans from the fastest to the roomiest, and recommend one.")
    ] = False,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Leave the pictures out.")] = False,
    figure_format: FigureFormatOption = "png",
    no_diagnosis: Annotated[
        bool, typer.Option("--no-diagnosis", help="When there is no plan, do not look for what would help.")
    ] = False,
) -> int:
    """Solve problems; write OUT/<name>/ for each."""
    with no_search_for_cycles():
        from ccm_opt.cli.loading import TermReferences  # noqa: PLC0415
        from ccm_opt.cli.solving import SolveOptions, solve_files, with_planner_options  # noqa: PLC0415 - loads numpy

    options = SolveOptions(
        out=out,
        terms=TermReferences(tuple(constraint or ()), tuple(cost or ())),
        changes=with_planner_options(changes or (), method=method, time_limit=time_limit, seed=seed),
        pictures=not no_pictures,
        figure_format=figure_format,
        explain=not no_diagnosis,
        several=pareto,
    )
    return solve_files(files, options)


@command(app, "view", ("ccm-opt view problems/swan-neck.toml", "ccm-opt view runs/swan-neck --port 8090"))
def view_command(
    item: Annotated[
        Path,
        typer.Argument(
            help="Problem file, or name that `ccm-opt problems` lists, or folder that solve wrote.",
            metavar="FILE|FOLDER",
            show_default=False,
            callback=lambda item: (listed_or_given([item]) or [item])[0],
        ),
    ],
    *,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the page, on this machine alone; 0: any.")
    ] = 8080,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Do not open the page.")] = False,
) -> int:
    """Show a motion in space in the browser; drag its goal or a wall, and it is planned again."""
    from ccm_opt.cli.viewing import view_item  # noqa: PLC0415 - loads numpy

    return view_item(item, port, browser=not no_browser)


@command(
    app,
    "pose",
    ("ccm-opt pose problems/swan-neck.toml",),
)
def pose_command(
    files: ProblemFiles,
    *,
    out: Annotated[Path, typer.Option(help="Folder in which each problem's folder is written.")] = Path("runs/poses"),
    changes: Changes = None,
    constraint: Constraints = None,
    cost: Costs = None,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Leave the picture out.")] = False,
) -> int:
    """Find the best pose at the goal, without a motion to it; write OUT/<name>/ for each."""
    from ccm_opt.cli.loading import TermReferences  # noqa: PLC0415
    from ccm_opt.cli.posing import pose_files  # noqa: PLC0415 - loads numpy

    terms = TermReferences(tuple(constraint or ()), tuple(cost or ()))
    return pose_files(files, out, terms, changes or (), pictures=not no_pictures)


@command(
    app,
    "reach",
    ("ccm-opt reach problems/swan-neck.toml --step 0.05",),
)
def reach_command(
    files: ProblemFiles,
    *,
    out: Annotated[Path, typer.Option(help="Folder in which each problem's folder is written.")] = Path("runs/reach"),
    changes: Changes = None,
    step: Annotated[
        float | None,
        typer.Option(help="Width of a cell, in m.", show_default="a sixteenth of the arm's length, in space an eighth"),
    ] = None,
    headings: Annotated[
        int | None,
        typer.Option(
            min=1, help="Headings that are tried in a cell, in space directions.", show_default="16, in space none"
        ),
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help="Number of processes on this machine.")] = 1,
    dask: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler, to run on its cluster instead.")
    ] = None,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Leave the picture out.")] = False,
) -> int:
    """Map where the tip can be in the room, and with which headings; write OUT/<name>/ for each."""
    from ccm_opt.cli.reaching import ReachOptions, reach_files  # noqa: PLC0415 - loads numpy

    options = ReachOptions(out, step, headings, workers, dask, pictures=not no_pictures)
    return reach_files(files, options, changes or ())
