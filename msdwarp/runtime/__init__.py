"""How this process uses Warp: its start and messages, recorded graphs, and one thread at a time."""

from .kernel_cache import Compiling as Compiling
from .machine import cores as cores, find_device as find_device
from .messages import start_warp as start_warp, verbose as verbose
from .recording import CAPTURE_LOCK as CAPTURE_LOCK, record as record
from .rehearsal import ImaginedGpu as ImaginedGpu, rehearsing as rehearsing
from .turns import (
    ReleasedInTurn as ReleasedInTurn,
    asked as asked,
    calling as calling,
    completing as completing,
    exclusive as exclusive,
    in_turn as in_turn,
    stop_if_asked as stop_if_asked,
)
