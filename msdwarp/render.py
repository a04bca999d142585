"""Pictures by PyVista, off-screen; where no OpenGL library exists, by the ray caster.

This is the only importer of PyVista, and imports it when the first picture is drawn.
"""

import os
import warnings
import weakref
from typing import Any, Protocol

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from . import checks
from .kernels.drawing import halve_over
from .legend import with_bar
from .opengl import ADVICE, opengl_window
from .picture import HEAD, KEY, SHADOW, VIEW_ANGLE, Camera, Drawing, Ground, Scale, in_view
from .raycast import RayCaster
from .scene import Scene, rgb


class Backend(Protocol):
    """Draws one picture of a drawing as it stands."""

    def draw(self, *, shadows: bool = True) -> NDArray[np.uint8]:
        """Return the picture, with shadows on the ground or without, uint8 of shape [height, width, 3]."""
        ...


class Renderer:
    """Draws the frames of a scene, all with one camera.

    Parameters
    ----------
    scene
        What is drawn.
    positions
        Positions that the camera must keep in view [m], shape [..., d]: of one frame, or of many. Solid
        colliders it keeps in view too, wherever they are while the scene lasts.
    resolution
        Width and height in pixels.
    colouring
        "texture" for the surface as it looks, "strain" for connections from green (rest) to red (strained), or
        a `Scale` for the surface, or connections where there is none, in the colours of values that come with
        each frame; by default what the scene's look says.
    backend
        "opengl" (PyVista), "raycast", or "auto": PyVista where an OpenGL library is found.
    zoom
        How many times nearer the camera comes than where it sees everything, above 0.

    Raises
    ------
    ValueError
        If an argument is out of its range, or there is nothing to draw.
    RuntimeError
        If OpenGL is asked for where there is none.
    """

    def __init__(
        self,
        scene: Scene,
        positions: NDArray,
        *,
        resolution: tuple[int, int] = (1280, 720),
        colouring: str | Scale | None = None,
        backend: str = "auto",
        zoom: float = 1.0,
    ) -> None:
        checks.one_of("backend", backend, ("auto", "opengl", "raycast"))
        self.width, self.height = (checks.count("resolution", n, 16) for n in resolution)
        if colouring is None:
            colouring = "strain" if scene.look.strain else "texture"
        self.drawing = Drawing(scene, colouring)
        self.look = scene.look
        positions, self._shape = np.asarray(positions), scene.system.position.shape
        if positions.ndim < 2 or positions.shape[-1] != scene.system.dim or positions.size == 0:
            raise ValueError(f"positions has shape {positions.shape}; it must be (..., {scene.system.dim})")
        checks.every("positions", positions, np.isfinite(positions), "finite")
        points = in_view(scene, positions)
        zoom = checks.positive("zoom", zoom)
        self.camera = Camera.that_sees(points, scene.look, self.width / self.height, zoom=zoom)
        self.ground = Ground(scene, points) if scene.ground else None
        window = opengl_window()
        if backend == "opengl" and window is None:
            raise RuntimeError(f"no OpenGL library was found; {ADVICE}")
        self.uses_opengl = backend != "raycast" and window is not None
        if self.uses_opengl:
            if window:
                os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = window
            self._backend: Backend = OpenGL(self)
        else:
            self._backend = RayCaster(self.drawing, self.camera, self.ground, self.look, (self.width, self.height))

    def image(self, position: NDArray, time: float = 0.0, values: ArrayLike | None = None) -> NDArray[np.uint8]:
        """Return the picture of a frame, uint8 of shape [height, width, 3].

        Parameters
        ----------
        position
            Particle positions [m], shape [particle_count, d].
        time
            When that is [s]: where moving colliders are drawn.
        values
            A number per particle, in the unit of the `Scale` that the colouring is, shape [particle_count];
            None where it is none.

        Raises
        ------
        ValueError
            If `position` or `values` is not finite or not of the system's shape, or values are missing or not
            asked for.
        """
        return self.with_legend(self.bare(position, time, values=values))

    def bare(
        self,
        position: NDArray | None,
        time: float = 0.0,
        *,
        shadows: bool = True,
        values: ArrayLike | None = None,
    ) -> NDArray[np.uint8]:
        """Return the picture of a frame without a legend; without the body where `position` is None.

        Raises
        ------
        ValueError
            If `position` or `values` is not finite or not of the system's shape, or values are missing or not
            asked for.
        """
        if position is None:
            self.drawing.follow_without_body(self.camera.eye - self.camera.forward, time)
            return self._backend.draw(shadows=shadows)
        position = np.asarray(position)
        if position.shape != self._shape:
            raise ValueError(f"position has shape {position.shape}; it must be {self._shape}")
        checks.every("position", position, np.isfinite(position), "finite")
        self.drawing.follow(position, time, self._checked(values))
        return self._backend.draw(shadows=shadows)

    def _checked(self, values: ArrayLike | None) -> NDArray[np.float64] | None:
        """Return values of the particles, where the drawing is by value; raise ValueError unless they are."""
        if not self.drawing.by_value:
            if values is not None:
                raise ValueError("values is given; it must be None unless the colouring is a Scale")
            return None
        shape = self._shape[:1]
        if values is None:
            raise ValueError(f"values is None; it must have the shape {shape}, since the colouring is a Scale")
        given = checks.array("values", values)
        if given.shape != shape:
            raise ValueError(f"values has shape {given.shape}; it must be {shape}")
        checks.every("values", given, np.isfinite(given), "finite")
        return given

    def with_legend(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return a picture with the bar of what its colours tell, where they tell something."""
        scale = self.drawing.scale
        return image if scale is None else with_bar(image, scale, self.drawing.stops)


class OpenGL:
    """Draws with PyVista: one plotter for all pictures, whose points are updated in place.

    Pictures are drawn twice as fine in either direction and averaged: smooth edges on any OpenGL. The camera
    stands still, so the ground is drawn once, and every picture laid over it.
    """

    def __init__(self, renderer: Renderer) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of VTK's and PyVista's own making, at import
            import pyvista as pv

        self.drawing, self.ground, self.camera = renderer.drawing, renderer.ground, renderer.camera
        shape = (renderer.height, renderer.width)
        height, width = (2 * n for n in shape)
        self._plotter = self._stage(pv, (width, height))
        # What OpenGL draws is read back into memory that Warp sees too.
        self._read = pv.convert_array(np.zeros((width * height, 4), np.uint8))
        fine = pv.convert_array(self._read).reshape(height, width, 4)
        self._fine = wp.array(fine.view(np.uint32)[..., 0], dtype=wp.uint32, device="cpu", copy=False)
        red, green, blue = (round(255 * c) for c in rgb("background", renderer.look.background))
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
        self._body = self._add_body(pv)

    def _stage(self, pv: Any, size: tuple[int, int]) -> Any:
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
        shadow = self._triangles(pv)
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

    def _add_body(self, pv: Any) -> Any:
        drawing, body = self.drawing, self._triangles(pv)
        # On the CPU these arrays share Warp's memory: they change as the drawing follows the particles.
        body.points = drawing.points.numpy()
        body.point_data["Normals"] = drawing.normals.numpy()
        body.GetPointData().SetActiveNormals("Normals")
        style: dict[str, Any] = {"smooth_shading": False, "show_scalar_bar": False}
        style |= {"ambient": drawing.ambient, "diffuse": drawing.diffuse}
        style |= {"specular": drawing.gloss, "specular_power": 30.0}
        if drawing.texture is not None:
            body.active_texture_coordinates = drawing.uv
            style["texture"] = pv.Texture(np.ascontiguousarray(drawing.texture))
        else:
            body.point_data["colours"] = (255 * drawing.colours.numpy()).astype(np.uint8)
            style |= {"scalars": "colours", "rgb": True}
        actor = self._plotter.add_mesh(body, **style)
        actor.prop.interpolation = "Phong"
        if self.ground is not None:
            self._only_above_ground(pv, actor, drawing.below)
        return body

    def _triangles(self, pv: Any) -> Any:
        points = np.zeros((len(self.drawing.points), 3), np.float32)
        return pv.PolyData.from_regular_faces(points, self.drawing.triangles)

    def draw(self, *, shadows: bool = True) -> NDArray[np.uint8]:
        """Return the picture of the drawing as it stands, uint8 of shape [height, width, 3]."""
        drawing, body = self.drawing, self._body
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
