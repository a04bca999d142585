"""Browser: a page that shows a view and has its buttons, sliders and keys, served by viser."""

import io
import logging
import math
import socket
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..bodies import in_space
from ..pictures import VIEW_ANGLE, Stage
from .access import EVERYWHERE, Access
from .event_loop import wake_from_any_thread
from .guard import guarded
from .images import Images, Links
from .panel import Panel
from .patches import LEVELS, Patch, compact, levels, patches, scale_colours

if TYPE_CHECKING:
    from .view import View

HOST, PORT = "127.0.0.1", 8080
"""Where the page is by default: seen from this machine alone."""
BOX = np.array(
    [
        *([0, 2, 3], [0, 3, 1], [4, 5, 7], [4, 7, 6], [0, 1, 5], [0, 5, 4]),
        *([2, 6, 7], [2, 7, 3], [0, 4, 6], [0, 6, 2], [1, 3, 7], [1, 7, 5]),
    ],
    np.uint32,
)
"""Triangles of a box whose corner k is at the high end of axis a if bit a of k is set."""
SIZE = (1280, 720)
"""Width and height that the camera is placed for."""
WORTH = 10_000
"""Vertices from which on an image is smaller than what it shows."""
MOST_WAITING = 20
"""Commands that wait for the view, from which on messages wait at their senders."""
LATE, OFTEN = 1.0, 3
"""So late [s] so often in a row, and a link does not keep up."""
MISSING = "the page needs viser: pip install 'msdwarp[view]'"


class Browser:
    """A page that shows a view; a `Screen`.

    Parameters
    ----------
    host
        The address that the page is served at; 127.0.0.1 is seen from this machine alone.
    port
        The port; by default 8080, or the next that is free.
    allow_origin
        Origins of other pages that may control this one, such as "https://lab.example".

    Raises
    ------
    ValueError
        If viser is not installed or cannot be guarded, the port is taken or out of range, or an origin is none.
    """

    takes_images = True

    def __init__(self, host: str = HOST, port: int | None = None, allow_origin: Sequence[str] = ()) -> None:
        try:
            import viser
        except ImportError as error:
            raise ValueError(MISSING) from error
        if port is not None and not 1 <= checks.count("port", port, 1) <= 65535:
            raise ValueError(f"port is {port}; it must be from 1 to 65535")
        if port is not None and _is_taken(host, port):
            raise ValueError(f"port is {port}, which another program listens on; choose another or leave it out")

        self._access = Access(host, allow_origin)
        self._waiting: Callable[[], int] = lambda: 0
        self._server: Any = None

        # Who sends garbage is hung up on, which is no news to whoever runs this.
        logging.getLogger("websockets").setLevel(logging.CRITICAL)

        class Server(viser.ViserServer):
            def request_share_url(self, verbose: bool = True) -> str | None:
                """Refuse: viser would make the page public."""
                return None

        try:
            # It prints addresses whatever it is told.
            with guarded(self._access, lambda: self._waiting() >= MOST_WAITING), redirect_stdout(io.StringIO()):
                self._server = Server(host, PORT if port is None else port, label="msdwarp", verbose=False)
        except ValueError:
            self.close()
            raise
        wake_from_any_thread(self._server)  # the view's thread is not the one that sends
        self.host, self.port = host, self._server.get_port()
        self._panel = Panel(self._server)
        self._patches: list[tuple[Any, Patch]] = []
        self._levels: dict[int, Any] = {}
        self._fixed: list[Any] = []
        self._scene: Any = None
        self._links, self._images = Links(self._server), None
        self._images: Images | None

    @property
    def address(self) -> str:
        """Where the page is, with the token that it needs."""
        name = socket.gethostname() if self.host in EVERYWHERE else self.host
        address = f"http://{f'[{name}]' if ':' in name else name}:{self.port}"
        return address if self._access.token is None else f"{address}/?token={self._access.token}"

    @property
    def watched(self) -> bool:
        """Whether a page is open."""
        return bool(self._server.get_clients())

    def open(self, view: "View") -> None:
        """Begin."""
        self._view, self._waiting = view, lambda: view.waiting
        self._server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(217, 96, 59))
        self._server.scene.set_up_direction("+z")
        self._panel.open(view)

    def stage(self) -> None:
        """Show another scene, or the same drawn in another way."""
        view, scene = self._view, self._server.scene
        drawing = view.shown.drawing
        if view.source is not self._scene:
            seen = view.source.seen()
            self._stage = Stage(view.source.scene, view.source.frame().position if seen is None else seen, SIZE)
        with self._server.atomic():
            for node in [*self._fixed, *(node for node, _ in self._patches), *self._levels.values()]:
                node.remove()
            self._fixed, self._patches, self._levels = [], [], {}
            stage = self._stage
            self._set_camera(stage)
            self._clear_images()
            if view.images:
                self._images = Images(drawing, stage)
                self._box = self._mesh("/box", *self._box_around(), (255, 255, 255), opacity=0.0)
                self._fixed.append(self._box)
            else:
                self._add_patches()
                self._lay_ground(stage)
            line = np.zeros((1, 2, 3), np.float32)
            self._pull: Any = scene.add_line_segments("/pull", line, (30, 30, 30), visible=False)
            self._fixed.append(self._pull)
        self._panel.stage()

    def _add_patches(self) -> None:
        """Show the body and the obstacles as triangles."""
        drawing = self._view.shown.drawing
        points: Any = drawing.points.numpy()
        for k, patch in enumerate(patches(drawing)):
            node = self._mesh(f"/patch/{k}", patch.points(points), patch.faces, patch.colour)
            if patch.moves:
                self._patches.append((node, patch))
            else:
                self._fixed.append(node)

    def _clear_images(self) -> None:
        """Have no image behind what is shown."""
        if self._images is not None:
            for client in self._server.get_clients().values():
                client.scene.set_background_image(None)
        self._images = None

    def _lay_ground(self, stage: Stage) -> None:
        """Lay the ground where pictures have it."""
        ground = stage.ground
        if ground is None:
            return
        self._fixed.append(
            self._server.scene.add_grid(
                "/ground",
                infinite_grid=True,
                cell_size=ground.tile,
                section_size=5 * ground.tile,
                cell_thickness=0.4,
                section_thickness=0.8,
                cell_color=(214, 216, 220),
                section_color=(190, 194, 200),
                fade_distance=2 * ground.half,
                plane_color=_bytes(checks.colour("ground", stage.look.ground)),
                plane_opacity=1.0,
                shadow_opacity=0.3,
                plane="xy",
                wxyz=_turn_to(ground.normal),
                position=tuple(ground.centre),
            )
        )

    def _set_camera(self, stage: Stage) -> None:
        """Place the camera as pictures do, where the scene is another one."""
        view, server, camera = self._view, self._server, stage.camera
        if view.source is self._scene:
            return
        self._scene = view.source
        # The body may move about, and the panel covers a part: the camera stands further off than in pictures.
        eye, opening = camera.target + 1.8 * (camera.eye - camera.target), math.radians(VIEW_ANGLE)
        first = server.initial_camera
        first.position, first.look_at, first.up = tuple(eye), tuple(camera.target), (0.0, 0.0, 1.0)
        first.fov = opening
        for client in server.get_clients().values():
            client.camera.fov = opening
            client.camera.position, client.camera.look_at = eye, camera.target

    def show(self) -> None:
        """Show the frame that the drawing follows now."""
        view = self._view
        with self._server.atomic():
            if self._images is None:
                self._show_triangles()
            else:
                self._images.follow()
                self._box.vertices = self._box_around()[0]
            held = view.hand.grip
            self._pull.visible = held is not None
            if held is not None and view.shown.frame is not None:
                here = held.here(view.shown.frame.position)
                self._pull.points = np.array([[here, view.hand.target]], dtype=np.float32)
        self._server.flush()
        if self._images is None:
            self._look_for_slow()

    def _show_triangles(self) -> None:
        drawing = self._view.shown.drawing
        points: Any = drawing.points.numpy()
        for node, patch in self._patches:
            node.vertices = patch.points(points)
        if drawing.colours_move:
            self._show_levels(points)

    def _box_around(self) -> tuple[np.ndarray, np.ndarray]:
        """Return vertices and triangles of a box around the body: behind images it is what the mouse finds."""
        frame = self._view.source.frame() if self._view.shown.frame is None else self._view.shown.frame
        points = in_space(frame.position, np.float32)
        ends = points.min(axis=0), points.max(axis=0)
        corners = [[ends[k >> axis & 1][axis] for axis in range(3)] for k in range(8)]
        return np.array(corners, np.float32), BOX

    def _show_levels(self, points: np.ndarray) -> None:
        """Show the body in the colours of its values: the triangles of each level as a mesh of their own."""
        drawing = self._view.shown.drawing
        colours, seen = scale_colours(drawing), set()
        for level, triangles in levels(drawing):
            corners, faces = compact(triangles)
            seen.add(level)
            node = self._levels.get(level)
            if node is None:
                colour = _bytes(colours[level])
                self._levels[level] = self._mesh(f"/level/{level}", points[corners], faces, colour)
            else:
                node.vertices, node.faces, node.visible = points[corners], faces, True
        for level in range(LEVELS):
            if level not in seen and level in self._levels:
                self._levels[level].visible = False

    def _mesh(
        self,
        name: str,
        points: np.ndarray,
        faces: np.ndarray,
        colour: tuple[int, int, int],
        opacity: float | None = None,
    ) -> Any:
        """Add triangles that the mouse can take hold of; with an opacity, of what is drawn in an image."""
        seen, view = opacity is None, self._view
        node = self._server.scene.add_mesh_simple(
            name, points, faces, color=colour, side="double", opacity=opacity, cast_shadow=seen
        )

        async def drag(event: Any) -> None:  # asynchronous: these keep their order
            holder = event.client_id
            if event.phase == "start" and seen:
                view.post("grab", holder=holder, point=event.start_position)
            elif event.phase == "start":
                origin, direction, _ = _ray(event.client.camera, event.start_position)
                view.post("pick", holder=holder, origin=origin, direction=direction)
            elif event.phase == "end":
                view.post("let_go", holder=holder)
                return
            if seen:
                view.post("drag", holder=holder, point=event.end_position)
            else:
                view.post("drag", holder=holder, ray=_ray(event.client.camera, event.end_position))

        if view.source.handling is not None:
            node.on_drag("left")(drag)
        return node

    def tell(self) -> None:
        """Show what is written, and where sliders stand."""
        self._panel.tell()

    def poll(self) -> bool:
        """Return that the page is there: it is until the view ends. Images are sent to whom can take one."""
        if self._images is not None:
            self._images.send(self._links.now())
        return True

    def _look_for_slow(self) -> None:
        """Have the view send images where triangles come late again and again."""
        vertices = sum(len(patch.corners) for _, patch in self._patches)
        if vertices + len(self._view.shown.drawing.points) < WORTH:
            return
        for _, _, link in self._links.now():
            if link.busy:  # who never answers, such as a laptop that sleeps, does not decide for others
                continue
            link.late = link.late + 1 if link.delay >= LATE else 0
            if link.late == OFTEN:
                self._view.post("slow")
            link.ask()

    def close(self) -> None:
        """End: the page is gone. It may be called again."""
        if self._server is not None:
            with redirect_stdout(io.StringIO()):
                self._server.stop()


def _is_taken(host: str, port: int) -> bool:
    """Tell whether a port cannot be listened on."""
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError:
            return True
    return False


def _ray(camera: Any, point: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the ray from a camera through a point: origin [m], direction, and the way into the screen."""
    ahead, way = camera.look_at - camera.position, np.asarray(point) - camera.position
    return camera.position, way / np.linalg.norm(way), ahead / np.linalg.norm(ahead)


def _bytes(colour: Any) -> tuple[int, int, int]:
    red, green, blue = (round(255 * float(one)) for one in colour)
    return red, green, blue


def _turn_to(normal: np.ndarray) -> tuple[float, float, float, float]:
    """Return the quaternion (w, x, y, z) that turns the z axis to a unit vector."""
    w, axis = 1.0 + float(normal[2]), np.array([-normal[1], normal[0], 0.0])
    if w < 1e-9:
        return 0.0, 1.0, 0.0, 0.0
    four = np.array([w, *axis]) / np.linalg.norm([w, *axis])
    return tuple(float(one) for one in four)  # type: ignore[return-value]
