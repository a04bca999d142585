"""How this process uses Warp: its start and messages, and threads' turns with it."""

from .messages import start_warp, verbose
from .turns import in_turn

__all__ = ["in_turn", "start_warp", "verbose"]
