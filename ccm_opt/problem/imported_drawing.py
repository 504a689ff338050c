"""What became of a drawing whose obstacles a problem has: how many, how large and where, and what was left out."""

from dataclasses import dataclass

from ccm_opt.ground.length_words import file_length

ODD_RATIO = 100.0
"""Drawings this much larger or smaller than the arm are taken for mistakes of scale. Derived: millimetres in place of
metres are a factor of a thousand, and of drawings that fit their arm none is ten times smaller or larger than it."""


@dataclass(frozen=True)
class LeftOut:
    """Something in a drawing that became no obstacle.

    Attributes:
        what: its kind and, where it has one, its name, for example ``text 'title'``.
        reason: why, for example ``texts are no obstacles``.
    """

    what: str
    reason: str


@dataclass(frozen=True)
class ImportedDrawing:
    """What was read from a drawing.

    Attributes:
        file: its name.
        obstacles: how many obstacles it gave.
        box: least x and y and greatest x and y of them all, as they are placed in the workspace, shape (4,) [m].
        layers: names of layers, or of the outermost named groups, with the number of obstacles on each; empty where
            the drawing has none.
        left_out: everything that became no obstacle, in the order of the drawing.
        unit: of length that the drawing names, which counts for nothing beside the scale; empty where it names none.
    """

    file: str
    obstacles: int
    box: tuple[float, float, float, float]
    layers: tuple[tuple[str, int], ...] = ()
    left_out: tuple[LeftOut, ...] = ()
    unit: str = ""

    @property
    def extent(self) -> float:
        """The longer side of the box [m]."""
        xmin, ymin, xmax, ymax = self.box
        return max(xmax - xmin, ymax - ymin)

    def odd_size(self, arm_length: float) -> str | None:
        """A warning where the drawing is so much larger or smaller than the arm that its scale must be wrong.

        Args:
            arm_length: length of the arm [m].
        """
        ratio = self.extent / arm_length
        if ODD_RATIO**-1 < ratio < ODD_RATIO:
            return None
        larger = ratio > 1.0
        times = f"{ratio if larger else 1.0 / max(ratio, 1e-300):.3g} times {'larger' if larger else 'smaller'}"
        return (
            f"the obstacles of {self.file} are {times} than the arm is long: {file_length(self.extent)} against "
            f"{file_length(arm_length)}; is workspace.scale the length of one unit of the drawing? (0.001 "
            "where the drawing is in millimetres and the file in metres)"
        )
