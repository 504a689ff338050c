"""In which order candidates are tried: the most promising first, or as a seed draws it."""

from collections.abc import Iterable, Iterator

import numpy as np

from ccm_opt.motion.guide_candidate import GuideCandidate


def drawn_order(candidates: Iterable[GuideCandidate], seed: int, put_off: float) -> Iterator[GuideCandidate]:
    """All candidates, some of them later than their turn.

    The first candidate that arrives decides which motion is optimised, but another may end in a better one. A seed puts
    every candidate off with some probability until all others have been tried, so that early ones still come early.

    Args:
        candidates: the most promising first.
        seed: of what is drawn; 0 draws nothing.
        put_off: the probability.
    """
    if seed == 0:
        yield from candidates
        return
    rng = np.random.default_rng(seed)
    later: list[GuideCandidate] = []
    for candidate in candidates:
        if rng.random() < put_off:
            later.append(candidate)
        else:
            yield candidate
    yield from later
