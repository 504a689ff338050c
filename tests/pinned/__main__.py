"""``python -m tests.pinned`` writes the figures anew, and tells which of them are others than before."""

# ruff: noqa: T201 - it prints what it finds
import json
import sys

from tests.pinned import FIGURES, read_figures
from tests.pinned.recording import changed, figures_of
from tests.pinned.scenes import SCENES

NEXT_TO_ONE = (1.0 - 1e-12, 1.0 + 1e-12)
"""Lengths are multiplied by these: figures that change by more than a share of themselves then are rounding alone."""


def main() -> int:
    """Write the figures of all scenes."""
    old = read_figures() if FIGURES.exists() else {}
    written = {}
    for name, scene in SCENES.items():
        figures = figures_of(scene)
        for scale in NEXT_TO_ONE:
            for noisy in changed(figures, figures_of(scene, scale)):
                del figures[noisy]
        written[name] = {key: [a, b, float(f"{c:.11g}"), float(f"{d:.11g}")] for key, (a, b, c, d) in figures.items()}
        others = changed(old.get(name, {}), figures)
        print(f"{name}: {len(figures)} functions{', changed: ' if others else ''}{', '.join(others)}")
    lines = ",\n".join(
        f"{json.dumps(name)}: {{\n"
        + ",\n".join(f"{json.dumps(key)}: {json.dumps(values)}" for key, values in figures.items())
        + "}"
        for name, figures in written.items()
    )
    FIGURES.write_text(f"{{\n{lines}\n}}\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
