"""What OpenGL draws, in pictures and in windows: lights, the ground, a drawing's triangles and their shadow."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .drawing import Drawing
from .light import HEAD, KEY, SHADOW, SHININESS
from .stage import Ground


def add_lights(pv: Any, plotter: Any, towards: NDArray) -> None:
    """Add the key light, which stands still, in a direction of shape [3], and the one at the camera."""
    key = pv.Light(position=towards, intensity=KEY, light_type="scene light")
    key.positional = False
    plotter.add_light(key)
    plotter.add_light(pv.Light(intensity=HEAD, light_type="headlight"))


def ground_texture(pv: Any, ground: Ground) -> Any:
    """Return the texture of the ground."""
    texture = pv.Texture(np.ascontiguousarray(ground.texture[::-1]))
    texture.InterpolateOn()
    return texture


def ground_square(pv: Any, ground: Ground) -> Any:
    """Return the ground's square, with coordinates in its texture."""
    u, v = ground.half * ground.u, ground.half * ground.v
    corners = np.array([-u - v, u - v, u + v, v - u]) + ground.centre
    square = pv.PolyData.from_regular_faces(corners.astype(np.float32), [[0, 1, 2, 3]])
    square.active_texture_coordinates = ground.uv(corners).astype(np.float32)
    return square


class Actors:
    """The triangles of a drawing, and their shadow on the ground, which follow it in place.

    Parameters
    ----------
    pv
        PyVista.
    plotter
        Where they are added.
    drawing
        The triangles.
    ground, texture
        The ground, which is drawn before all this and hides nothing, and its texture; None where there is none.
    light
        Direction towards the key light, of unit length, shape [3].
    """

    def __init__(
        self, pv: Any, plotter: Any, drawing: Drawing, ground: Ground | None, texture: Any, light: NDArray
    ) -> None:
        self.drawing, self.ground = drawing, ground
        self._pv, self._plotter = pv, plotter
        self._actors: list[Any] = []
        self._shadow: Any = None
        if ground is not None:
            self._shadow = self._add_shadow(texture)
            # Not quite all the way, so that what is below the ground stays below it and is cut off.
            self._along_light = (1 - 1e-3) * light / (light @ ground.normal)
        self._bodies = self._add_bodies()

    def _add_shadow(self, texture: Any) -> Any:
        """Add the body's triangles a second time, to lie on the ground: its own texture, darkened."""
        shadow = self._triangles(self.drawing.triangles)
        shadow.active_texture_coordinates = np.zeros((shadow.n_points, 2), np.float32)
        actor = self._add(shadow, texture=texture, lighting=False, color=[SHADOW] * 3)
        self._only_above_ground(actor, 0.0)
        return shadow

    def _add(self, mesh: Any, **style: Any) -> Any:
        # What moves decides on no camera, and asks for no picture until it is in place.
        self._actors.append(self._plotter.add_mesh(mesh, reset_camera=False, render=False, **style))
        return self._actors[-1]

    def _only_above_ground(self, actor: Any, below: float) -> None:
        """Cut off what is further below the ground [m]: it is drawn before all else and hides nothing."""
        assert self.ground is not None
        origin = self.ground.centre - below * self.ground.normal
        actor.mapper.AddClippingPlane(self._pv.generate_plane(self.ground.normal, origin))

    def _add_bodies(self) -> list[Any]:
        """Add the drawing's triangles, those of one gloss together: VTK has one for all that it draws at once."""
        drawing, texture = self.drawing, None
        if drawing.texture is not None:
            texture = self._pv.Texture(np.ascontiguousarray(drawing.texture))
        return [self._add_body(gloss, texture) for gloss in np.unique(drawing.gloss)]

    def _add_body(self, gloss: float, texture: Any) -> Any:
        drawing = self.drawing
        body = self._triangles(drawing.triangles[drawing.gloss == gloss])
        # On the CPU these arrays share Warp's memory: they change as the drawing follows the particles.
        body.points = drawing.points.numpy()
        body.point_data["Normals"] = drawing.normals.numpy()
        body.GetPointData().SetActiveNormals("Normals")
        style: dict[str, Any] = {"smooth_shading": False, "show_scalar_bar": False}
        style |= {"ambient": drawing.ambient, "diffuse": drawing.diffuse}
        style |= {"specular": float(gloss), "specular_power": SHININESS}
        if texture is not None:
            body.active_texture_coordinates = drawing.uv
            style["texture"] = texture
        else:
            body.point_data["colours"] = (255 * drawing.colours.numpy()).astype(np.uint8)
            style |= {"scalars": "colours", "rgb": True}
        actor = self._add(body, **style)
        actor.prop.interpolation = "Phong"
        if self.ground is not None:
            self._only_above_ground(actor, drawing.below)
        return body

    def _triangles(self, triangles: NDArray) -> Any:
        points = np.zeros((len(self.drawing.points), 3), np.float32)
        return self._pv.PolyData.from_regular_faces(points, triangles)

    def follow(self, *, shadows: bool = True) -> list[NDArray]:
        """Move to where the drawing is now; return all points that are drawn [m], shape [any, 3] each."""
        drawing = self.drawing
        for body in self._bodies:
            body.GetPoints().Modified()
            body.GetPointData().GetNormals().Modified()
            if drawing.colours_move:
                body.point_data["colours"][:] = 255 * drawing.colours.numpy()
        points = drawing.points.numpy()
        if self._shadow is None or self.ground is None:
            return [points]
        self._actors[0].visibility = shadows
        height = (points - self.ground.centre) @ self.ground.normal
        landed = points - height[:, None] * self._along_light
        self._shadow.points[:] = landed
        self._shadow.GetPoints().Modified()
        self._shadow.active_texture_coordinates[:] = self.ground.uv(landed)
        self._shadow.GetPointData().GetTCoords().Modified()
        return [points, landed]

    def remove(self) -> None:
        """Draw nothing any more."""
        for actor in self._actors:
            self._plotter.remove_actor(actor, reset_camera=False, render=False)
        self._actors.clear()
