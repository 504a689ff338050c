"""Arguments and options that several commands have."""

from pathlib import Path
from typing import Annotated

import typer

from ccm_opt.cli.choices import FigureKind

ProblemFiles = Annotated[
    list[Path],
    typer.Argument(help="Problem files; - stands for standard input.", metavar="FILE…", show_default=False),
]
FigureFormatOption = Annotated[FigureKind, typer.Option(help="Format of still pictures.")]
Constraints = Annotated[
    list[str] | None, typer.Option(help="User constraint, as module:function or file.py:function. May be repeated.")
]
Costs = Annotated[
    list[str] | None, typer.Option(help="User cost, as module:function or file.py:function. May be repeated.")
]
Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Set a key of the problem files, as in arm.radius=0.02. May be repeated."
    ),
]
Folders = Annotated[list[Path], typer.Argument(help="Folders that solve wrote.", metavar="FOLDER…", show_default=False)]
