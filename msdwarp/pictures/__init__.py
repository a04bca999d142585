"""Pictures of a scene: frames by `Renderer`, with a rasteriser, rays or OpenGL; films; time-lapse pictures."""

from .drawing import ColourScale as ColourScale, Drawing as Drawing
from .film import FILM_FORMATS as FILM_FORMATS, check_formats as check_formats, write_film as write_film
from .framing import framed as framed
from .legend import bar as bar, ramp as ramp
from .onscreen import OnScreen as OnScreen
from .opengl_window import no_display as no_display
from .parts import Part as Part
from .renderer import Renderer as Renderer, no_opengl as no_opengl, picture_size as picture_size
from .sheets import divided_triangle as divided_triangle
from .stage import Camera as Camera, Stage as Stage, visible as visible
from .timelapse import still as still, timelapse as timelapse
from .warp_renderers import RayCaster as RayCaster
