"""Commands that hand a written plan on, to other programs and to people."""

from pathlib import Path
from typing import Annotated

import typer

from ccm_opt.cli.choices import ExportFormat, FigureName
from ccm_opt.cli.command_group import command
from ccm_opt.cli.commands.options import FigureFormatOption, Folders

app = typer.Typer()
"""The commands of this file."""


@command(
    app,
    "export",
    (
        "ccm-opt export runs/swan-neck --format urdf --out arm.urdf",
        "ccm-opt export runs/swan-neck --format yaml --bends-only --out trajectory.yaml",
        "ccm-opt export runs/swan-neck --format glb --out motion.glb",
    ),
)
def export_command(
    folder: Annotated[Path, typer.Argument(help="Folder that solve wrote.", show_default=False)],
    *,
    kind: Annotated[ExportFormat, typer.Option("--format", help="Format.")],
    out: Annotated[Path | None, typer.Option(help="File to write.", show_default="standard output")] = None,
    bends_only: Annotated[
        bool,
        typer.Option("--bends-only", help="Leave out the two revolutes of a ball that stay at 0 in the plane."),
    ] = False,
    no_scene: Annotated[bool, typer.Option("--no-scene", help="Leave the obstacles out of URDF and MJCF.")] = False,
    effort: Annotated[
        bool, typer.Option("--effort", help="Write efforts into yaml; controllers from ROS 2 Humble on refuse them.")
    ] = False,
) -> int:
    """Write the arm, its surroundings or the motion of a written plan for other programs."""
    from ccm_opt.cli.exporting import ExportOptions, export_folder  # noqa: PLC0415 - loads numpy

    return export_folder(folder, ExportOptions(kind, out, bends_only, not no_scene, effort))


@command(
    app,
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
        typer.Option(help="What to draw; mp4 needs ffmpeg. May be repeated.", show_default="all still figures"),
    ] = None,
    figure_format: FigureFormatOption = "png",
    out: Annotated[Path | None, typer.Option(help="Folder of the pictures.", show_default="the plan's")] = None,
) -> int:
    """Draw written plans: the motion, its curvatures, its steps, the jointed arm, the simulated arm in space."""
    from ccm_opt.cli.drawing import DrawOptions, draw_folders  # noqa: PLC0415 - loads numpy

    return draw_folders(folders, DrawOptions(figure or (), figure_format, out))
