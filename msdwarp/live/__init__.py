"""Live: interactive views of a running simulation, in a window or a browser."""

from .browser import Browser as Browser
from .handling import Handling as Handling, within_reach as within_reach
from .keys import KEYS as KEYS
from .notebook import show as show
from .opening import view as view
from .recording import FIRST_FRAME as FIRST_FRAME, read_deeds as read_deeds
from .sources import Played as Played, Running as Running, Source as Source
from .state import Screen as Screen
from .view import View as View
from .window import Window as Window
