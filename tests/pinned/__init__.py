"""What every function of proofs and verifier returned in made-up scenes when its laws were last looked at.

Laws and oracles say what is right; they let through what only costs time or is a little too strict, and what none of
them happens to ask for. Here no figure changes unnoticed. Whoever means a figure to change looks at what did, and then
writes them anew: ``python -m tests.pinned``.
"""

import json
from pathlib import Path

FIGURES = Path(__file__).parents[1] / "data" / "pinned.json"
"""By scene and function."""


def read_figures() -> dict[str, dict[str, tuple[int, int, float, float]]]:
    """The figures as they were written."""
    scenes = json.loads(FIGURES.read_text(encoding="utf-8"))
    return {name: {key: tuple(values) for key, values in figures.items()} for name, figures in scenes.items()}
