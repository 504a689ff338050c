"""What options of the command line accept, known without loading what they choose between."""

from enum import StrEnum
from typing import Literal, TypeAlias

MethodChoice: TypeAlias = Literal["nlp", "hill-climbing"]
"""Of ``solve --method``: the names of ``planner.method``."""
ControllerChoice: TypeAlias = Literal["computed-torque", "pd"]
"""Of ``simulate --controller``: the names of ``simulation.controller``."""
ExportFormat: TypeAlias = Literal["urdf", "mjcf", "yaml", "csv", "npz", "glb"]
"""Of ``export --format``."""
FigureKind: TypeAlias = Literal["png", "svg", "pdf"]
"""Of ``--figure-format``."""


class FigureName(StrEnum):
    """Of ``draw --figure``, which may be repeated: Typer reads lists of enumerations, not of literals."""

    PLAN = "plan"
    CURVES = "curves"
    STEPS = "steps"
    LINKS = "links"
    SPACE = "space"
    GIF = "gif"
    MP4 = "mp4"
