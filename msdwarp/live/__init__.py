"""Live: a simulation that people look at and handle as it runs, in a window or a browser."""

from .handling import Handling, Repeat, within_reach
from .keys import KEYS, listed
from .recording import DEEDS, read_deeds
from .sources import Played, Running, Source
from .view import Screen, View
from .window import Window

__all__ = [
    "DEEDS",
    "KEYS",
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
    "within_reach",
]
