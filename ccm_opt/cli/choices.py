"""What options of the command line accept, known without loading what they choose between."""

from typing import Literal, TypeAlias

MethodChoice: TypeAlias = Literal["nlp", "hill-climbing"]
"""Of ``solve --method``: the names of ``planner.method``."""
ControllerChoice: TypeAlias = Literal["computed-torque", "pd"]
"""Of ``simulate --controller``: the names of ``simulation.controller``."""
ExportFormat: TypeAlias = Literal["urdf", "mjcf", "yaml", "csv"]
"""Of ``export --format``."""
