"""The drawing of problems/jobs/turbine-stages.toml: a row of vanes and a row of blades, unrolled at mid-height.

An aerofoil is a parabolic camber line from the angle at which the gas comes to that at which it leaves, and about it a
thickness that is round at the nose and ends in an edge of its own. Nothing of it is an engine's own geometry; only what
an arm has to pass matters here: how the passages turn, and how narrow they get. Run it with a folder for the drawing::

    python examples/09_draw_turbine_stages.py problems/jobs
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import ezdxf
import numpy as np
from numpy.typing import NDArray

MILLIMETRES = 4  # of the header's $INSUNITS


@dataclass(frozen=True)
class Row:
    """Equal aerofoils, one above the other.

    Attributes:
        layer: that they are drawn on, and named after.
        front: axial place of their noses [mm].
        chord: axial length [mm].
        pitch: from one to the next [mm].
        inlet: angle of the camber line at the nose [deg].
        outlet: at the trailing edge [deg].
        thickness: largest [mm].
        edge: thickness of the trailing edge [mm].
        count: number of aerofoils.
        offset: height of the lowest nose [mm].
    """

    layer: str
    front: float
    chord: float
    pitch: float
    inlet: float
    outlet: float
    thickness: float
    edge: float
    count: int
    offset: float


ROWS = (
    Row("vane", 40.0, 70.0, 62.0, 0.0, -58.0, 13.0, 2.0, 5, -110.0),
    Row("blade", 136.0, 48.0, 50.0, -35.0, 45.0, 9.0, 2.0, 7, -240.0),
)


def aerofoil(row: Row, stations: int = 24) -> NDArray[np.float64]:
    """Outline of one aerofoil about its nose, shape (points, 2) [mm]."""
    share = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, stations)))
    first, last = np.tan(np.deg2rad((row.inlet, row.outlet)))
    camber = row.chord * (first * share + 0.5 * (last - first) * share**2)
    turned = np.arctan(first + (last - first) * share)
    # Round at the nose, thickest at a third, straight to the edge.
    half = 0.5 * row.thickness * np.sqrt(3.0 * share) * (1.0 - share) * 1.5 + 0.5 * row.edge * share
    along = np.stack((row.chord * share, camber), axis=1)
    across = half[:, None] * np.stack((-np.sin(turned), np.cos(turned)), axis=1)
    return np.concatenate((along + across, (along - across)[:0:-1]))


def main() -> None:
    """Draw every aerofoil as a closed polyline on the layer of its row."""
    drawing = ezdxf.new("R2010")
    drawing.header["$INSUNITS"] = MILLIMETRES
    space = drawing.modelspace()
    for row in ROWS:
        drawing.layers.add(row.layer)
        for k in range(row.count):
            points = aerofoil(row) + np.array([row.front, row.offset + k * row.pitch])
            space.add_lwpolyline(points.round(2).tolist(), close=True, dxfattribs={"layer": row.layer})
    file = Path(sys.argv[1]) / "turbine-stages.dxf"
    drawing.saveas(file)
    print(f"{file}: {sum(row.count for row in ROWS)} aerofoils in {len(ROWS)} rows")


if __name__ == "__main__":
    main()
