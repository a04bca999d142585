"""Browser: a page that shows a view and has its buttons, sliders and keys, served by viser."""

import io
import logging
import math
import socket
from contextlib import redirect_stdout
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import checks
from ..pictures import VIEW_ANGLE, Stage
from .panel import Panel
from .patches import LEVELS, Patch, compact, levels, patches, scale_colours

if TYPE_CHECKING:
    from .view import View

HOST, PORT = "127.0.0.1", 8080
"""Where the page is by default: seen from this machine alone."""
MISSING = "the page needs viser: pip install 'msdwarp[view]'"


class Browser:
    """A page that shows a view; a `Screen`.

    Parameters
    ----------
    host
        The address that the page is served at; 127.0.0.1 is seen from this machine alone.
    port
        The port; by default 8080, or the next that is free.

    Raises
    ------
    ValueError
        If viser is not installed, or the port is taken or out of range.
    """

    def __init__(self, host: str = HOST, port: int | None = None) -> None:
        try:
            import viser
        except ImportError as error:
            raise ValueError(MISSING) from error
        if port is not None and not 1 <= checks.count("port", port, 1) <= 65535:
            raise ValueError(f"port is {port}; it must be from 1 to 65535")
        if port is not None and _is_taken(host, port):
            raise ValueError(f"port is {port}, which another program listens on; choose another or leave it out")

        # Who sends garbage is hung up on, which is no news to whoever runs this.
        logging.getLogger("websockets").setLevel(logging.CRITICAL)

        class Server(viser.ViserServer):
            def request_share_url(self, verbose: bool = True) -> str | None:
                """Refuse: viser would make the page public."""
                return None

        with redirect_stdout(io.StringIO()):  # it prints addresses whatever it is told
            self._server = Server(host=host, port=PORT if port is None else port, label="msdwarp", verbose=False)
        self.host, self.port = host, self._server.get_port()
        self._panel = Panel(self._server)
        self._patches: list[tuple[Any, Patch]] = []
        self._levels: dict[int, Any] = {}
        self._fixed: list[Any] = []
        self._scene: Any = None

    @property
    def address(self) -> str:
        """Where the page is."""
        return f"http://{self.host}:{self.port}"

    @property
    def watched(self) -> bool:
        """Whether a page is open."""
        return bool(self._server.get_clients())

    def open(self, view: "View") -> None:
        """Begin."""
        self._view = view
        self._server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(217, 96, 59))
        self._server.scene.set_up_direction("+z")
        self._panel.open(view)

    def stage(self) -> None:
        """Show another scene, or the same drawn in another way."""
        view, scene = self._view, self._server.scene
        drawing = view.shown.drawing
        with self._server.atomic():
            for node in [*self._fixed, *(node for node, _ in self._patches), *self._levels.values()]:
                node.remove()
            self._fixed, self._patches, self._levels = [], [], {}
            points: Any = drawing.points.numpy()
            for k, patch in enumerate(patches(drawing)):
                node = self._mesh(f"/patch/{k}", patch.points(points), patch.faces, patch.colour)
                if patch.moves:
                    self._patches.append((node, patch))
                else:
                    self._fixed.append(node)
            self._set_the_stage()
            line = np.zeros((1, 2, 3), np.float32)
            self._pull: Any = scene.add_line_segments("/pull", line, (30, 30, 30), visible=False)
            self._fixed.append(self._pull)
        self._panel.stage()

    def _set_the_stage(self) -> None:
        """Place the camera and the ground as pictures do, where the scene is another one."""
        view, server = self._view, self._server
        stage = Stage(view.source.scene, view.source.frame().position[np.newaxis], (1280, 720))
        camera, ground = stage.camera, stage.ground
        if ground is not None:
            up = ground.normal
            self._fixed.append(
                server.scene.add_grid(
                    "/ground",
                    infinite_grid=True,
                    cell_size=ground.tile,
                    section_size=5 * ground.tile,
                    cell_thickness=0.4,
                    section_thickness=0.8,
                    cell_color=(214, 216, 220),
                    section_color=(190, 194, 200),
                    fade_distance=2 * ground.half,
                    plane_color=_bytes(checks.colour("ground", view.source.scene.look.ground)),
                    plane_opacity=1.0,
                    shadow_opacity=0.3,
                    plane="xy",
                    wxyz=_turn_to(up),
                    position=tuple(ground.centre),
                )
            )
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
        drawing, view = self._view.shown.drawing, self._view
        points: Any = drawing.points.numpy()
        with self._server.atomic():
            for node, patch in self._patches:
                node.vertices = patch.points(points)
            if drawing.colours_move:
                self._show_levels(points)
            held = view.hand.grip
            self._pull.visible = held is not None
            if held is not None and view.shown.frame is not None:
                here = held.here(view.shown.frame.position)
                self._pull.points = np.array([[here, view.hand.target]], dtype=np.float32)
        self._server.flush()

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

    def _mesh(self, name: str, points: np.ndarray, faces: np.ndarray, colour: tuple[int, int, int]) -> Any:
        """Add triangles that the mouse can take hold of."""
        node = self._server.scene.add_mesh_simple(name, points, faces, color=colour, side="double")
        view = self._view

        async def drag(event: Any) -> None:  # asynchronous: these keep their order
            holder = event.client_id
            if event.phase == "start":
                view.post("grab", holder=holder, point=event.start_position)
            elif event.phase == "end":
                view.post("let_go", holder=holder)
                return
            view.post("drag", holder=holder, point=event.end_position)

        if view.source.handling is not None:
            node.on_drag("left")(drag)
        return node

    def tell(self) -> None:
        """Show what is written, and where sliders stand."""
        self._panel.tell()

    def poll(self) -> bool:
        """Return that the page is there: it is until the view ends."""
        return True

    def close(self) -> None:
        """End: the page is gone. It may be called again."""
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
