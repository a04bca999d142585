"""Live: a simulation that people look at and handle as it runs, in a window or a browser."""

from .browser import Browser
from .handling import Handling, Repeat, within_reach
from .keys import KEYS, listed
from .notebook import show
from .opening import screen_for, view
from .recording import DEEDS, FIRST_FRAME, read_deeds
from .sources import Played, Running, Source
from .view import Screen, View
from .window import Window

__all__ = [
    "DEEDS",
    "FIRST_FRAME",
    "KEYS",
    "Browser",
    "Handling",
    "Played",
    "Repeat",
    "Running",
    "Screen",
    "Source",
    "View",
    "Window",
    "listed",
    "read_deeds",
    "screen_for",
    "show",
    "view",
    "within_reach",
]
