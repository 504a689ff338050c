"""Sag and certificate: why the hull of a link's end positions, grown by the sag, holds the link between two keyframes.

The figure draws one link over one interval of a motion, first whole and then halved, and says what the certificate
says of it.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ccm_opt.core.arrays import FloatArray
from ccm_opt.scene.certificate import Certificate
from ccm_opt.viz import figure_files as style
from ccm_opt.viz.arm_drawing import polygon_patch
from concept_pictures.panels import FREE_EDGE, SMALL, draw_obstacles, look_at, panels, picture, title

HEIGHT = 2.75
SAMPLES = 101
"""Poses between the keyframes from which the true path is drawn."""


@dataclass(frozen=True)
class SagScene:
    """One interval of a motion beside an obstacle.

    Attributes:
        certificate: of the arm among the obstacles.
        start: link headings at the interval's start, shape (links,) [rad].
        end: at its end, shape (links,) [rad].
        link: the link that is drawn, counted from 0.
        box: part of the plane that is shown, xmin, ymin, xmax, ymax [m].
    """

    certificate: Certificate
    start: FloatArray
    end: FloatArray
    link: int
    box: tuple[float, float, float, float]

    def headings(self, u: FloatArray) -> FloatArray:
        """Link headings at path parameters in [0, 1], shape (k,) to (k, links) [rad]."""
        return self.start + u[:, None] * (self.end - self.start)

    def link_at(self, u: float) -> FloatArray:
        """The end points of the link at a path parameter, shape (2, 2) [m]."""
        points = self.certificate.arm.joint_positions(self.headings(np.array([u]))[0])
        return points[self.link : self.link + 2]

    def sag(self, before: float, after: float) -> float:
        """How far the link's outer joint may leave its chord between two path parameters [m]: ⅛ Σ l Δφ²."""
        turns = (after - before) * (self.end - self.start)[: self.link + 1]
        return float(self.certificate.arm.link_length * np.sum(turns**2) / 8.0)

    def hull(self, before: float, after: float) -> shapely.Polygon:
        """The hull of the link's end positions at two path parameters."""
        corners = np.vstack((self.link_at(before), self.link_at(after)))
        return shapely.Polygon(shapely.get_coordinates(shapely.convex_hull(shapely.MultiPoint(corners))))

    def proved(self, depth: int) -> bool:
        """Whether the certificate holds with a number of bisections."""
        return len(self.certificate.failures(self.certificate.arm.bends(np.stack((self.start, self.end))), depth)) == 0


def sag_png(scene: SagScene) -> bytes:
    """The picture of a scene as the content of a PNG file."""
    return picture(lambda: sag_figure(scene))


def sag_figure(scene: SagScene) -> Figure:
    """Three panels: chord and sag, the whole interval, both its halves."""
    figure, (chord, whole, halves) = panels(1, 3, HEIGHT)
    for axes in (chord, whole, halves):
        look_at(axes, scene.box)
        draw_obstacles(axes, scene.certificate.workspace)
    title(chord, "a", "off its chord by the sag at most")
    _draw_arm(chord, scene)
    _draw_paths(chord, scene)
    title(whole, "b", f"whole interval: {_verdict(scene, 0)}")
    _draw_proof(whole, scene, (0.0, 1.0))
    title(halves, "c", f"halved: {_verdict(scene, 1)}")
    _draw_proof(halves, scene, (0.0, 0.5, 1.0))
    handles = [*chord.get_legend_handles_labels()[0], *_keys(whole)]
    figure.legend(handles=handles, loc="outside lower left", ncols=4, frameon=False, fontsize=SMALL)
    return figure


def _verdict(scene: SagScene, depth: int) -> str:
    return "proved" if scene.proved(depth) else "not proved"


def _draw_arm(axes: Axes, scene: SagScene) -> None:
    """Both keyframes, the drawn link stronger than the others."""
    arm = scene.certificate.arm
    for headings, colour, name in (
        (scene.start, style.START_EDGE, "keyframe k"),
        (scene.end, style.GOAL_ARM, "keyframe k + 1"),
    ):
        points = arm.joint_positions(headings)[: scene.link + 2]
        axes.plot(points[:, 0], points[:, 1], color=colour, linewidth=1.1, marker="o", markersize=2.5, zorder=4)
        axes.plot(points[-2:, 0], points[-2:, 1], color=colour, linewidth=2.6, zorder=4, label=name)
    axes.plot(*arm.base, marker="s", markersize=5, color=style.BOUNDARY, zorder=8)


def _draw_paths(axes: Axes, scene: SagScene) -> None:
    """The true path of the link's outer joint, its chord, and the distance between them half-way."""
    u = np.linspace(0.0, 1.0, SAMPLES)
    tips = scene.certificate.arm.joint_positions(scene.headings(u))[:, scene.link + 1]
    axes.plot(tips[:, 0], tips[:, 1], color=style.TIP_PATH, linewidth=1.4, zorder=5, label="path of the joint")
    axes.plot(
        tips[[0, -1], 0], tips[[0, -1], 1], color=style.BOUNDARY, linewidth=1.0, linestyle=(0, (3, 2)), zorder=5,
        label="its chord",
    )  # fmt: skip
    middle = 0.5 * (tips[0] + tips[-1])
    half_way = tips[SAMPLES // 2]
    axes.plot((middle[0], half_way[0]), (middle[1], half_way[1]), color=style.BOUNDARY, linewidth=1.4, zorder=5.1)
    bound = r"$\leq \frac{1}{8}\,\Sigma\, l\,\Delta\varphi^2$"
    axes.text(middle[0] - 0.008, middle[1], bound, fontsize=SMALL + 1, ha="right", va="top", zorder=9)


def _draw_proof(axes: Axes, scene: SagScene, stations: tuple[float, ...]) -> None:
    """Hull and grown hull of every stretch, with the link at both its ends and the axis' poses in between."""
    arm = scene.certificate.arm
    workspace = scene.certificate.workspace
    need = arm.radius + workspace.clearance + scene.certificate.spare
    walls = shapely.union_all([obstacle.outline() for obstacle in workspace.obstacles])
    for before, after in pairwise(stations):
        hull = scene.hull(before, after)
        grown = shapely.buffer(hull, need + scene.sag(before, after), quad_segs=32)
        bad = shapely.intersects(grown, walls)
        edge = style.TIP_PATH if bad else style.GOAL_MARK
        axes.add_patch(polygon_patch(grown, facecolor=edge, edgecolor="none", alpha=0.10, zorder=2))
        axes.add_patch(polygon_patch(grown, facecolor="none", edgecolor=edge, linewidth=1.3, zorder=2.2))
        axes.add_patch(polygon_patch(hull, facecolor=style.FREE, edgecolor=FREE_EDGE, linewidth=0.9, zorder=2.4))
        if bad:
            overlap = shapely.intersection(grown, walls)
            for part in shapely.get_parts(overlap):
                axes.add_patch(polygon_patch(part, facecolor=style.TIP_PATH, edgecolor="none", zorder=2.6))
    for u in np.linspace(0.0, 1.0, 9):
        ends = scene.link_at(float(u))
        axes.plot(ends[:, 0], ends[:, 1], color=style.WALL_EDGE, linewidth=0.5, zorder=3)
    for u in stations:
        ends = scene.link_at(u)
        axes.plot(
            ends[:, 0], ends[:, 1], color=style.GOAL_ARM_EDGE, linewidth=1.6, marker="o", markersize=2.5, zorder=4
        )


def _keys(axes: Axes) -> list[Artist]:
    """Entries of the legend for the proofs."""
    grown = "hull grown by r + clearance + spare + sag"
    return [
        *axes.plot([], [], color=style.GOAL_ARM_EDGE, linewidth=1.6, label="link at the ends of a stretch"),
        *axes.plot([], [], color=style.WALL_EDGE, linewidth=0.5, label="link in between"),
        *axes.fill([], [], facecolor=style.FREE, edgecolor=FREE_EDGE, label="hull of its end positions"),
        *axes.fill([], [], facecolor="#e8f1ea", edgecolor=style.GOAL_MARK, label=grown),
    ]
