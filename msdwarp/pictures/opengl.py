"""Pictures by OpenGL, off-screen, through PyVista, which is imported when the first one is drawn."""

import weakref
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..kernels.pictures import drawing
from .actors import Actors, add_lights, ground_actor, mesh_actor
from .arrows import COLOR, Arrows
from .drawing import Drawing
from .light import Lights
from .opengl_window import import_pyvista
from .stage import Camera, Stage

BEHIND, SCENE, FRONT = 0, 1, 2
"""Layers, each drawn over the previous ones: the ground's shadows, bodies and colliders, and arrows."""


class OpenGL:
    """Draws with PyVista: one plotter for all pictures, whose points are updated in place.

    Pictures are drawn at twice the resolution and averaged: smooth edges on any OpenGL. The ground is drawn
    only once for each camera, and every picture is blended over it.
    """

    def __init__(self, drawing: Drawing, stage: Stage, arrows: Arrows | None = None) -> None:
        pv = import_pyvista()
        self._camera = stage.camera
        lights = stage.camera.lights(even=drawing.by_value)
        shape = (stage.height, stage.width)
        height, width = (2 * n for n in shape)
        self._plotter = self._new_plotter(pv, (width, height), lights)
        # OpenGL's picture is read back into memory that Warp shares.
        self._read = pv.convert_array(np.zeros((width * height, 4), np.uint8))
        fine = pv.convert_array(self._read).reshape(height, width, 4)
        self._fine = wp.array(fine, dtype=wp.vec4ub, device="cpu", copy=False)
        sky = [round(255 * c) for c in checks.color("background", stage.look.background)]
        self._backdrop = wp.array(np.full((*shape, 4), [*sky, 255], np.uint8), dtype=wp.vec4ub, device="cpu")
        self._pixels = wp.zeros(shape, dtype=wp.vec4ub, device="cpu")
        weakref.finalize(self, self._plotter.close)
        self._plotter.show(auto_close=False)
        self._sky, self._ground = wp.clone(self._backdrop), None
        if stage.ground is not None:
            self._ground = ground_actor(pv, stage.ground)
            self._draw_ground()
        self._actors = Actors(pv, self._plotter, drawing, stage.ground, self._ground, self._camera)
        behind = self._layer(BEHIND)  # the first layer: VTK clears the window with it
        if self._ground is not None:
            behind.AddActor(self._actors.on_ground)
        self._arrows = arrows
        if arrows is not None:
            points, normals = arrows.points.numpy(), arrows.normals.numpy()
            self._arrow_mesh, actor = mesh_actor(pv, arrows.triangles, points, normals)
            actor.prop.color, actor.prop.interpolation = COLOR, "Phong"
            # VTK has no light from the sky and from below: ambient light is as for an upright face.
            actor.prop.ambient, actor.prop.diffuse = 0.5 * (lights.sky + lights.bounce), 1.0
            self._layer(FRONT).AddActor(actor)

    def _new_plotter(self, pv: Any, size: tuple[int, int], lights: Lights) -> Any:
        """Return a plotter with the camera and the lights, transparent where nothing is drawn."""
        # In a notebook PyVista would otherwise also show a picture.
        plotter = pv.Plotter(off_screen=True, window_size=list(size), lighting="none", notebook=False)
        plotter.render_window.SetMultiSamples(0)
        plotter.render_window.SwapBuffersOff()  # not visible, and a copy costs a CPU a tenth of the time
        plotter.render_window.SetNumberOfLayers(FRONT + 1)
        plotter.renderer.SetLayer(SCENE)
        plotter.render_window.SetAlphaBitPlanes(1)
        plotter.disable_anti_aliasing()
        plotter.set_background("black")
        plotter.renderer.SetBackgroundAlpha(0.0)
        add_lights(pv, plotter, self._camera, lights)
        plotter.camera.position, plotter.camera.focal_point = self._camera.eye, self._camera.target
        plotter.camera.up, plotter.camera.view_angle = self._camera.up, self._camera.field_of_view
        return plotter

    def _layer(self, layer: int) -> Any:
        """Return a renderer of one layer, with the same camera and lights."""
        scene = self._plotter.renderer
        renderer = scene.NewInstance()
        for light in scene.lights:
            renderer.AddLight(light)
        renderer.SetAutomaticLightCreation(False)
        renderer.SetBackgroundAlpha(0.0)
        renderer.SetActiveCamera(scene.GetActiveCamera())
        renderer.SetLayer(layer)
        self._plotter.render_window.AddRenderer(renderer)
        return renderer

    def look_from(self, camera: Camera, size: tuple[int, int]) -> None:
        """Set the camera of the next pictures, which have the stage's `size`; the lights stay."""
        self._camera = camera
        seen = self._plotter.camera
        seen.position, seen.focal_point, seen.up = camera.eye, camera.target, camera.up
        if self._ground is not None:
            self._draw_ground()

    def _draw_ground(self) -> None:
        """Draw the ground alone, over which pictures are blended."""
        actors = [one for layer in self._plotter.render_window.GetRenderers() for one in layer.GetActors()]
        shown = [one for one in actors if one.GetVisibility()]
        for one in shown:
            one.VisibilityOff()
        wp.copy(self._backdrop, self._sky)
        self._plotter.add_actor(self._ground, reset_camera=False)
        self._picture((0, 0, *self._pixels.shape))
        wp.copy(self._backdrop, self._pixels)
        self._plotter.remove_actor(self._ground, reset_camera=False, render=False)
        for one in shown:
            one.VisibilityOn()

    def draw(self, *, shadows: bool = True) -> NDArray[np.uint8]:
        """Return the picture of the current drawing, uint8 of shape [height, width, 3]."""
        drawn = self._actors.follow(shadows=shadows)
        if self._arrows is not None:
            self._arrow_mesh.GetPoints().Modified()
            self._arrow_mesh.GetPointData().GetNormals().Modified()
            drawn = np.concatenate([drawn, self._arrows.points.numpy()])
        return self._picture(self._camera.frame(drawn, *self._pixels.shape))

    def _picture(self, part: tuple[int, int, int, int]) -> NDArray[np.uint8]:
        """Render and blend over the ground within `part`: first row and column, numbers of rows and columns."""
        plotter, (height, width) = self._plotter, self._fine.shape
        # All layers have one camera, which must see the shadows on the ground as well.
        ranges = []
        for layer in plotter.render_window.GetRenderers():
            layer.ResetCameraClippingRange()
            ranges.append(plotter.camera.clipping_range)
        near, far = zip(*ranges, strict=True)
        plotter.camera.clipping_range = min(near), max(far)
        plotter.render()
        plotter.render_window.GetRGBACharPixelData(0, 0, width - 1, height - 1, 0, self._read)
        wp.copy(self._pixels, self._backdrop)
        wp.launch(drawing.halve_over, part[2:], [self._fine, *part[:2]], [self._pixels], device="cpu")
        return self._pixels.numpy()[..., :3].astype(np.uint8)  # a copy
