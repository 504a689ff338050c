"""How hard the verifier looks in space."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SpaceProofSettings:
    """Numbers of the proofs in space, beside those that both kinds of arm share.

    Attributes:
        block: intervals between samples that make the first stretches. Taste: a third of a second, in which an arm
            moves by about the room that it has.
        probes: moments at which the nearest surface is looked for first. Taste.
    """

    block: int = 64
    probes: int = 8


DEFAULT_SPACE_PROOF = SpaceProofSettings()
"""The numbers that are used unless others are given."""
