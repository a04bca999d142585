"""Pictures of a scene: frames by `Renderer`, with a rasteriser, rays or OpenGL; films; time-lapse pictures."""

from .drawing import ColorScale, Drawing
from .dressing import particles_of, uncovered
from .film import FILM_FORMATS, check_formats, write_film
from .framing import framed
from .legend import legends, ramp
from .onscreen import OnScreen, Orbit
from .opengl_window import no_display
from .parts import Obstacle, Part, Tubes
from .renderer import Renderer, no_opengl, picture_size
from .sheets import divided
from .stage import Camera, Stage, visible
from .timelapse import exposure, timelapse
from .warp_renderers import Passes, RayCaster
