"""Pictures of a scene: `Renderer` draws frames, by OpenGL or ray casting; films; several poses in one."""

from .drawing import Scale
from .film import FILM_FORMATS, check_formats, write_film
from .opengl_window import ADVICE
from .renderer import Renderer
from .stage import outermost
from .timelapse import timelapse

__all__ = ["ADVICE", "FILM_FORMATS", "Renderer", "Scale", "check_formats", "outermost", "timelapse", "write_film"]
