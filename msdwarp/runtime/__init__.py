"""How this process uses Warp: its start and messages, recorded graphs, one thread at a time; and guessed names."""

from .compile_ahead import THREADS, Job, Kernels, compile_all
from .guesses import did_you_mean, guide, no_attribute, parameter_meant
from .kernel_cache import Compiling
from .machine import cores, find_device
from .messages import start_warp, verbose
from .recording import CAPTURE_LOCK, record
from .rehearsal import ImaginedGpu, rehearsing
from .turns import (
    ReleasedInTurn,
    asked,
    calling,
    completing,
    exclusive,
    handling,
    in_main_thread,
    in_turn,
    stop_if_asked,
)
