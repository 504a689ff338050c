"""Definition of every command of ``ccm-opt``: one function per command, which calls its implementation.

Each function returns an exit code, see ``outcome``. The docstrings of commands are their help texts. The handling of
Ctrl-C is described in ``cancelling``.
"""

from pathlib import Path
from typing import Annotated

import typer

from ccm_opt.cli.options import (
    Changes,
    Constraints,
    Costs,
    DaskAddress,
    FigureFormatOption,
    Folders,
    ProblemFiles,
    Workers,
    app,
    command,
    listed_or_given,
)
from ccm_opt.cli.output import ControllerChoice, ExportFormat, FigureName, MethodChoice, SizeChoice
from ccm_opt.cli.surroundings import no_search_for_cycles

__all__ = ["app"]


@command("new", ("ccm-opt new mine", "ccm-opt new rigs/bulkhead.toml", "ccm-opt new --space duct"))
def new_command(
    file: Annotated[Path, typer.Argument(help="File to write.", metavar="FILE", show_default=False)],
    *,
    space: Annotated[bool, typer.Option("--space", help="Write a problem in space rather than in the plane.")] = False,
) -> int:
    """Write a commented problem file to start from; it solves as it is."""
    from ccm_opt.cli.starting import write_new  # noqa: PLC0415 - loads numpy

    return write_new(file, space=space)


@command("problems", ("ccm-opt problems", "ccm-opt problems swan-neck fork --out mine"))
def problems_command(
    names: Annotated[
        list[str] | None, typer.Argument(help="Problems to copy. Default: list all.", show_default=False)
    ] = None,
    *,
    out: Annotated[Path, typer.Option(help="Folder for the copies.")] = Path(),
) -> int:
    """List the problems that come with ccm-opt, or copy some of them."""
    from ccm_opt.cli.starting import show_problems  # noqa: PLC0415 - loads numpy

    return show_problems(names or (), out)


@command(
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
    out: Annotated[Path, typer.Option(help="Parent folder of the output folders.")] = Path("runs"),
    method: Annotated[MethodChoice | None, typer.Option(help="Planner, in place of the file's planner.method.")] = None,
    time_limit: Annotated[
        float | None,
        typer.Option(min=0.001, help="CPU time limit of planning, in s.", show_default="the file's planner.time_limit"),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of the search.", show_default="the file's planner.seed")
    ] = None,
    changes: Changes = None,
    constraint: Constraints = None,
    cost: Costs = None,
    pareto: Annotated[
        bool, typer.Option("--pareto", help="Make five plans that trade duration for clearance, and recommend one.")
    ] = False,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Draw no pictures.")] = False,
    figure_format: FigureFormatOption = "png",
    no_diagnosis: Annotated[
        bool, typer.Option("--no-diagnosis", help="If there is no plan, do not search for changes that would help.")
    ] = False,
) -> int:
    """Plan, time and verify; write OUT/<name>/ for each problem."""
    with no_search_for_cycles():
        from ccm_opt.cli.solving import solve_files  # noqa: PLC0415 - loads numpy

    of_planner = {"method": method, "time_limit": time_limit, "seed": seed}
    return solve_files(
        files,
        out,
        (*(changes or ()), *(f"planner.{key}={value}" for key, value in of_planner.items() if value is not None)),
        terms=(constraint or (), cost or ()),
        pictures=not no_pictures,
        figure_format=figure_format,
        explain=not no_diagnosis,
        several=pareto,
    )


@command("view", ("ccm-opt view problems/swan-neck.toml", "ccm-opt view runs/swan-neck --port 8090"))
def view_command(
    item: Annotated[
        Path,
        typer.Argument(
            help="Problem file, name that `ccm-opt problems` lists, or output folder of solve.",
            metavar="FILE|FOLDER",
            show_default=False,
            callback=lambda item: (listed_or_given([item]) or [item])[0],
        ),
    ],
    *,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of the page, served to this machine only; 0: any free port.")
    ] = 8080,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Do not open a browser.")] = False,
) -> int:
    """Show a motion in the browser; drag the goal or an obstacle to plan it again."""
    from ccm_opt.cli.drawing import view_item  # noqa: PLC0415 - loads numpy

    return view_item(item, port, browser=not no_browser)


@command(
    "pose",
    ("ccm-opt pose problems/swan-neck.toml",),
)
def pose_command(
    files: ProblemFiles,
    *,
    out: Annotated[Path, typer.Option(help="Parent folder of the output folders.")] = Path("runs/poses"),
    changes: Changes = None,
    constraint: Constraints = None,
    cost: Costs = None,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Draw no picture.")] = False,
) -> int:
    """Find the best goal pose, without a motion to it; write OUT/<name>/ for each problem."""
    from ccm_opt.cli.posing import pose_files  # noqa: PLC0415 - loads numpy

    return pose_files(files, out, (constraint or (), cost or ()), changes or (), pictures=not no_pictures)


@command(
    "reach",
    ("ccm-opt reach problems/swan-neck.toml --step 0.05",),
)
def reach_command(
    files: ProblemFiles,
    *,
    out: Annotated[Path, typer.Option(help="Parent folder of the output folders.")] = Path("runs/reach"),
    changes: Changes = None,
    step: Annotated[
        float | None,
        typer.Option(help="Cell width, in m.", show_default="1/16 of the arm's length; in space 1/8"),
    ] = None,
    headings: Annotated[
        int | None,
        typer.Option(
            min=1, help="Number of headings tried per cell; in space, of directions.", show_default="16; in space none"
        ),
    ] = None,
    workers: Workers = 1,
    dask: DaskAddress = None,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Draw no picture.")] = False,
) -> int:
    """Map where the tip can be, and with which headings; write OUT/<name>/ for each problem."""
    from ccm_opt.cli.posing import reach_files  # noqa: PLC0415 - loads numpy

    return reach_files(
        files,
        out,
        changes or (),
        step=step,
        headings=headings,
        workers=workers,
        dask=dask,
        pictures=not no_pictures,
    )


@command(
    "size",
    (
        "ccm-opt size problems/jobs/wing-box.toml",
        "ccm-opt size problems/jobs/wing-box.toml --find radius",
        "ccm-opt size problems/jobs/wing-box.toml --base-line 800,-450 1000,-450",
        "ccm-opt size problems/jobs/wing-box.toml --pareto --workers 2",
    ),
)
def size_command(
    files: ProblemFiles,
    *,
    out: Annotated[Path, typer.Option(help="Parent folder of the output folders.")] = Path("runs/sizes"),
    changes: Changes = None,
    find: Annotated[
        SizeChoice | None,
        typer.Option(help="Find the least length, the fewest links, or the greatest radius.", show_default="length"),
    ] = None,
    base_line: Annotated[
        tuple[str, str] | None,
        typer.Option(metavar="X,Y X,Y", help="Find the best place of the base on a line, too; in the file's unit."),
    ] = None,
    base_rectangle: Annotated[
        tuple[str, str] | None,
        typer.Option(metavar="X,Y X,Y", help="Likewise, over a rectangle with these corners, along the axes."),
    ] = None,
    places: Annotated[
        int | None, typer.Option(min=2, help="Number of places on the line, or a side.", show_default="5")
    ] = None,
    pareto: Annotated[bool, typer.Option("--pareto", help="Find the least length for five radii.")] = False,
    time_limit: Annotated[
        float | None,
        typer.Option(min=0.001, help="CPU time limit of one plan, in s.", show_default="the file's planner.time_limit"),
    ] = None,
    workers: Workers = 1,
    dask: DaskAddress = None,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Draw no pictures.")] = False,
) -> int:
    """Find the arm that is needed, and prove what is too small; write OUT/<name>/ for each problem."""
    from ccm_opt.cli.sizing import size_problems  # noqa: PLC0415 - loads numpy

    return size_problems(
        files,
        out,
        changes or (),
        find=find,
        line=base_line,
        rectangle=base_rectangle,
        places=places,
        front=pareto,
        time_limit=time_limit,
        workers=workers,
        dask=dask,
        pictures=not no_pictures,
    )


@command(
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
    """Verify written plans anew, from their files alone."""
    from ccm_opt.cli.written_plans import check_folders  # noqa: PLC0415 - loads numpy

    return check_folders(folders, tuple(constraint or ()))


@command(
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
            help=(
                "Suite of problems: shared, open-space, clutter-N or duct; in space: space-clutter-N, "
                "space-elbow, space-wing-box or space-blade-row; or module:attribute. Repeatable."
            )
        ),
    ] = None,
    count: Annotated[
        int | None, typer.Option(min=1, help="Number of problems from each suite.", show_default="20, or all there are")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the first random problem.")] = 0,
    method: Annotated[
        list[str] | None, typer.Option(help="Method to compare. Repeatable.", show_default="nlp and hill-climbing")
    ] = None,
    planner: Annotated[
        list[str] | None, typer.Option(help="Another planner to compare, as module:attribute. Repeatable.")
    ] = None,
    workers: Workers = 1,
    dask: DaskAddress = None,
    out: Annotated[Path, typer.Option(help="Output folder for journal, tables and page.")] = Path("runs/comparison"),
    time_limit: Annotated[
        float | None,
        typer.Option(min=0.001, help="CPU time limit of each planner, in s.", show_default="the problem's"),
    ] = None,
    write_problems: Annotated[
        bool, typer.Option("--write-problems", help="Write every problem as a file to problems/ in the output folder.")
    ] = False,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Write no page of charts.")] = False,
) -> int:
    """Run planners on the same problems and compare the results; resume an interrupted comparison."""
    from ccm_opt.cli.comparing import compare_methods  # noqa: PLC0415 - loads numpy

    return compare_methods(
        files or (),
        out,
        suites=suite or (),
        count=count,
        seed=seed,
        methods=method or (),
        planners=planner or (),
        workers=workers,
        dask=dask,
        time_limit=time_limit,
        page=not no_pictures,
        problems=write_problems,
    )


@command(
    "describe",
    ("ccm-opt describe problems/swan-neck.toml",),
)
def describe_command(
    files: ProblemFiles,
    *,
    changes: Changes = None,
) -> int:
    """Print the arm of a problem: link parameters, drives, masses."""
    from ccm_opt.cli.examining import describe_files  # noqa: PLC0415 - loads numpy

    return describe_files(files, changes or ())


@command(
    "retarget",
    ("ccm-opt retarget runs/swan-neck --position 0.35,0.2 --time 0.8",),
)
def retarget_command(
    folder: Annotated[Path, typer.Argument(help="Output folder of solve.", show_default=False)],
    *,
    position: Annotated[
        str, typer.Option(metavar="X,Y", help="New position of the tip, in the file's unit; in space X,Y,Z.")
    ],
    direction: Annotated[
        str | None,
        typer.Option(metavar="X,Y", help="New direction of the tool or last link; in space X,Y,Z.", show_default="any"),
    ] = None,
    time: Annotated[float | None, typer.Option(help="Time of the motion at which the new goal is known, in s.")] = None,
    joints_deg: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,…",
            help="Instead, the angles of the joints, or even sections, measured then, in degrees; in space two each.",
        ),
    ] = None,
    feed: Annotated[
        float | None, typer.Option(help="With --joints-deg, the measured position of the base on its feed axis, in m.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Parent folder of the output folder.")] = Path("runs/retargeted"),
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Draw no pictures.")] = False,
) -> int:
    """Leave a written plan for a new goal on the way: brake, go on, verify; write OUT/<name>/."""
    from ccm_opt.cli.retargeting import retarget_folder  # noqa: PLC0415 - loads numpy

    return retarget_folder(folder, out, (position, direction), time, joints_deg, feed, pictures=not no_pictures)


@command(
    "simulate",
    ("ccm-opt simulate runs/swan-neck --payload 0.2 --no-pictures",),
)
def simulate_command(
    folders: Folders,
    *,
    controller: Annotated[ControllerChoice | None, typer.Option(help="Controller.")] = None,
    step: Annotated[float | None, typer.Option(min=1e-6, help="Integration step, in s.")] = None,
    bandwidth: Annotated[
        float | None, typer.Option(min=1e-3, help="Bandwidth of the controller, at joints and feed axis, in 1/s.")
    ] = None,
    payload: Annotated[float | None, typer.Option(help="Tip mass unknown to the controller, in kg.")] = None,
    mass_error: Annotated[
        float | None, typer.Option(help="Fraction by which the links are heavier than the controller's model.")
    ] = None,
    friction: Annotated[
        float | None, typer.Option(help="Viscous joint friction unknown to the controller, in N m s/rad.")
    ] = None,
    angle_noise_deg: Annotated[
        float | None, typer.Option(help="Standard deviation of the measured angles, in degrees.")
    ] = None,
    velocity_noise: Annotated[
        float | None, typer.Option(help="Standard deviation of the measured velocities, in rad/s.")
    ] = None,
    start_delay: Annotated[
        float | None, typer.Option(help="Time for which the brakes hold the arm at the start, in s.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of the noise.")] = None,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Draw no picture.")] = False,
) -> int:
    """Simulate written plans with other settings and disturbances."""
    from math import radians  # noqa: PLC0415

    from ccm_opt.cli.examining import simulate_folders  # noqa: PLC0415 - loads numpy

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
    return simulate_folders(folders, options, disturbances, pictures=not no_pictures)


@command(
    "tolerance",
    ("ccm-opt tolerance runs/swan-neck",),
)
def tolerance_command(
    folders: Folders,
    *,
    no_simulation: Annotated[
        bool, typer.Option("--no-simulation", help="Skip payload and friction, which take simulations.")
    ] = False,
    no_pictures: Annotated[bool, typer.Option("--no-pictures", help="Draw no picture.")] = False,
) -> int:
    """Find the largest errors of joints, links, base, walls and loads that written plans tolerate."""
    from ccm_opt.cli.examining import examine_tolerance  # noqa: PLC0415 - loads numpy

    return examine_tolerance(folders, simulated=not no_simulation, pictures=not no_pictures)


@command(
    "export",
    (
        "ccm-opt export runs/swan-neck --format urdf --out arm.urdf",
        "ccm-opt export runs/swan-neck --format yaml --bends-only --out trajectory.yaml",
        "ccm-opt export runs/swan-neck --format glb --out motion.glb",
    ),
)
def export_command(
    folder: Annotated[Path, typer.Argument(help="Output folder of solve.", show_default=False)],
    *,
    kind: Annotated[ExportFormat, typer.Option("--format", help="Format.")],
    out: Annotated[Path | None, typer.Option(help="File to write.", show_default="standard output")] = None,
    bends_only: Annotated[
        bool,
        typer.Option("--bends-only", help="Omit the two revolutes of each ball joint that stay at 0 in the plane."),
    ] = False,
    no_scene: Annotated[bool, typer.Option("--no-scene", help="Omit the obstacles from URDF and MJCF.")] = False,
    effort: Annotated[
        bool, typer.Option("--effort", help="Write efforts to yaml; controllers since ROS 2 Humble reject them.")
    ] = False,
) -> int:
    """Export arm, obstacles or motion of a written plan for other programs."""
    from ccm_opt.cli.written_plans import export_folder  # noqa: PLC0415 - loads numpy

    return export_folder(folder, kind, out, bends_only=bends_only, scene=not no_scene, effort=effort)


@command(
    "draw",
    (
        "ccm-opt draw runs/swan-neck",
        "ccm-opt draw runs/swan-neck --figure plan --figure links --figure-format pdf --out paper",
        "ccm-opt draw runs/* --figure mp4",
    ),
)
def draw_command(
    folders: Folders,
    *,
    figure: Annotated[
        list[FigureName] | None,
        typer.Option(
            help="Figure to draw, film, or report.html of the plan, verified again; mp4 needs ffmpeg. Repeatable.",
            show_default="all still figures",
        ),
    ] = None,
    figure_format: FigureFormatOption = "png",
    out: Annotated[Path | None, typer.Option(help="Output folder of the pictures.", show_default="the plan's")] = None,
) -> int:
    """Draw written plans: motion, curvatures, steps, linkage, simulated arm."""
    from ccm_opt.cli.drawing import draw_folders  # noqa: PLC0415 - loads numpy

    return draw_folders(folders, figure or (), figure_format, out)
