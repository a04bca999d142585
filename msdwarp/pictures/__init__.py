"""Pictures of a scene: `Renderer` draws frames by triangles, by rays or by OpenGL; films; several poses in one."""

from .drawing import ColourScale, Drawing
from .film import FILM_FORMATS, check_formats, write_film
from .legend import bar, ramp
from .onscreen import OnScreen
from .opengl_window import ADVICE, no_display
from .parts import Part
from .raycast import RayCaster
from .renderer import Renderer, no_opengl
from .stage import VIEW_ANGLE, Camera, Stage, outermost
from .timelapse import timelapse

__all__ = [
    "ADVICE",
    "FILM_FORMATS",
    "VIEW_ANGLE",
    "Camera",
    "ColourScale",
    "Drawing",
    "OnScreen",
    "Part",
    "RayCaster",
    "Renderer",
    "Stage",
    "bar",
    "check_formats",
    "no_display",
    "no_opengl",
    "outermost",
    "ramp",
    "timelapse",
    "write_film",
]
