"""What the record of a problem in space says of it: the problem with the meshes that are kept beside, and of these."""

import hashlib

from ccm_opt.files.export.space_scene import kept_meshes, kept_names
from ccm_opt.files.problem_file.problem_data import Table
from ccm_opt.files.problem_file.space_problem_data import space_problem_data
from ccm_opt.space.problem import SpaceProblem
from ccm_opt.space.scene.bodies import MeshBody


def space_recorded_data(problem: SpaceProblem) -> Table:
    """The data of a problem in space; its meshes are those that the folder keeps."""
    return space_problem_data(problem, kept_names(problem))


def mesh_data(problem: SpaceProblem) -> list[dict[str, object]]:
    """Of every mesh where it is from, what it was, and where it is kept."""
    kept = kept_meshes(problem)
    return [
        {
            "obstacle": obstacle.name,
            "file": obstacle.body.file,
            "kept": name,
            "sha256": hashlib.sha256(kept[name]).hexdigest(),
            "triangles": len(obstacle.body.faces),
            "closed": obstacle.body.closed,
        }
        for obstacle, name in zip(problem.workspace.obstacles, kept_names(problem), strict=True)
        if isinstance(obstacle.body, MeshBody)
    ]
