"""What moves in pictures: the triangles that follow the particles and the colliders, and their colours."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

from .. import checks
from ..bodies import System, in_space
from ..kernels.pictures import STRAIN_STOPS, VALUE_STOPS, lift
from ..quiet import in_turn
from ..world import Collider, Look, Scene
from .atlas import atlas, plain
from .collider_meshes import Mesh, meshes, walls
from .dressing import (
    inside_of,
    look_of_particles,
    look_of_triangles,
    outermost_connections,
    part_of,
    torn,
    uncovered,
)
from .light import AMBIENT, BOUNCE, EVEN_AMBIENT, EVEN_SHARE, towards_key
from .parts import Balls, BodyPart, Finish, Obstacle, Paint, Part, StrainPaint, SurfacePart, Tubes, ValuePaint
from .stage import axes_of

COLOURINGS = ("texture", "strain")
TUBE, BALL = 0.045, 0.11
"""Radii of connections and of particles over the median rest length, unless a look says otherwise."""
INK, PINNED = (0.27, 0.31, 0.36), (0.10, 0.11, 0.13)
"""Colours of free and of pinned particles."""
MOST_BALLS, LARGE_BALLS = 200, 50
"""Particles of the largest system whose particles are drawn as balls unless the look says otherwise, and of the
largest whose balls are large enough in the picture to deserve 162 corners, else 42."""
MOST_TUBES = 6000
"""Where strain is shown of more connections, those inside a body, which others hide, are not drawn."""
FULL_STRAIN = 0.2
"""The strain at the ends of its scale where neither a look nor a run says what it is."""
ROUND, MOST_JOINTS = 8, 2000
"""Sides of the tubes of ropes, and the most particles where balls of 42 corners join these, else of 12."""


class ColourScale(NamedTuple):
    """A colour scale for any quantity of the particles, such as their speed."""

    label: str
    """The quantity with its unit: "speed [m/s]"."""
    full: float
    """The value at the end of the scale, above 0; larger values have the same colour."""
    signed: bool = False
    """Whether the scale starts at minus `full` instead of 0."""


class PlacedPart(NamedTuple):
    """A part of a drawing, and its own vertices: a slice of each of the drawing's arrays, on the device."""

    part: Part
    vertices: slice
    """Which vertices of the drawing are its own."""
    points: wp.array
    """Where they are [m], vec3."""
    normals: wp.array
    """Unit vectors, vec3."""
    colours: wp.array
    """Red, green and blue in 0 … 1, vec3."""

    @property
    def triangles(self) -> NDArray[np.int32]:
        """Its triangles, by the drawing's vertices, shape [any, 3]."""
        return self.part.triangles + np.int32(self.vertices.start)

    def follow(self, x: wp.array, time: float) -> None:
        """Move to where the part is when the particles are at x and it is `time` [s]."""
        self.part.place(x, time, self.points, self.normals)


class Drawing:
    """Triangles that follow the particles and the colliders, on the CPU or another device.

    The surface of the system, and a tube along each connection of bodies that have none, or between bodies. Where
    `colouring` is "strain", or there is neither a surface nor a look of a group, there is a tube along each
    connection and, in small systems, a ball at each particle. Behind them are the solid colliders. What the
    system's `broken_at` says is broken by the time of a frame is not drawn. `points`, `normals` and `colours` are
    float32 of shape [vertex_count, 3], `gloss` of [triangle_count]. `body` are the parts that follow the
    particles, `obstacles` those of the colliders. `scale` is what colours tell: of values of the particles, of the
    strain of connections, or None where they tell nothing.
    """

    @in_turn
    def __init__(self, scene: Scene, colouring: str | ColourScale, device: str = "cpu") -> None:
        system, look = scene.system, scene.look
        self.by_value = isinstance(colouring, ColourScale)
        """Whether the body takes the colours of values, which it is given as it follows the particles."""
        bare = system.surface is None
        plain = not scene.looks and not look.says_colour
        self.shows_strain = colouring == "strain" or (bare and plain and not self.by_value)
        self._plain_tubes = self.shows_strain or (bare and self.by_value)
        self._full_strain = FULL_STRAIN if look.full_strain is None else look.full_strain
        self._paints: dict[Part, Paint] = {}
        self.scale = self._scale_of(colouring)
        even = self.by_value
        self.ambient, self.diffuse = (EVEN_AMBIENT, EVEN_SHARE) if even else (AMBIENT, 1.0)
        self.bounce = 0.0 if even else BOUNCE
        self.device = device
        body = self._body_of(scene)
        finish = self._finish(checks.colour("obstacle", look.obstacle), look.obstacle_texture, look.obstacle_gloss)
        obstacles = [
            Obstacle(one, mesh, system.dim, finish, device) for one, mesh in [*meshes(scene), *_walls(scene)]
        ]
        parts = [*body, *obstacles]
        self.below = max(part.radius for part in parts)
        """How far below the ground something may be and still be seen [m]: what is drawn around particles."""

        vertex_count = sum(len(part.uv) for part in parts)
        self.points = wp.zeros(vertex_count, dtype=wp.vec3, device=device)
        self.normals = wp.zeros(vertex_count, dtype=wp.vec3, device=device)
        self.colours = wp.zeros(vertex_count, dtype=wp.vec3, device=device)
        placed = self._placed(parts)
        self.triangles = np.concatenate([one.triangles for one in placed])
        self.gloss = np.repeat([part.finish.gloss for part in parts], [len(part.triangles) for part in parts])
        self.closed = np.repeat([part.closed for part in parts], [len(part.triangles) for part in parts])
        """Which triangles have backs that are never seen, shape [triangle_count]."""
        takes_shadows = [not (self.colours_move and k < len(body)) for k in range(len(parts))]
        self.takes_shadows = np.repeat(takes_shadows, [len(part.triangles) for part in parts])
        """Which triangles are darker in shadow, shape [triangle_count]: those whose colours tell nothing."""
        self.texture, uvs = self._textured(parts)
        self.uv = np.concatenate(uvs).astype(np.float32)
        paint = np.ones((vertex_count, 3))  # white shows a texture as it is
        if self.texture is None:
            for one in placed:
                paint[one.vertices] = one.part.finish.colour
        self.colours.assign(paint)

        self._x = wp.zeros(system.particle_count, dtype=wp.vec3, device=device)
        self._shares = wp.zeros(system.particle_count, dtype=float, device=device)
        self.body, self.obstacles = placed[: len(body)], placed[len(body) :]
        self.in_sight = slice(0, vertex_count)
        """The vertices of what is drawn at all: those of obstacles where it follows without the body."""
        if self.by_value:
            self._paints = {part: ValuePaint(part, device) for part in body}
        self._painted = [
            (self._paints[part], one) for part, one in zip(body, self.body, strict=True) if part in self._paints
        ]
        self._moving = [one for one, obstacle in zip(self.obstacles, obstacles, strict=True) if obstacle.moves]
        for one in self.obstacles:
            one.follow(self._x, 0.0)

    def _placed(self, parts: Sequence[Part]) -> list[PlacedPart]:
        """Return the parts with the vertices that are their own, one part's behind another's."""
        arrays: list[Any] = [self.points, self.normals, self.colours]  # Warp's types say too little of slices
        placed: list[PlacedPart] = []
        first = 0
        for part in parts:
            own = slice(first, first + len(part.uv))
            placed.append(PlacedPart(part, own, *(array[own] for array in arrays)))
            first = own.stop
        return placed

    def _scale_of(self, colouring: str | ColourScale) -> ColourScale | None:
        """Return what the colours tell; raise ValueError if there is no such colouring."""
        if isinstance(colouring, ColourScale):
            return colouring._replace(full=checks.positive("colouring.full", colouring.full))
        checks.one_of("colouring", colouring, COLOURINGS)
        return (
            ColourScale("strain (below 0: shorter than at rest)", self._full_strain, True)
            if self.shows_strain
            else None
        )

    @property
    def colours_move(self) -> bool:
        """Whether the body's colours change from frame to frame, and need a legend."""
        return self.scale is not None

    @property
    def stops(self) -> tuple[tuple[float, float, float], ...]:
        """Colours of the scale, evenly spaced from its start to its end."""
        return VALUE_STOPS if self.by_value else STRAIN_STOPS

    def _body_of(self, scene: Scene) -> list[BodyPart]:
        """Return the parts that follow the particles, look by look."""
        system, of_particle = scene.system, look_of_particles(scene)
        surface = None if self.shows_strain else system.surface
        of_triangle = np.zeros(0, int) if surface is None else look_of_triangles(surface, of_particle)
        drawn = np.ones(system.connection_count, dtype=bool) if surface is None else uncovered(system)
        if (between := system.between_neighbours) is not None:  # the others lie along two of these
            drawn = drawn & between
        if self.shows_strain and np.count_nonzero(drawn) > MOST_TUBES:
            drawn = drawn & outermost_connections(system)
        shown = np.flatnonzero(drawn)
        of_connection = of_particle[system.connections[shown]].max(axis=1)
        tears = None if surface is None else torn(system)
        body: list[BodyPart] = []
        for k, look in enumerate((scene.look, *scene.looks.values())):
            finish = self._finish(checks.colour("colour", look.colour), look.texture, look.gloss)
            if surface is not None and (mine := of_triangle == k).any():
                part = part_of(surface, mine)
                parted = None if tears is None else tears.parted_at[mine]
                body.append(SurfacePart(part, finish, look.smooth, self.device, parted))
            if tears is not None and (bare := of_particle[tears.bare.triangles].max(axis=1) == k).any():
                crumb = Finish(np.array(checks.colour("inside", look.inside or look.colour)))
                times = tears.bare.until[bare], tears.bare.since[bare]
                body.append(SurfacePart(inside_of(tears.bare.triangles[bare]), crumb, False, self.device, *times))
            own = shown[of_connection == k]
            particles = np.flatnonzero(of_particle == k)
            if self._plain_tubes and len(own) + len(particles):
                body += self._tubes_and_balls(system, look, own, particles)
            elif len(own):
                body += self._ropes(system, look, own, finish._replace(texture=None))
        return body

    def _tubes_and_balls(
        self, system: System, look: Look, connections: NDArray, particles: NDArray
    ) -> list[BodyPart]:
        """Return connections as thin tubes, and particles as dark balls if there are few."""
        rest_length = system.rest_length[connections]
        unit = _unit(look, rest_length)
        ends, broken_at = system.connections[connections], _broken_at(system, connections)
        tubes = Tubes(ends, TUBE * unit, Finish(np.ones(3)), self.device, broken_at=broken_at)
        if self.shows_strain:
            self._paints[tubes] = StrainPaint(tubes, rest_length, self._full_strain, self.device)
        few = system.particle_count <= MOST_BALLS
        if not (look.particles or (look.particles is None and few)):
            return [tubes, *self._bends(ends, rest_length, TUBE * unit)]
        dark = Finish(np.where(system.pinned[particles, None], PINNED, INK))
        halvings = 2 if system.particle_count <= LARGE_BALLS else 1
        return [tubes, Balls(particles, BALL * unit, dark, self.device, halvings=halvings)]

    def _ropes(self, system: System, look: Look, connections: NDArray, finish: Finish) -> list[BodyPart]:
        """Return connections as round tubes in the colour of a look, with balls where they meet."""
        ends, unit = system.connections[connections], _unit(look, system.rest_length[connections])
        broken_at = _broken_at(system, connections)
        tubes = Tubes(ends, TUBE * unit, finish, self.device, sides=ROUND, broken_at=broken_at)
        joints = np.unique(ends)
        halvings = 1 if len(joints) <= MOST_JOINTS or look.particles else 0
        radius = (BALL if look.particles else TUBE) * unit
        return [tubes, Balls(joints, radius, finish, self.device, halvings=halvings)]

    def _bends(self, ends: NDArray, rest_length: NDArray, radius: float) -> list[BodyPart]:
        """Return balls where two connections meet, in the colour of one of them: between more, no gap is seen."""
        particle, first, count = np.unique(ends, return_index=True, return_counts=True)
        bends, along = particle[count == 2], first[count == 2] // 2
        if not len(bends):
            return []
        balls = Balls(bends, radius, Finish(np.ones(3)), self.device, halvings=0, along=ends[along])
        if self.shows_strain:
            self._paints[balls] = StrainPaint(balls, rest_length[along], self._full_strain, self.device)
        return [balls]

    def _finish(self, colour: tuple[float, float, float], texture: NDArray | None, gloss: float) -> Finish:
        """Return what a part looks like, which does not shine where colours tell something."""
        return Finish(np.array(colour), texture, 0.0 if self.colours_move else gloss)

    def _textured(self, parts: Sequence[Part]) -> tuple[NDArray | None, list[NDArray]]:
        """Return the texture of all parts, and their coordinates in it; without any where none has one."""
        uvs, finishes = [part.uv for part in parts], [part.finish for part in parts]
        if self.colours_move or all(finish.texture is None for finish in finishes):
            return None, uvs
        images: dict[object, NDArray] = {}
        keys: list[object] = []
        for colour, texture, _ in finishes:
            keys.append(tuple(colour) if texture is None else id(texture))
            images.setdefault(keys[-1], plain(tuple(colour)) if texture is None else np.asarray(texture))
        if len(images) == 1:
            return images[keys[0]], uvs
        texture, moves = atlas(list(images.values()))
        move_of = dict(zip(images, moves, strict=True))
        return texture, [move_of[key](uv) for key, uv in zip(keys, uvs, strict=True)]

    @in_turn
    def follow(self, position: NDArray | wp.array, time: float = 0.0, values: NDArray | None = None) -> None:
        """Move to particle positions [m], shape [particle_count, d], and colliders to where they are at `time`.

        Positions may be an array of Warp on the drawing's device, of vectors with d coordinates. Where the drawing
        is by value, the body takes the colours of `values`, shape [particle_count].
        """
        self.in_sight = slice(0, len(self.points))
        if isinstance(position, wp.array):
            wp.launch(lift(position.dtype), len(position), [position], [self._x], device=self.device)
        else:
            self._x.assign(in_space(position))
        if self.scale is not None and values is not None:
            self._shares.assign((values / self.scale.full).astype(np.float32))
        for one in (*self.body, *self._moving):
            one.follow(self._x, time)
        for paint, one in self._painted:
            paint.apply(self._x, self._shares, one.colours)

    @in_turn
    def follow_without_body(self, out_of_sight: NDArray, time: float = 0.0) -> None:
        """Move colliders to where they are at `time`, and all of the body to one point [m], shape [3]."""
        self.in_sight = slice(sum(len(one.points) for one in self.body), len(self.points))
        for one in self.body:
            one.points.fill_(wp.vec3(*out_of_sight))
        for one in self._moving:
            one.follow(self._x, time)


def _walls(scene: Scene) -> list[tuple[Collider, Mesh]]:
    """Return the planes beside the ground that the camera and the key light see."""
    right, _, back = axes_of(scene.look)
    return walls(scene, [back, towards_key(right, -back)])


def _broken_at(system: System, connections: NDArray) -> NDArray[np.float64] | None:
    """Return when some connections broke [s], shape [any]; None where none can."""
    return np.array(system.broken_at[connections]) if system.tears else None


def _unit(look: Look, rest_length: NDArray) -> float:
    """Return that of which TUBE and BALL are shares [m]."""
    if look.tube is not None:
        return look.tube / TUBE
    return float(np.median(rest_length)) if len(rest_length) else 0.0
