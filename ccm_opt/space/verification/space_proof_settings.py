"""How hard the verifier looks in space."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SpaceProofSettings:
    """Numbers of the proofs in space, beside those that both kinds of arm share.

    Attributes:
        block: intervals between samples that make the first stretches. Measured on the three jobs: with half as many
            pairs must be told apart from many more boxes, with twice as many from many more triangles.
        probes: moments at which the nearest surface is looked for first. Taste.
    """

    block: int = 32
    probes: int = 8


DEFAULT_SPACE_PROOF = SpaceProofSettings()
"""The numbers that are used unless others are given."""
