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
from ..pictures import Orbit, ramp
from .access import EVERYWHERE, Access
from .images import Images, Link
from .panel import Panel
from .patches import LEVELS, Patch, compact, levels, patches
from .sources import Source
from .tone_mapping import LIGHT, encoded, paint

if TYPE_CHECKING:
    from .view import View

HOST, PORT = "127.0.0.1", 8080
"""Default address of the page: only this machine can open it."""
SIZE = (720, 720)
"""Width and height for which the camera is placed."""
ALL = "/all"
"""The parent node of the scene: it moves when cameras follow a body, since clients move their own cameras."""
WORTH = 10_000
"""Number of vertices above which triangles take more bytes than an image."""
MOST_WAITING = 20
"""If more commands than this wait for the view, clients must wait before they send messages."""
LATE, OFTEN = 1.0, 3
"""A link is too slow for triangles if a message takes this long [s] this many times in a row."""


class Browser:
    """A web page that shows a view: a `Screen`.

    Parameters as for `view`. ValueError is raised if viser is missing or cannot be guarded, the port is taken
    or out of range, or an origin is invalid.
    """

    takes_images = True

    def __init__(self, host: str = HOST, port: int | None = None, allow_origin: Sequence[str] = ()) -> None:
        viser = checks.imported("viser", "the page needs viser: pip install 'msdwarp[view]'")
        from .guard import allow_any_thread, guarded  # both need packages that come with viser

        if port is not None and not 1 <= checks.count("port", port, 1) <= 65535:
            raise ValueError(f"port is {port}; it must be from 1 to 65535")
        self._access = Access(host, allow_origin)
        self._waiting: Callable[[], int] = lambda: 0
        self._server: Any = None

        # Clients that send garbage are disconnected silently.
        logging.getLogger("websockets").setLevel(logging.CRITICAL)

        class Server(viser.ViserServer):
            def request_share_url(self, verbose: bool = True) -> str | None:
                """Refuse, because viser would make the page public."""
                return None

        try:
            # viser prints addresses even if not verbose.
            with guarded(self._access, lambda: self._waiting() >= MOST_WAITING), redirect_stdout(io.StringIO()):
                self._server = Server(host, PORT if port is None else port, label="msdwarp", verbose=False)
            if port not in (None, self._server.get_port()):  # viser has taken the next free one
                raise ValueError(
                    f"port is {port}, which another program listens on; choose another or leave it out"
                )
        except ValueError:
            self.close()
            raise
        self.host, self.port = host, self._server.get_port()
        allow_any_thread(self._server)
        self._panel = Panel(self._server)
        self._nodes: list[Any] = []
        self._patches: list[tuple[Any, Patch]] = []
        self._levels: dict[int, Any] = {}
        self._links: dict[int, Link] = {}
        self._images: Images | None = None
        self._scene: Source | None = None

    @property
    def address(self) -> str:
        """The page's address, with the token if the page needs one."""
        name = socket.gethostname() if self.host in EVERYWHERE else self.host
        address = f"http://{f'[{name}]' if ':' in name else name}:{self.port}"
        return address if self._access.token is None else f"{address}/?token={self._access.token}"

    @property
    def watched(self) -> bool:
        """Whether a page is open."""
        return bool(self._server.get_clients())

    def open(self, view: "View") -> None:
        """Start serving a view."""
        self._view, self._waiting = view, lambda: view.waiting
        self._server.gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(217, 96, 59))
        self._server.gui.main_panel.dock_right()  # beside the picture, not over it
        self._server.scene.set_up_direction("+z")
        self._server.scene.configure_environment_map(hdri=None)
        self._server.scene.configure_default_lights(enabled=False)
        self._all = self._server.scene.add_frame(ALL, show_axes=False)
        self._panel.open(view)

    def stage(self) -> None:
        """Show another scene, or another drawing of the same scene."""
        view = self._view
        with self._server.atomic():
            if view.source is not self._scene:
                self._scene = view.source
                self._stage = view.staged(SIZE)
                self._place_camera()
            self._light()
            for node in self._nodes:
                node.remove()
            self._nodes, self._patches, self._levels = [], [], {}
            if self._images is not None:
                self._images = None
                for client in self._server.get_clients().values():
                    client.scene.set_background_image(None)
            if view.images:
                self._images = Images(view.shown.drawing, self._stage)
                # In place of images, the mouse drags an invisible box around the body.
                box = self._server.scene.add_box(f"{ALL}/box", opacity=0.0, side="double", cast_shadow=False)
                self._box = self._let_drag(box)
            else:
                drawing = view.shown.drawing
                points: Any = drawing.points.numpy()
                for k, patch in enumerate(patches(drawing)):
                    node = self._add_mesh(
                        f"{ALL}/patch/{k}", patch.points(points), patch.faces, patch.color, patch.opacity
                    )
                    if patch.moves:
                        self._patches.append((node, patch))
                self._add_ground()
            line = np.zeros((1, 2, 3), np.float32)
            self._pull = self._server.scene.add_line_segments(f"{ALL}/pull", line, (30, 30, 30), visible=False)
            self._nodes.append(self._pull)
        self._panel.stage()

    def _place_camera(self) -> None:
        """Place the camera as for pictures."""
        camera = Orbit(self._stage.camera).camera  # not straight from above, where its up is undefined
        first = self._server.initial_camera
        first.position, first.look_at, first.up = tuple(camera.eye), tuple(camera.target), (0.0, 0.0, 1.0)
        first.fov = math.radians(camera.field_of_view)
        for client in self._server.get_clients().values():
            client.camera.position, client.camera.look_at = camera.eye, camera.target

    def _light(self) -> None:
        """Light the scene as in pictures."""
        scene, camera = self._server.scene, self._stage.camera
        lights = camera.lights(even=self._view.shown.drawing.by_value)
        floor = tuple(encoded([lights.bounce / lights.sky] * 3).tolist())
        scene.add_light_hemisphere("/sky", intensity=LIGHT * lights.sky, ground_color=floor, position=(0, 0, 1))
        places = {"key": camera.light, "head": -camera.forward, "fill": camera.fill}
        for name, place in places.items():
            intensity = LIGHT * getattr(lights, name)
            scene.add_light_directional(
                f"/{name}", intensity=intensity, cast_shadow=name == "key", position=tuple(place)
            )

    def _open_lenses(self) -> None:
        """Set each client's view angle as for pictures, or on a narrow page so that the width stays in view."""
        for client in self._server.get_clients().values():
            camera = client.camera
            narrow = 1.0 if self._images is not None else max(1.0, camera.image_height / camera.image_width)
            camera.fov = 2.0 * math.atan(narrow * self._stage.camera.tangent)

    def _add_ground(self) -> None:
        """Add the ground as in pictures."""
        ground = self._stage.ground
        if ground is None:
            return
        from viser.transforms import SO3

        grid = self._server.scene.add_grid(
            f"{ALL}/ground",
            infinite_grid=True,
            cell_size=ground.tile,
            section_size=5 * ground.tile,
            cell_thickness=0.6,
            section_thickness=1.0,
            cell_color=(190, 194, 202),
            section_color=(150, 156, 166),
            fade_distance=2 * ground.half,
            plane_color=_bytes(checks.color("ground", self._stage.look.ground)),
            plane_opacity=1.0,
            shadow_opacity=0.3,
            plane="xy",
            wxyz=SO3.from_matrix(np.stack([ground.u, ground.v, ground.normal], axis=1)).wxyz,
            position=tuple(ground.centre),
        )
        self._nodes.append(grid)

    def _add_mesh(
        self, name: str, points: np.ndarray, faces: np.ndarray, color: np.ndarray, opacity: float | None = None
    ) -> Any:
        """Add triangles that the mouse can drag."""
        shown = {"color": paint(color), "opacity": opacity, "side": "double", "receive_shadow": False}
        return self._let_drag(self._server.scene.add_mesh_simple(name, points, faces, **shown))

    def _let_drag(self, node: Any) -> Any:
        """Let the mouse pull the body through a node: at a point on triangles, or along a ray through an image."""
        self._nodes.append(node)
        view, by_ray = self._view, self._images is not None

        async def drag(event: Any) -> None:  # asynchronous callbacks run in order
            holder, shift = event.client_id, view.following.shift
            if event.phase == "end":
                view.post("let_go", holder=holder)
                return
            if event.phase == "start" and by_ray:
                origin, direction, _ = _ray(event.client.camera, event.start_position)
                view.post("pick", holder=holder, origin=origin + shift, direction=direction)
            elif event.phase == "start":
                view.post("grab", holder=holder, point=event.start_position + shift)
            if by_ray:
                origin, *ways = _ray(event.client.camera, event.end_position)
                view.post("drag", holder=holder, ray=(origin + shift, *ways))
            else:
                view.post("drag", holder=holder, point=event.end_position + shift)

        if view.source.handling is not None:
            node.on_drag("left")(drag)
        return node

    def show(self) -> None:
        """Show the current frame of the drawing."""
        view, frame = self._view, self._view.shown.frame
        assert frame is not None
        with self._server.atomic():
            self._all.position = -view.following.shift
            if self._images is None:
                self._show_triangles()
            else:
                self._images.shift = view.following.shift
                self._images.follow()
                points = in_space(frame.position, np.float64)
                self._box.dimensions = tuple(np.ptp(points, axis=0))
                self._box.position = (points.min(axis=0) + points.max(axis=0)) / 2
            arrow = view.hand.arrow(frame.position)
            self._pull.visible = arrow is not None
            if arrow is not None:
                self._pull.points = arrow[np.newaxis].astype(np.float32)
        self._server.flush()
        if self._images is None:
            self._look_for_slow()

    def _show_triangles(self) -> None:
        """Move the patches; if colors change, the triangles of each color are a separate mesh."""
        drawing = self._view.shown.drawing
        points: Any = drawing.points.numpy()
        for node, patch in self._patches:
            node.vertices = patch.points(points)
        if not drawing.colors_move:
            return
        colors = _bytes(ramp(drawing.stops, LEVELS))
        for level, triangles in enumerate(levels(drawing)):
            corners, faces = compact(triangles)
            node = self._levels.get(level)
            if node is not None and len(faces):
                node.vertices, node.faces, node.visible = points[corners], faces, True
            elif node is not None:
                node.visible = False
            elif len(faces):
                name = f"{ALL}/level/{level}"
                self._levels[level] = self._add_mesh(name, points[corners], faces, colors[level])

    def tell(self) -> None:
        """Update texts and sliders."""
        self._panel.tell()

    def poll(self) -> bool:
        """Send images to clients that are ready; return True, since a page stays open until the view ends."""
        self._open_lenses()
        if self._images is not None:
            self._images.send(self._clients())
        return True

    def _clients(self) -> list[tuple[int, Any, Link]]:
        """Return (number, client, link) of each connected client."""
        clients = self._server.get_clients()
        self._links = {k: self._links.get(k) or Link(self._server, one) for k, one in clients.items()}
        return [(k, one, self._links[k]) for k, one in clients.items()]

    def _look_for_slow(self) -> None:
        """Make the view send images if triangles are repeatedly late."""
        vertices = sum(len(patch.corners) for _, patch in self._patches)
        if vertices + len(self._view.shown.drawing.points) < WORTH:
            return
        for _, _, link in self._clients():
            if link.busy:  # ignores a client that never answers, such as a sleeping laptop
                continue
            link.late = link.late + 1 if link.delay >= LATE else 0
            if link.late == OFTEN:
                self._view.post("slow")
            link.ask()

    def close(self) -> None:
        """Stop the server; repeated calls are allowed."""
        if self._server is not None:
            with redirect_stdout(io.StringIO()):
                self._server.stop()


def _ray(camera: Any, point: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the ray from a camera through a point: origin [m], ray direction, the camera's direction."""
    ahead, way = camera.look_at - camera.position, np.asarray(point) - camera.position
    return camera.position, way / np.linalg.norm(way), ahead / np.linalg.norm(ahead)


def _bytes(colors: Any) -> np.ndarray:
    return np.round(255 * np.array(colors)).astype(np.uint8)
