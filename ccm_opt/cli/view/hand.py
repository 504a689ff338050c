"""What keyboards and gamepads of the viewer's pages ask of the tip, received over a WebSocket of its own."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from websockets.exceptions import ConnectionClosed

from ccm_opt.core.arrays import FloatArray

PATH = "/hand"
"""Path of the WebSocket, after that of the page."""
PATIENCE = 0.5
"""Longest time between messages of a page after which the arm is braked [s]. Heuristic: twelve of them."""
_LONGEST = 200
"""Longest message [characters]."""


@dataclass(frozen=True)
class Asked:
    """What a hand asks for.

    Attributes:
        hand: fractions of the greatest speed to the right, up, and away as seen by the camera, shape (3,).
        turns: whether the tip is to turn instead of moving.
    """

    hand: FloatArray = field(default_factory=lambda: np.zeros(3))
    turns: bool = False

    @classmethod
    def from_text(cls, text: object) -> "Asked":
        """Return what a message of the page asks for.

        Raises:
            ValueError: the message is malformed.
        """
        if not isinstance(text, str) or len(text) > _LONGEST:
            raise ValueError("expected a short text")
        data = json.loads(text)
        hand = np.array(data["hand"], dtype=np.float64)
        if hand.shape != (3,) or not np.all(np.abs(hand) <= 1.0):
            raise ValueError("expected three numbers from -1 to 1")
        return cls(hand / max(float(np.linalg.norm(hand)), 1.0), data["turns"] is True)


class Hands:
    """The hands at all pages that are open.

    Args:
        clock: function that returns the wall time [s].

    Attributes:
        driving: whether the arm is driven, which the pages are told.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.driving = False
        self._clock = clock
        self._last: dict[int, tuple[float, Asked]] = {}

    def asked(self) -> Asked | None:
        """Return what is asked for now, of several pages the most; None if no page has sent anything for too long."""
        now = self._clock()
        fresh = [asked for at, asked in tuple(self._last.values()) if now - at <= PATIENCE]
        return max(fresh, key=lambda asked: float(np.linalg.norm(asked.hand)), default=None)

    def hear(self, page: int, text: object) -> str:
        """Keep a message of a page, and return the answer to it.

        Args:
            page: number that tells pages apart.
            text: the message.

        Raises:
            ValueError: the message is malformed.
        """
        try:
            asked = Asked.from_text(text)
        except (KeyError, TypeError, RecursionError) as error:
            raise ValueError(f"malformed: {error}") from error
        self._last[page] = self._clock(), asked
        return "driving" if self.driving else "resting"

    async def serve(self, connection: Any) -> None:
        """Answer the messages of a page until it leaves, or sends one that is malformed."""
        page = id(connection)
        try:
            async for text in connection:
                await connection.send(self.hear(page, text))
        except ConnectionClosed:
            pass
        except ValueError:
            await connection.close(1003)
        finally:
            self._last.pop(page, None)
