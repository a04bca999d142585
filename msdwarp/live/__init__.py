"""Live: a simulation that people look at and handle as it runs, in a window or a browser."""

from .browser import Browser
from .handling import Handling, within_reach
from .keys import KEYS
from .notebook import show
from .opening import screen_for, view
from .recording import FIRST_FRAME, read_deeds
from .sources import Played, Running, Source
from .state import Screen
from .view import View
from .window import Window

__all__ = [
    "FIRST_FRAME",
    "KEYS",
    "Browser",
    "Handling",
    "Played",
    "Running",
    "Screen",
    "Source",
    "View",
    "Window",
    "read_deeds",
    "screen_for",
    "show",
    "view",
    "within_reach",
]
