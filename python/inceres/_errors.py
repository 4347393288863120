"""What the package raises beyond ValueError, TypeError, OSError and RuntimeError."""

from __future__ import annotations

from typing import Any


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during a solve, which has ended with the best state so far.

    The graph or solver holds that state. ``summary`` is the solve's, and ``result`` is what
    bundle_adjust or optimize_pose_graph would have returned (None elsewhere).
    """

    def __init__(self, message: str, summary: dict[str, Any]) -> None:
        super().__init__(message)
        self.summary = summary
        self.result: Any = None


class SolveError(RuntimeError):
    """A solve without a usable result: the message says why, ``summary`` says all."""

    def __init__(self, summary: dict[str, Any]) -> None:
        causes = [summary["message"], summary.get("detail", "")]
        super().__init__(" ".join(cause for cause in causes if cause))
        self.summary = summary


def is_usable(summary: dict[str, Any]) -> bool:
    """Whether a solve has ended with a state worth keeping."""
    return summary["termination"] in ("CONVERGENCE", "NO_CONVERGENCE", "USER_SUCCESS")
