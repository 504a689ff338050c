"""Families of scenes drawn around a witness: among bodies that stand about."""

import numpy as np

from ccm_opt.scene.bodies import Body, BoxBody, CapsuleBody, CylinderBody, RigidPlacement, SphereBody

from .space_shapes import ORIGIN, Route, box, unit
from .witness_drawing import Drawing
from .witness_motions import meander

Z = np.eye(3)[2]


def cables(scene: Drawing) -> None:
    """Through a forest of thin cables."""
    scene.length = float(scene.rng.uniform(0.8, 1.0))
    scene.go(meander(scene.rng, scene.lead(), 0.95 * scene.length, scene.bend()))
    scene.strew(lambda: scene.bar(0.5, 1.0, 0.002), "cable", int(scene.rng.integers(90, 150)))


def engine(scene: Drawing) -> None:
    """Among the boxes, cylinders and pipes of an engine bay."""
    rng = scene.rng
    scene.length = float(rng.uniform(0.9, 1.2))
    if rng.uniform() < 0.5:
        scene.go(meander(rng, scene.lead(), 0.9 * scene.length, 1.2 * scene.bend()))
    else:
        scene.poses(4.0)
    scene.strew(lambda: scene.block(0.08, 0.25), "unit", 12)
    scene.strew(lambda: _cylinder(scene), "canister", 8)
    scene.strew(lambda: scene.bar(0.3, 0.8, float(rng.uniform(0.008, 0.02))), "line", 25)


def _cylinder(scene: Drawing) -> CylinderBody:
    half = 0.5 * float(scene.rng.uniform(0.1, 0.3)) * unit(scene.rng.normal(size=3))
    return CylinderBody(-half, half, float(scene.rng.uniform(0.03, 0.08)))


def weave(scene: Drawing) -> None:
    """Out of a tangle of bars into another one; the base is fixed."""
    scene.length, scene.radius = 1.0, 0.012
    scene.poses(5.0)
    scene.strew(lambda: scene.bar(0.2, 0.8, 0.006), "bar", int(scene.rng.integers(70, 120)))
    half = 0.5 * np.array([0.006, 0.12, 0.12])
    scene.strew(
        lambda: BoxBody(-half, half, RigidPlacement.of_quaternion(ORIGIN, scene.rng.normal(size=4))), "slat", 35
    )


def shapes(scene: Drawing) -> None:
    """Among boxes, balls, cylinders and meshes; the base is fixed."""
    rng = scene.rng
    scene.length, scene.radius = 1.0, 0.014
    scene.poses(4.0)
    scene.strew(lambda: scene.block(0.05, 0.2), "box", 15)
    scene.strew(lambda: SphereBody(ORIGIN, float(rng.uniform(0.03, 0.1))), "ball", 12)
    scene.strew(lambda: _cylinder(scene), "can", 6)
    scene.strew(lambda: scene.jagged(float(rng.uniform(0.1, 0.25))), "ring", 8)


def rack(scene: Drawing) -> None:
    """Between two shelves of a rack and among what stands there."""
    rng = scene.rng
    scene.length = float(rng.uniform(0.9, 1.1))
    if rng.uniform() < 0.5:
        route = meander(rng, scene.lead(), 0.9 * scene.length, scene.bend())
        route = Route(route.places * [1.0, 1.0, 0.25])
        swept = scene.go(route)
    else:
        swept = scene.poses(3.5, flat=0.15)
    low, high = (float(each(swept.points[:, 2])) for each in (np.min, np.max))
    margin = scene.radius + scene.room()
    scene.bodies |= {
        "shelf below": box([0.1, -0.8, low - margin - 0.01], [1.2, 0.8, low - margin]),
        "shelf above": box([0.1, -0.8, high + margin], [1.2, 0.8, high + margin + 0.01]),
    }
    tall = 0.5 * (high - low) + margin

    def standing() -> Body:
        half = np.array([*rng.uniform(0.02, 0.08, 2), tall])
        if rng.uniform() < 0.5:
            return CylinderBody(-half[2] * Z, half[2] * Z, half[0])
        return BoxBody(-half, half)

    tries = [swept.beside(rng, standing(), scene.room()) for _ in range(60)]
    goods = [each.moved(np.array([0.0, 0.0, 0.5 * (low + high) - each.middle[2]])) for each in tries if each]
    kept = [each for each in goods if swept.gap(each) > 0.0045][:14]
    scene.bodies |= {f"unit {k}": each for k, each in enumerate(kept)}


def keyhole(scene: Drawing) -> None:
    """Through a hole of a plate, and beyond it among bars."""
    rng = scene.rng
    scene.length, scene.radius = 1.0, 0.012
    if rng.uniform() < 0.5:
        route = meander(rng, scene.lead(), 0.9 * scene.length, 1.1 * scene.bend())
        swept = scene.go(route)
        place, way = route.at(np.array([0.3, 0.301]))
        way = unit(way - place)
    else:
        swept = scene.poses(4.0, common=0.3)
        chain = swept.chains[0]
        k = max(1, int(0.2 * scene.links))
        place, way = 0.5 * (chain[k] + chain[k + 1]), unit(chain[k + 1] - chain[k])
    scene.plate("plate", place, way, swept, 0.4)
    scene.strew(lambda: scene.bar(0.2, 0.6, 0.008), "bar", 25)


def truss(scene: Drawing) -> None:
    """Among the struts of a space frame."""
    rng = scene.rng
    scene.length = float(rng.uniform(0.9, 1.2))
    if rng.uniform() < 0.5:
        swept = scene.go(meander(rng, scene.lead(), 0.9 * scene.length, scene.bend()))
    else:
        swept = scene.poses(4.0)
    apart = float(rng.uniform(0.16, 0.22))
    low, high = swept.points.min(axis=0) - 0.5 * apart, swept.points.max(axis=0) + apart
    low[0] = max(low[0], -0.3)
    steps = [np.arange(a, b, apart) for a, b in zip(low, high, strict=True)]
    nodes = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
    nodes += rng.uniform(-0.02, 0.02, nodes.shape)
    pairs = np.argwhere(np.triu(np.linalg.norm(nodes[:, None] - nodes, axis=2) < 1.55 * apart, 1))
    rng.shuffle(pairs)
    bars = [CapsuleBody(nodes[i], nodes[j], 0.007) for i, j in pairs]
    near = [each for each in bars if scene.room() < swept.gap(each) < 0.2][:250]
    scene.bodies |= {f"strut {k}": each for k, each in enumerate(near)}
