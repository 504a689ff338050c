"""Arguments and options that several commands have."""

import os
from pathlib import Path
from typing import Annotated

import typer

from ccm_opt.cli.choices import FigureKind


def listed_or_given(places: list[Path] | None) -> list[Path] | None:
    """Return the files that come with ccm-opt in the place of the names that `ccm-opt problems` lists them under."""
    if places is None or all(place.suffix or os.path.exists(place) or str(place) == "-" for place in places):  # noqa: PTH110 - see below
        return places
    from ccm_opt.cli.starting import listed_problems  # noqa: PLC0415 - loads numpy

    known = listed_problems()
    # Path.exists raises where a name is too long.
    return [place if os.path.exists(place) else known.get(place.as_posix(), place) for place in places]  # noqa: PTH110


ProblemFiles = Annotated[
    list[Path],
    typer.Argument(
        help="Problem files, or names that `ccm-opt problems` lists; - stands for standard input.",
        metavar="FILE…",
        show_default=False,
        callback=listed_or_given,
    ),
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
