"""What OpenGL draws, in pictures and in windows: lights, the ground, a drawing's triangles and their shadows."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .drawing import Drawing
from .light import FILL, HEAD, KEY, SHININESS
from .shading import Shading
from .shadow_map import ShadowMap
from .stage import UNSEEN, Camera, Ground

AROUND = 24
"""Corners of the piece of ground on which shadows are drawn."""


def add_lights(pv: Any, plotter: Any, camera: Camera) -> None:
    """Add the key light, the one at the camera, and the fill light, which stand as they would for a camera."""
    for strength, towards in ((KEY, camera.light), (HEAD, None), (FILL, camera.fill)):
        if towards is None:
            light = pv.Light(intensity=strength, light_type="headlight")
        else:
            light = pv.Light(position=towards, intensity=strength, light_type="scene light")
            light.positional = False
        plotter.add_light(light)


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
    """The triangles of a drawing and the shadows that they cast, which follow it in place.

    Parameters
    ----------
    pv
        PyVista.
    plotter
        Where they are added.
    drawing
        The triangles.
    ground
        Where shadows fall beside the drawing; None where there is no ground.
    light
        Direction towards the key light, of unit length, shape [3].
    """

    def __init__(self, pv: Any, plotter: Any, drawing: Drawing, ground: Ground | None, light: NDArray) -> None:
        self.drawing, self.ground = drawing, ground
        self._pv, self._plotter = pv, plotter
        self.shadow_map = ShadowMap(drawing, light)
        self.shading = Shading(pv, self.shadow_map, drawing.bounce)
        self._actors: list[Any] = []
        self._cut = False
        self._bodies = self._add_bodies()

    def _only_above_ground(self, points: NDArray) -> None:
        """Cut off what is below the ground, which is drawn before all else and hides nothing.

        Only where something is: cutting costs a processor a sixth of the picture.
        """
        ground = self.ground
        if ground is None:
            return
        height = points @ ground.normal.astype(np.float32) - np.float32(ground.centre @ ground.normal)
        deep = self.drawing.below + UNSEEN * ground.reach
        cut = bool(height.min() < -deep)
        if cut == self._cut:
            return
        self._cut = cut
        for actor in self._actors:
            actor.mapper.RemoveAllClippingPlanes()
            if cut:
                origin = ground.centre - deep * ground.normal
                actor.mapper.AddClippingPlane(self._pv.generate_plane(ground.normal, origin))

    def _add_bodies(self) -> list[Any]:
        """Add the drawing's triangles, those that are drawn alike together: VTK has one way for all at once.

        The backs of closed parts, which are hidden by their fronts, are not drawn.
        """
        drawing, texture = self.drawing, None
        if drawing.texture is not None:
            texture = self._pv.Texture(np.ascontiguousarray(drawing.texture))
        of_triangle = np.stack([drawing.gloss, drawing.closed, drawing.takes_shadows], axis=1)
        kinds, kind = np.unique(of_triangle, axis=0, return_inverse=True)
        return [
            self._add_body(drawing.triangles[kind.ravel() == k], gloss, closed, shaded, texture)
            for k, (gloss, closed, shaded) in enumerate(kinds)
        ]

    def _add_body(self, triangles: NDArray, gloss: float, closed: float, shaded: float, texture: Any) -> Any:
        pv, drawing = self._pv, self.drawing
        points = np.zeros((len(drawing.points), 3), np.float32)
        body = pv.PolyData.from_regular_faces(points, triangles)
        # On the CPU these arrays share Warp's memory: they change as the drawing follows the particles.
        body.points = drawing.points.numpy()
        body.point_data["Normals"] = drawing.normals.numpy()
        body.GetPointData().SetActiveNormals("Normals")
        actor = pv.Actor(mapper=_mapper(body))
        prop = actor.prop
        prop.interpolation = "Phong"
        prop.ambient, prop.diffuse = drawing.ambient, drawing.diffuse
        prop.specular, prop.specular_power = float(gloss), SHININESS
        prop.color, prop.culling = "white", "back" if closed else "none"
        if texture is not None:
            body.active_texture_coordinates = drawing.uv
            actor.texture = texture
        else:
            body.point_data["colours"] = (255 * drawing.colours.numpy()).astype(np.uint8)
            body.GetPointData().SetActiveScalars("colours")
            actor.mapper.ScalarVisibilityOn()
        self.shading.light(actor, shadows=bool(shaded))
        # What moves decides on no camera, and asks for no picture until it is in place.
        self._plotter.add_actor(actor, reset_camera=False, render=False)
        self._actors.append(actor)
        return body

    def follow(self, *, shadows: bool = True, seen: slice = slice(None)) -> NDArray:
        """Move to where the drawing is now; return the points that are drawn [m], shape [any, 3].

        `seen` are those of the drawing's vertices that the key light must see.
        """
        drawing = self.drawing
        for body in self._bodies:
            body.GetPoints().Modified()
            body.GetPointData().GetNormals().Modified()
            if drawing.colours_move:
                body.point_data["colours"][:] = 255 * drawing.colours.numpy()
        points = drawing.points.numpy()
        shadows = shadows and len(points[seen]) > 0  # a stage may be bare
        if len(points[seen]):
            self._only_above_ground(points[seen])
        if shadows:
            self.shadow_map.follow(points[seen])
        self.shading.follow(shadows=shadows)
        return points

    def remove(self) -> None:
        """Draw nothing any more."""
        for actor in self._actors:
            self._plotter.remove_actor(actor, reset_camera=False, render=False)
        self._actors.clear()


class ShadedGround:
    """The part of the ground on which shadows fall, drawn over the bare ground, which it hides.

    Parameters
    ----------
    pv
        PyVista.
    ground, texture
        The ground, and its texture.
    actors
        What casts the shadows.
    """

    def __init__(self, pv: Any, ground: Ground, texture: Any, actors: Actors) -> None:
        self._ground, self._map = ground, actors.shadow_map
        light = actors.shadow_map.axes[2]
        self._along_light = light / (light @ ground.normal)
        # Triangles: VTK cuts a polygon once, where it is first drawn, which a window may do before it has a shape.
        fan = [[0, k, k + 1] for k in range(1, AROUND - 1)]
        self._piece = pv.PolyData.from_regular_faces(np.zeros((AROUND, 3), np.float32), fan)
        self._piece.point_data["Normals"] = np.tile(ground.normal, (AROUND, 1)).astype(np.float32)
        self._piece.GetPointData().SetActiveNormals("Normals")
        self._piece.active_texture_coordinates = np.zeros((AROUND, 2), np.float32)
        self.actor = pv.Actor(mapper=_mapper(self._piece))
        self.actor.texture, self.actor.prop.color = texture, "white"
        self.actor.prop.culling = "back"  # from below it hides nothing
        actors.shading.light(self.actor, ground=True)

    def follow(self, points: NDArray) -> NDArray:
        """Move to where the shadows of these points fall; return the corners [m], shape [AROUND, 3]."""
        corners = self._map.outline(points, AROUND)
        height = (corners - self._ground.centre) @ self._ground.normal
        corners = corners - height[:, None] * self._along_light
        self._piece.points[:] = corners
        self._piece.GetPoints().Modified()
        self._piece.active_texture_coordinates[:] = self._ground.uv(corners)
        self._piece.GetPointData().GetTCoords().Modified()
        return corners


def _mapper(mesh: Any) -> Any:
    """Return what hands a mesh to OpenGL with its coordinates as they are, whatever their size."""
    from vtkmodules.vtkRenderingCore import vtkPolyDataMapper

    mapper: Any = vtkPolyDataMapper()
    mapper.SetVBOShiftScaleMethod(0)
    mapper.ScalarVisibilityOff()
    mapper.SetInputData(mesh)
    return mapper
