"""How this process uses Warp: its start and messages, and threads' turns with it."""

from .messages import start_warp as start_warp, verbose as verbose
from .turns import in_turn as in_turn, release_in_turn as release_in_turn
