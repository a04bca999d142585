"""Pictures of a scene: `Renderer` draws frames, by OpenGL or ray casting; films; several poses in one."""

from .drawing import Drawing, PlacedPart, Scale
from .film import FILM_FORMATS, check_formats, write_film
from .legend import bar
from .onscreen import OnScreen
from .opengl_window import ADVICE, no_display
from .renderer import Renderer, no_opengl
from .stage import VIEW_ANGLE, Stage, outermost
from .timelapse import timelapse

__all__ = [
    "ADVICE",
    "FILM_FORMATS",
    "VIEW_ANGLE",
    "Drawing",
    "OnScreen",
    "PlacedPart",
    "Renderer",
    "Scale",
    "Stage",
    "bar",
    "check_formats",
    "no_display",
    "no_opengl",
    "outermost",
    "timelapse",
    "write_film",
]
