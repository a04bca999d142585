"""Pictures by OpenGL, off-screen, through PyVista, which is imported when the first one is drawn."""

import warnings
import weakref
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..kernels.pictures import halve_over
from .arrows import COLOUR, Arrows
from .drawing import Drawing
from .stage import HEAD, KEY, SHADOW, VIEW_ANGLE, Stage


class OpenGL:
    """Draws with PyVista: one plotter for all pictures, whose points are updated in place.

    Pictures are drawn twice as fine in either direction and averaged: smooth edges on any OpenGL. The camera
    stands still, so the ground is drawn once, and every picture laid over it.
    """

    def __init__(self, drawing: Drawing, stage: Stage, arrows: Arrows | None = None) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of VTK's and PyVista's own making, at import
            import pyvista as pv

        self.drawing, self.ground, self.camera = drawing, stage.ground, stage.camera
        shape = (stage.height, stage.width)
        height, width = (2 * n for n in shape)
        self._plotter = self._new_plotter(pv, (width, height))
        # What OpenGL draws is read back into memory that Warp sees too.
        self._read = pv.convert_array(np.zeros((width * height, 4), np.uint8))
        fine = pv.convert_array(self._read).reshape(height, width, 4)
        self._fine = wp.array(fine.view(np.uint32)[..., 0], dtype=wp.uint32, device="cpu", copy=False)
        red, green, blue = (round(255 * c) for c in checks.colour("background", stage.look.background))
        self._backdrop = wp.full(shape, red + (green << 8) + (blue << 16), dtype=wp.uint32, device="cpu")
        self._pixels = wp.zeros(shape, dtype=wp.uint32, device="cpu")
        self._shadow: Any = None
        self._shadow_actor: Any = None
        weakref.finalize(self, self._plotter.close)
        self._plotter.show(auto_close=False)
        if self.ground is not None:
            texture = pv.Texture(np.ascontiguousarray(self.ground.texture[::-1]))
            texture.InterpolateOn()
            bare = self._add_ground(pv, texture)
            self._picture((0, 0, *shape))
            wp.copy(self._backdrop, self._pixels)
            self._plotter.remove_actor(bare, render=False)
            self._shadow = self._add_shadow(pv, texture)
        self._bodies = self._add_bodies(pv)
        self._arrows = arrows
        if arrows is not None:
            self._front, self._arrow_mesh = self._add_in_front(pv, arrows)

    def _new_plotter(self, pv: Any, size: tuple[int, int]) -> Any:
        """Return a plotter with the camera and the lights, transparent where nothing is drawn."""
        plotter = pv.Plotter(off_screen=True, window_size=list(size), lighting="none")
        plotter.render_window.SetMultiSamples(0)
        plotter.render_window.SetAlphaBitPlanes(1)
        plotter.disable_anti_aliasing()
        plotter.set_background("black")
        plotter.renderer.SetBackgroundAlpha(0.0)
        key = pv.Light(position=self.camera.light, intensity=KEY, light_type="scene light")
        key.positional = False
        plotter.add_light(key)
        plotter.add_light(pv.Light(intensity=HEAD, light_type="headlight"))
        plotter.camera.position, plotter.camera.focal_point = self.camera.eye, self.camera.target
        plotter.camera.up, plotter.camera.view_angle = self.camera.up, VIEW_ANGLE
        return plotter

    def _add_ground(self, pv: Any, texture: Any) -> Any:
        assert self.ground is not None
        u, v = self.ground.half * self.ground.u, self.ground.half * self.ground.v
        corners = np.array([-u - v, u - v, u + v, v - u]) + self.ground.centre
        square = pv.PolyData.from_regular_faces(corners.astype(np.float32), [[0, 1, 2, 3]])
        square.active_texture_coordinates = self.ground.uv(corners).astype(np.float32)
        return self._plotter.add_mesh(square, texture=texture, lighting=False)

    def _add_shadow(self, pv: Any, texture: Any) -> Any:
        """Add the body's triangles a second time, to lie on the ground: its own texture, darkened."""
        assert self.ground is not None
        shadow = self._triangles(pv, self.drawing.triangles)
        shadow.active_texture_coordinates = np.zeros((shadow.n_points, 2), np.float32)
        actor = self._plotter.add_mesh(shadow, texture=texture, lighting=False, color=[SHADOW] * 3)
        self._only_above_ground(pv, actor, 0.0)
        # Not quite all the way, so that what is below the ground stays below it and is cut off.
        self._along_light = (1 - 1e-3) * self.camera.light / (self.camera.light @ self.ground.normal)
        self._shadow_actor = actor
        return shadow

    def _only_above_ground(self, pv: Any, actor: Any, below: float) -> None:
        """Cut off what is further below the ground [m]: it is drawn before all else and hides nothing."""
        assert self.ground is not None
        origin = self.ground.centre - below * self.ground.normal
        actor.mapper.AddClippingPlane(pv.generate_plane(self.ground.normal, origin))

    def _add_in_front(self, pv: Any, arrows: Arrows) -> tuple[Any, Any]:
        """Add arrows in a layer in front of all else; return its renderer, and their mesh."""
        mesh = pv.PolyData.from_regular_faces(np.zeros((len(arrows.points), 3), np.float32), arrows.triangles)
        mesh.points = arrows.points.numpy()  # Warp's memory, as that of bodies
        mesh.point_data["Normals"] = arrows.normals.numpy()
        mesh.GetPointData().SetActiveNormals("Normals")
        actor = pv.Actor(mapper=pv.DataSetMapper(mesh))
        actor.mapper.scalar_visibility = False
        actor.prop.color, actor.prop.interpolation = COLOUR, "Phong"
        actor.prop.ambient, actor.prop.diffuse = self.drawing.ambient, self.drawing.diffuse
        behind = self._plotter.renderer
        front = behind.NewInstance()
        front.AddActor(actor)
        for light in behind.lights:
            front.AddLight(light)
        front.SetAutomaticLightCreation(False)
        camera = front.GetActiveCamera()
        camera.DeepCopy(behind.GetActiveCamera())
        front.SetLayer(1)
        self._plotter.render_window.SetNumberOfLayers(2)
        self._plotter.render_window.AddRenderer(front)
        return front, mesh

    def _add_bodies(self, pv: Any) -> list[Any]:
        """Add the drawing's triangles, those of one gloss together: VTK has one for all that it draws at once."""
        drawing, texture = self.drawing, None
        if drawing.texture is not None:
            texture = pv.Texture(np.ascontiguousarray(drawing.texture))
        return [self._add_body(pv, gloss, texture) for gloss in np.unique(drawing.gloss)]

    def _add_body(self, pv: Any, gloss: float, texture: Any) -> Any:
        drawing = self.drawing
        body = self._triangles(pv, drawing.triangles[drawing.gloss == gloss])
        # On the CPU these arrays share Warp's memory: they change as the drawing follows the particles.
        body.points = drawing.points.numpy()
        body.point_data["Normals"] = drawing.normals.numpy()
        body.GetPointData().SetActiveNormals("Normals")
        style: dict[str, Any] = {"smooth_shading": False, "show_scalar_bar": False}
        style |= {"ambient": drawing.ambient, "diffuse": drawing.diffuse}
        style |= {"specular": float(gloss), "specular_power": 30.0}
        if texture is not None:
            body.active_texture_coordinates = drawing.uv
            style["texture"] = texture
        else:
            body.point_data["colours"] = (255 * drawing.colours.numpy()).astype(np.uint8)
            style |= {"scalars": "colours", "rgb": True}
        actor = self._plotter.add_mesh(body, **style)
        actor.prop.interpolation = "Phong"
        if self.ground is not None:
            self._only_above_ground(pv, actor, drawing.below)
        return body

    def _triangles(self, pv: Any, triangles: NDArray) -> Any:
        points = np.zeros((len(self.drawing.points), 3), np.float32)
        return pv.PolyData.from_regular_faces(points, triangles)

    def draw(self, *, shadows: bool = True) -> NDArray[np.uint8]:
        """Return the picture of the drawing as it stands, uint8 of shape [height, width, 3]."""
        drawing = self.drawing
        for body in self._bodies:
            body.GetPoints().Modified()
            body.GetPointData().GetNormals().Modified()
            if drawing.colours_move:
                body.point_data["colours"][:] = 255 * drawing.colours.numpy()
        points = drawing.points.numpy()
        drawn = [points]
        if self._shadow is not None and self.ground is not None:
            self._shadow_actor.visibility = shadows
            height = (points - self.ground.centre) @ self.ground.normal
            landed = points - height[:, None] * self._along_light
            self._shadow.points[:] = landed
            self._shadow.GetPoints().Modified()
            self._shadow.active_texture_coordinates[:] = self.ground.uv(landed)
            self._shadow.GetPointData().GetTCoords().Modified()
            drawn.append(landed)
        if self._arrows is not None:
            self._arrow_mesh.GetPoints().Modified()
            self._arrow_mesh.GetPointData().GetNormals().Modified()
            self._front.ResetCameraClippingRange()
            drawn.append(self._arrows.points.numpy())
        return self._picture(self.camera.frame(np.concatenate(drawn), *self._pixels.shape))

    def _picture(self, part: tuple[int, int, int, int]) -> NDArray[np.uint8]:
        """Render, read back, and average the fine picture down over what does not move.

        All that is drawn lies in `part`: first row and column, rows and columns.
        """
        plotter, (height, width) = self._plotter, self._fine.shape
        plotter.renderer.ResetCameraClippingRange()
        plotter.render()
        plotter.render_window.GetRGBACharPixelData(0, 0, width - 1, height - 1, 0, self._read)
        wp.copy(self._pixels, self._backdrop)
        wp.launch(halve_over, part[2:], [self._fine, *part[:2]], [self._pixels], device="cpu")
        rgbx = self._pixels.numpy().view(np.uint8).reshape(*self._pixels.shape, 4)
        return np.ascontiguousarray(rgbx[..., :3])
