"""The actors of OpenGL, in pictures and in windows: lights, the ground, a drawing's triangles and shadows."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..world import FINISHES
from .drawing import Drawing
from .light import Lights, shininess
from .shading import DEPTH_ALONE, Shading, of_finish
from .shadow_map import ShadowMap
from .stage import UNSEEN, Camera, Ground

AROUND = 24
"""Corners of the polygon of ground on which shadows are drawn."""


def add_lights(pv: Any, plotter: Any, camera: Camera, lights: Lights) -> None:
    """Add the key light, the headlight and the fill light of a camera."""
    for strength, towards in ((lights.key, camera.light), (lights.head, None), (lights.fill, camera.fill)):
        kind = "headlight" if towards is None else "scene light"
        light = pv.Light(position=towards, intensity=strength, light_type=kind)
        light.positional = False
        plotter.add_light(light)


def ground_actor(pv: Any, ground: Ground) -> Any:
    """Return an actor of the ground: a square with its texture."""
    square = pv.PolyData.from_regular_faces(ground.corners.astype(np.float32), [[0, 1, 2, 3]])
    square.active_texture_coordinates = ground.uv(ground.corners).astype(np.float32)
    actor = pv.Actor(mapper=pv.DataSetMapper(square))
    actor.texture = pv.Texture(np.ascontiguousarray(ground.texture[::-1]))
    actor.texture.InterpolateOn()
    actor.prop.color, actor.prop.lighting = "white", False
    return actor


class Actors:
    """The triangles of a drawing and their shadows, added to a PyVista plotter and updated in place.

    `painted` is the actor of the ground, None without a ground. `on_ground` is the actor of the region of the
    ground on which shadows fall; the caller adds it to the plotter. `camera` is that of the lights.
    """

    def __init__(
        self, pv: Any, plotter: Any, drawing: Drawing, ground: Ground | None, painted: Any, camera: Camera
    ) -> None:
        self._drawing, self._ground, self._lights = drawing, ground, camera.lights(even=drawing.by_value)
        self._pv, self._plotter = pv, plotter
        self._map = ShadowMap(drawing, camera.light)
        self._shading = Shading(pv, self._map, self._lights, ground, even=drawing.by_value)
        self._bodies: list[Any] = []
        self._actors: list[Any] = []
        self._cut = False
        self._add_bodies()
        self.on_ground: Any = None if ground is None else self._add_on_ground(ground, painted.texture)

    def _add_bodies(self) -> None:
        """Add the drawing's triangles, with one actor for all triangles of equal properties."""
        drawing, texture = self._drawing, None
        if drawing.texture is not None:
            texture = self._pv.Texture(np.ascontiguousarray(drawing.texture))
        of_triangle = np.stack([drawing.finish, drawing.gloss, drawing.closed, drawing.takes_shadows], axis=1)
        kinds, kind = np.unique(of_triangle, axis=0, return_inverse=True)
        # On the CPU these arrays share Warp's memory: they change as the drawing follows the particles.
        points, normals = drawing.points.numpy(), drawing.normals.numpy()
        made_of = [list(FINISHES.values())[int(number)] for number in kinds[:, 0]]
        codes = [(k, of_finish(one)) for k, one in enumerate(made_of) if one.opacity == 1]
        # Glass is drawn last, and only the nearest.
        glass = [k for k, one in enumerate(made_of) if one.opacity < 1]
        codes += [(k, DEPTH_ALONE) for k in glass] + [(k, of_finish(made_of[k])) for k in glass]
        for k, code in codes:
            _, gloss, closed, shaded = kinds[k]
            body, actor = mesh_actor(self._pv, drawing.triangles[kind.ravel() == k], points, normals)
            prop = actor.prop
            prop.interpolation = "Phong"
            prop.diffuse = 1.0
            prop.specular, prop.specular_power = float(gloss), shininess(made_of[k].roughness)
            prop.color, prop.culling = "white", "back" if closed else "none"
            if texture is not None:
                body.active_texture_coordinates, actor.texture = drawing.uv, texture
            else:
                body.point_data["colors"] = (255 * drawing.colors.numpy()).astype(np.uint8)
                body.GetPointData().SetActiveScalars("colors")
                actor.mapper.ScalarVisibilityOn()
            self._shading.light(actor, code, shadows=bool(shaded))
            # Moving actors must neither reset the camera nor be rendered before they are in place.
            self._plotter.add_actor(actor, reset_camera=False, render=False)
            self._bodies.append(body)
            self._actors.append(actor)

    def _add_on_ground(self, ground: Ground, texture: Any) -> Any:
        """Return the actor of the region of the ground on which shadows fall."""
        # Triangles, since VTK triangulates a polygon only once, perhaps before it has a shape.
        fan = np.array([[0, k, k + 1] for k in range(1, AROUND - 1)])
        normals = np.tile(ground.normal, (AROUND, 1)).astype(np.float32)
        self._piece, actor = mesh_actor(self._pv, fan, np.zeros((AROUND, 3), np.float32), normals)
        self._piece.active_texture_coordinates = np.zeros((AROUND, 2), np.float32)
        actor.texture, actor.prop.color = texture, "white"
        actor.prop.culling = "back"  # invisible from below
        self._shading.light(actor)
        return actor

    def _clip_at_ground(self, points: NDArray, ground: Ground) -> None:
        """Clip triangles below the ground, which is drawn first and so would not hide them.

        Without such triangles clipping is off: on a CPU it takes a sixth of a picture's time.
        """
        height = points @ ground.normal.astype(np.float32) - np.float32(ground.centre @ ground.normal)
        deep = self._drawing.radius + UNSEEN * ground.reach
        cut = bool(height.min() < -deep)
        for actor in self._actors if cut != self._cut else ():
            actor.mapper.RemoveAllClippingPlanes()
            if cut:
                origin = ground.centre - deep * ground.normal
                actor.mapper.AddClippingPlane(self._pv.generate_plane(ground.normal, origin))
        self._cut = cut

    def follow(self, *, shadows: bool = True) -> NDArray:
        """Update from the drawing; return the visible points, and points around their shadows [m]."""
        drawing, ground = self._drawing, self._ground
        for body in self._bodies:
            body.GetPoints().Modified()
            body.GetPointData().GetNormals().Modified()
            if drawing.colors_move:
                body.point_data["colors"][:] = 255 * drawing.colors.numpy()
        points = drawing.points.numpy()[drawing.visible]
        shadows = shadows and len(points) > 0  # a stage may be empty
        if len(points) and ground is not None:
            self._clip_at_ground(points, ground)
        if shadows:
            self._map.follow(points, ground)
        self._shading.follow(shadows=shadows)
        if ground is None:
            return points
        self.on_ground.SetVisibility(shadows)
        if not shadows:
            return points
        corners = self._map.on_ground(points, ground, AROUND)
        self._piece.points[:] = corners
        self._piece.GetPoints().Modified()
        self._piece.active_texture_coordinates[:] = ground.uv(corners)
        self._piece.GetPointData().GetTCoords().Modified()
        return np.concatenate([points, corners])

    def remove(self) -> None:
        """Remove the triangles from the plotter."""
        for actor in self._actors:
            self._plotter.remove_actor(actor, reset_camera=False, render=False)
        self._actors.clear()


def mesh_actor(pv: Any, triangles: NDArray, points: NDArray, normals: NDArray) -> tuple[Any, Any]:
    """Return a mesh that shares the memory of these arrays, and an actor that does not round coordinates."""
    from vtkmodules.vtkRenderingCore import vtkPolyDataMapper

    mesh = pv.PolyData.from_regular_faces(np.zeros(points.shape, np.float32), triangles)
    mesh.points = points
    mesh.point_data["Normals"] = normals
    mesh.GetPointData().SetActiveNormals("Normals")
    mapper: Any = vtkPolyDataMapper()
    mapper.SetVBOShiftScaleMethod(0)
    mapper.ScalarVisibilityOff()
    mapper.SetInputData(mesh)
    return mesh, pv.Actor(mapper=mapper)
