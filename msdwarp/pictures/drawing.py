"""The moving part of pictures: triangles that follow particles and colliders, with colors."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray
from warp.utils import array_cast

from .. import checks
from ..bodies import AXES, Surface, System, in_space
from ..kernels.pictures import drawing
from ..runtime import ReleasedInTurn, in_turn
from ..shapes import Section
from ..world import FINISHES, Look, Scene, radii
from .collider_meshes import meshes, walls
from .dressing import (
    OBSTACLES,
    atlas,
    inside_color,
    inside_of,
    look_of_particles,
    look_of_triangles,
    outermost_connections,
    part_of,
    particles_of,
    seams,
    single_particles,
    size_of_grains,
    spacing_beside,
    torn,
    uncovered,
)
from .light import KEY_FROM, towards
from .parts import Balls, Finish, Obstacle, Part, SurfacePart, Tubes
from .sheets import Sheet, kept_off, triangles_of_sheets
from .stage import axes_of

COLORINGS = ("texture", "strain")
TUBE, BALL = 0.045, 0.11
"""Radii of springs and of particles over the median rest length, unless a look says otherwise."""
THREAD = 0.02
"""Radius of seams over the spacing of the meshes that they join, unless a look says otherwise."""
INK, PINNED = (0.27, 0.31, 0.36), (0.10, 0.11, 0.13)
"""Colors of free and of pinned particles."""
MOST_BALLS, LARGE_BALLS = 200, 50
"""Maximal number of particles drawn as balls by default, and of those with 162 vertices instead of 42."""
MOST_TUBES = 6000
"""If more springs are colored by strain, only those on the outside of a body are drawn; they hide the others."""
FULL_STRAIN = 0.2
"""Default strain at the ends of the color scale of strain."""
ROUND, MOST_JOINTS = 8, 2000
"""Sides of the tubes of ropes; maximal number of joints with balls of 42 vertices, else of 12."""
MOST_GRAINS = (50, 500, 5000)
"""Maximal numbers of single particles that are balls of 642, 162 and 42 vertices; more have 12."""


class ColorScale(NamedTuple):
    """A color scale for any quantity of the particles, such as their speed.

    Attributes
    ----------
    label
        The quantity with its unit: "speed [m/s]".
    full
        The value at the end of the scale, above 0; larger values have the same color.
    signed
        Whether the scale starts at minus `full` instead of 0.
    """

    label: str
    full: float
    signed: bool = False


class Drawing(ReleasedInTurn):
    """Triangles that follow the particles and the colliders, on the CPU or another device.

    Drawn are the system's surface, and tubes along springs between bodies or of bodies without surface. If colors
    show strain, or there is neither a surface nor a look of a group, tubes along all springs are drawn instead,
    and in small systems balls at particles. Single particles, which nothing joins, are balls of their radius in
    contact, or of a radius that fits them. Solid colliders come last. A spring disappears when it breaks
    (`System.broken_at`). If `bodies` names groups, only these are drawn, and no obstacles unless it names
    "obstacles".

    Attributes
    ----------
    points, normals, colors
        Of the vertices, Warp arrays of vec3, shape [vertex_count].
    gloss, closed, takes_shadows, finish, glass
        Of the triangles, shape [triangle_count]: the strength of highlights, whether back faces are hidden,
        whether shadows fall on it, its number in `FINISHES`, and whether one sees through it.
    body, obstacles
        The parts that follow the particles, and those of the colliders.
    scale, stops
        The `ColorScale`, None if colors show no quantity; and the colors evenly along a scale.
    """

    @in_turn
    def __init__(
        self, scene: Scene, coloring: str | ColorScale, device: str = "cpu", bodies: Sequence[str] = ()
    ) -> None:
        system, look = scene.system, scene.look
        self.by_value = isinstance(coloring, ColorScale)
        bare = system.surface is None and system.connection_count > 0
        plain = not scene.looks and not look.says_color
        self.shows_strain = coloring == "strain" or (bare and plain and not self.by_value)
        self._plain_tubes = self.shows_strain or (bare and self.by_value)
        self._radius = radii(scene.contact_rules, system)
        self._full_strain = FULL_STRAIN if look.full_strain is None else look.full_strain
        self.stops = drawing.VALUE_STOPS if self.by_value else drawing.STRAIN_STOPS
        self._stops = wp.array(self.stops, dtype=wp.vec3, device=device)
        self.scale: ColorScale | None = None
        if isinstance(coloring, ColorScale):
            self.scale = coloring._replace(full=checks.positive("coloring.full", coloring.full))
        else:
            checks.one_of("coloring", coloring, COLORINGS)
            if self.shows_strain:
                self.scale = ColorScale("strain (below 0: shorter than at rest)", self._full_strain, True)
        self.colors_move = self.scale is not None
        self.device = device
        self.body = self._body_of(scene, particles_of(system, bodies))
        finish = self._finish(checks.color("obstacle", look.obstacle), look.obstacle_texture, look.obstacle_gloss)
        backs = [axes_of(view)[2] for view in look.views]
        right = axes_of(look.views[0])[0]
        solids = [*meshes(scene), *walls(scene, [*backs, towards(KEY_FROM, right, -backs[0])])]
        solids = solids if not bodies or OBSTACLES in bodies else []
        self.obstacles = [Obstacle(one, mesh, system.dim, finish, device) for one, mesh in solids]
        for part in self.obstacles:
            part.name = "obstacle"
        parts = [*self.body, *self.obstacles]
        if look.cut is not None and not self.body and OBSTACLES not in bodies:
            of = f" of {', '.join(bodies)}" if bodies else ""
            raise ValueError(f"look.cut is {look.cut}, which leaves nothing{of} to draw; it must leave something")
        if not parts:
            raise ValueError(f"body is {', '.join(bodies)}; nothing of it can be drawn")
        self.radius = max(part.radius for part in parts)
        """Reach of what is drawn around the particles [m]; triangles are drawn down to it below the ground."""

        ends = np.cumsum([0, *(len(part.uv) for part in parts)]).tolist()
        arrays: list[Any] = [wp.zeros(ends[-1], dtype=wp.vec3, device=device) for _ in range(3)]
        self.points, self.normals, self.colors = arrays
        for part, (start, end) in zip(parts, pairwise(ends), strict=True):
            part.join(slice(start, end), *arrays)
        self.triangles = np.concatenate([part.triangles for part in parts])
        counts = [len(part.triangles) for part in parts]
        self.gloss = np.repeat([part.finish.gloss for part in parts], counts)
        numbers = {reflectance: k for k, reflectance in enumerate(FINISHES.values())}
        self.finish = np.repeat([numbers[part.finish.reflectance] for part in parts], counts).astype(np.int32)
        self.glass = np.array([one.opacity < 1 for one in FINISHES.values()])[self.finish]
        self.closed = np.repeat([part.closed for part in parts], counts)
        takes_shadows = [not (self.colors_move and k < len(self.body)) for k in range(len(parts))]
        self.takes_shadows = np.repeat(takes_shadows, counts)
        self.texture, uvs = self._textured(parts)
        self.uv = np.concatenate(uvs).astype(np.float32)
        paint = np.ones((ends[-1], 3))  # white leaves a texture unchanged
        if self.texture is None:
            for part in parts:
                paint[part.vertices] = part.finish.color
        self.colors.assign(paint)

        self._x = wp.zeros(system.particle_count, dtype=wp.vec3, device=device)
        self._fractions = wp.zeros(system.particle_count, dtype=float, device=device)
        self.visible = slice(0, ends[-1])
        """The vertices that are drawn: without the body, those of obstacles."""
        self._moving = [one for one in self.obstacles if one.moves]
        for one in self.obstacles:
            one.follow(self._x, 0.0)

    def _body_of(self, scene: Scene, chosen: NDArray[np.bool_]) -> list[Part]:
        """Return the parts that move with chosen particles, such as surfaces and springs, grouped by `Look`."""
        system, of_particle = scene.system, look_of_particles(scene)
        section, plane = None, scene.look.cut
        if plane is not None:
            section = Section(system, plane.unit_normal(system.dim), plane.offset)
        surface = None if self.shows_strain else system.surface

        def looks_of(triangles: Surface | None) -> NDArray:
            """Return the number of each triangle's look, -1 if it is not drawn, shape [triangle_count]."""
            if triangles is None:
                return np.zeros(0, int)
            return np.where(triangles.triangles_in(chosen), look_of_triangles(scene, triangles), -1)

        of_triangle = looks_of(surface)
        obstacles = kept_off(scene)
        of_sheet = (
            triangles_of_sheets(system) if len(of_triangle) and obstacles else np.zeros(len(of_triangle), bool)
        )
        drawn = np.ones(system.connection_count, dtype=bool) if surface is None else uncovered(system)
        if (between := system.between_neighbors) is not None:  # springs to second neighbours lie along two others
            drawn = drawn & between
        remain = chosen if section is None else chosen & section.below
        kept = np.asarray(remain[system.connections].all(axis=1))
        drawn = drawn & kept
        if self.shows_strain and np.count_nonzero(drawn) > MOST_TUBES:
            drawn = drawn & outermost_connections(system, kept)
        shown = np.flatnonzero(drawn)
        of_connection, of_seam = of_particle[system.connections[shown]].max(axis=1), seams(system)[shown]
        tears = None if surface is None else torn(system)
        of_bare = looks_of(None if tears is None else inside_of(tears.triangles))
        parted_at, inside, until = None if tears is None else tears.parted_at, None, None
        if surface is not None and section is not None:
            clipped = section.clip(surface)
            surface, source = clipped.surface, clipped.source
            of_triangle, of_sheet = of_triangle[source], of_sheet[source]
            parted_at = None if parted_at is None else parted_at[source]
            inside, until = section.inside(clipped)
        of_inside = looks_of(inside)
        alone = single_particles(system)
        body: list[Part] = []
        for k, (name, look) in enumerate((("body", scene.look), *scene.looks.items())):
            before = len(body)
            finish = self._finish(checks.color("color", look.color), look.texture, look.gloss, look.finish)
            for bends in (False, True):
                if surface is None or not (mine := (of_triangle == k) & (of_sheet == bends)).any():
                    continue
                part = part_of(surface, mine)
                parted = None if parted_at is None else parted_at[mine]
                parts = parted is not None and np.isfinite(parted).any()
                flat = SurfacePart(part, finish, look.smooth, self.device, parted if parts else None)
                corners = part.points(system.position)[part.triangles]
                body.append(Sheet(flat, corners, system.pinned, obstacles, self.device) if bends else flat)
            crumb = Finish(inside_color(look))
            if tears is not None and (bare := of_bare == k).any():
                faces, times = inside_of(tears.triangles[bare]), (tears.until[bare], tears.since[bare])
                if section is not None:
                    faces, source, *_ = section.clip(faces)
                    times = times[0][source], times[1][source]
                body.append(SurfacePart(faces, crumb, False, self.device, *times))
            if inside is not None and (mine := of_inside == k).any():
                last = None if until is None else until[mine]
                body.append(SurfacePart(part_of(inside, mine), crumb, True, self.device, last))
            own, plain = shown[of_connection == k], finish._replace(texture=None)
            particles = np.flatnonzero((of_particle == k) & remain & ~alone)
            grains = np.flatnonzero((of_particle == k) & remain & alone)
            if self._plain_tubes and len(own) + len(particles):
                body += self._tubes_and_balls(system, look, own, particles)
            elif len(own):
                sewn = of_seam[of_connection == k]
                body += self._ropes(system, look, own[~sewn], plain)
                body += self._threads(system, look, own[sewn], plain)
            if len(grains):
                body += self._grains(system, look, grains, plain)
            for part in body[before:]:
                part.name = name
        return body

    def _grains(self, system: System, look: Look, grains: NDArray, finish: Finish) -> list[Part]:
        """Return single particles as balls, in the color of a look, or dark where colors show strain."""
        radius = self._radius[grains]
        if not radius.all():
            radius[radius == 0] = look.tube or size_of_grains(system, single_particles(system))
        if self.shows_strain:
            finish = Finish(np.array(INK))
        halvings = sum(len(grains) <= most for most in MOST_GRAINS)
        parts: list[Part] = []
        for one in np.unique(radius):
            parts.append(Balls(grains[radius == one], one, finish, self.device, halvings))
            parts[-1].is_one_body = True
        return parts

    def _tubes_and_balls(self, system: System, look: Look, shown: NDArray, particles: NDArray) -> list[Part]:
        """Return springs as thin tubes, with dark balls at the particles of small systems.

        Without these balls ropes are round tubes, with balls in their color where tubes meet.
        """
        unit, white = self._unit(system, look, shown), Finish(np.ones(3))
        few = system.particle_count <= MOST_BALLS
        dotted = look.particles or (look.particles is None and few)
        # A rope has at most two springs at a particle; where there are more, neither gaps nor edges are visible.
        count = np.bincount(system.connections[shown].ravel(), minlength=system.particle_count)
        rope = (count[system.connections[shown]].min(axis=1, initial=3) <= 2) & (not dotted)
        parts: list[Part] = []
        for own, sides in ((shown[~rope], 3), (shown[rope], ROUND)):
            if len(own) or not len(shown):
                parts.append(self._tubes(system, unit, own, white, sides))
                parts[-1].take_strain_of(system.connections[own], system.rest_length[own], self.device)
        if dotted:
            dark = Finish(np.where(system.pinned[particles, None], PINNED, INK))
            halvings = 2 if system.particle_count <= LARGE_BALLS else 1
            parts.append(Balls(particles, BALL * unit, dark, self.device, halvings))
        elif rope.any():  # balls in the color of one of the springs
            joints, first = np.unique(system.connections[shown[rope]], return_index=True)
            joints, along = joints[count[joints] <= 2], shown[rope][first[count[joints] <= 2] // 2]
            parts.append(Balls(joints, TUBE * unit, white, self.device, int(len(joints) <= MOST_BALLS)))
            parts[-1].take_strain_of(system.connections[along], system.rest_length[along], self.device)
        return parts

    def _ropes(self, system: System, look: Look, shown: NDArray, finish: Finish) -> list[Part]:
        """Return springs as round tubes in the color of a look, with balls where they meet."""
        if not len(shown):
            return []
        joints = np.unique(system.connections[shown])
        radius = self._radius[joints].max() if look.tube is None else 0.0
        unit = radius / TUBE or self._unit(system, look, shown)
        halvings = 1 if len(joints) <= MOST_JOINTS or look.particles else 0
        balls = Balls(joints, (BALL if look.particles else TUBE) * unit, finish, self.device, halvings)
        tubes = self._tubes(system, unit, shown, finish, ROUND)
        tubes.of_rope, balls.of_rope = True, not look.particles
        return [tubes, balls]

    def _threads(self, system: System, look: Look, shown: NDArray, finish: Finish) -> list[Part]:
        """Return springs between surfaces, which hide their ends, as thin tubes in the color of a look."""
        if not len(shown):
            return []
        radius = THREAD * spacing_beside(system, shown) if look.tube is None else look.tube
        tubes = self._tubes(system, radius / TUBE, shown, finish, ROUND)
        tubes.of_rope = True
        return [tubes]

    def _unit(self, system: System, look: Look, shown: NDArray) -> float:
        """Return the length unit of TUBE and BALL for some springs [m]."""
        if look.tube is not None:
            return look.tube / TUBE
        return float(np.median(system.rest_length[shown])) if len(shown) else 0.0

    def _tubes(self, system: System, unit: float, shown: NDArray, finish: Finish, sides: int) -> Tubes:
        """Return some springs as tubes."""
        broken_at = np.array(system.broken_at[shown]) if system.tears else None
        return Tubes(system.connections[shown], TUBE * unit, finish, self.device, sides, broken_at)

    def _finish(
        self, color: tuple[float, float, float], texture: NDArray | None, gloss: float, name: str = "matt"
    ) -> Finish:
        """Return a finish, matt and without highlights if colors show a quantity."""
        if self.colors_move:
            return Finish(np.array(color), texture)
        reflectance = FINISHES[name]
        return Finish(np.array(color), texture, gloss if reflectance.roughness < 1 else 0.0, reflectance)

    def _textured(self, parts: Sequence[Part]) -> tuple[NDArray | None, list[NDArray]]:
        """Return the texture of all parts, and their coordinates in it; None if no part has a texture."""
        uvs, finishes = [part.uv for part in parts], [part.finish for part in parts]
        if self.colors_move or all(finish.texture is None for finish in finishes):
            return None, uvs
        images: dict[object, NDArray] = {}
        keys: list[object] = []
        for color, texture, *_ in finishes:
            keys.append(tuple(color) if texture is None else id(texture))
            one_pixel = np.round(255 * color).astype(np.uint8)[None, None]
            images.setdefault(keys[-1], one_pixel if texture is None else np.asarray(texture))
        if len(images) == 1:
            return images[keys[0]], uvs
        texture, places = atlas(list(images.values()))
        place_of = dict(zip(images, places, strict=True))
        in_whole = [place_of[key] for key in keys]
        return texture, [corner + scale * uv for (corner, scale), uv in zip(in_whole, uvs, strict=True)]

    @in_turn
    def follow(self, position: NDArray | wp.array, time: float = 0.0, values: NDArray | None = None) -> None:
        """Move to particle positions [m], shape [particle_count, d], and to the colliders' poses at `time`.

        Positions may be a Warp array of vectors on the drawing's device. Colors by value show `values`, shape
        [particle_count].
        """
        self.visible = slice(0, len(self.points))
        if isinstance(position, wp.array):
            for k, axis in enumerate(AXES[wp.types.type_size(position.dtype)]):
                array_cast(_coordinate(position, k), _coordinate(self._x, axis))
        else:
            self._x.assign(in_space(position))
        if self.scale is not None and values is not None:
            self._fractions.assign((values / self.scale.full).astype(np.float32))
        for one in (*self.body, *self._moving):
            one.follow(self._x, time)
        for one in self.body:
            if self.by_value:
                one.show_value(self._fractions, self._stops)
            elif self.shows_strain:
                one.show_strain(self._x, self._full_strain, self._stops)

    @in_turn
    def follow_without_body(self, out_of_sight: NDArray, time: float = 0.0) -> None:
        """Move colliders to their poses at `time`, and all of the body to one point [m], shape [3]."""
        self.visible = slice(sum(len(one.points) for one in self.body), len(self.points))
        for one in self.body:
            one.points.fill_(wp.vec3(*out_of_sight))
        for one in self._moving:
            one.follow(self._x, time)


def _coordinate(vectors: Any, k: int) -> wp.array:
    """Return one coordinate of an array of vectors, in the same memory."""
    scalar = vectors.dtype._wp_scalar_type_
    start = vectors.ptr + k * wp.types.type_size_in_bytes(scalar)
    return wp.array(ptr=start, dtype=scalar, shape=vectors.shape, strides=vectors.strides, device=vectors.device)
