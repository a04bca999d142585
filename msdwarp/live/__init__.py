"""Live: interactive views of a running simulation, in a window or a browser."""

from .browser import Browser
from .handling import Handling, within_reach
from .keys import KEYS
from .notebook import film, show
from .opening import view
from .recording import FIRST_FRAME, read_deeds
from .sources import Played, Running, Source
from .state import Screen
from .view import View
from .window import Window
