"""Frames of a trajectory as meshes with materials, as pictures show them, for files of other programs."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ... import checks
from ...bodies import in_space, mask_of, pieces
from ...files import DrawnFrame, DrawnMesh, Trajectory, finite_values, free_name
from ...pictures import Drawing, Obstacle, Part, Stage, Tubes, framed, uncovered
from ...world import FINISHES, Scene
from ..picture_options import Pictures, parse_resolution
from .quantities import dressed


class Piece(NamedTuple):
    """What of a drawing's part is one body."""

    part: Part
    mesh: DrawnMesh
    vertices: NDArray | slice
    triangles: NDArray | slice
    colors_move: bool
    rope: NDArray | None = None
    """Particles of a rope, which is drawn as curves; None for a mesh."""


def drawn(
    scene: Scene, trajectory: Trajectory, pictures: Pictures, numbers: Sequence[int], to: str
) -> tuple[Iterator[DrawnFrame], dict[str, Any]]:
    """Return frames of a trajectory for a file format, with what pictures show; see `files.export`.

    Bodies that are not joined are meshes of their own. usd and glb have obstacles too, usd also the ground, the
    camera and curves for ropes; the other formats have obstacles if they are among the chosen bodies.
    """
    every = range(len(trajectory))
    scene, coloring, values = dressed(scene, trajectory, pictures, every)
    drawing, stage, more = Drawing(scene, coloring, bodies=pictures.body), None, dict[str, Any]()
    solids, floor = drawing.obstacles if to in ("usd", "glb") or pictures.body else [], list[DrawnMesh]()
    found = bodies_of(drawing, [*drawing.body, *solids], scene, curves=to == "usd")
    if to == "usd":
        size, look = parse_resolution(pictures.resolution), scene.look
        aspect = size[0] / size[1]
        scene, seen = framed(scene, trajectory.positions, trajectory.times, every, aspect)
        stage = Stage(scene, seen, size, pictures.zoom, radius=drawing.radius)
        more = {"view_angle": look.field_of_view, "aspect": aspect, "sun": stage.camera.light}
        more["background"] = np.array(checks.color("background", look.background))
        if stage.ground is not None and not pictures.body:
            square = (
                stage.ground.corners,
                None,
                np.array([[0, 1, 2], [0, 2, 3]], np.int32),
                np.array([[0, 0], [1, 0], [1, 1], [0, 1]]),
            )
            floor = [DrawnMesh("ground", *square, np.array(checks.color("ground", look.ground)))]

    def frames() -> Iterator[DrawnFrame]:
        for k in numbers:
            position, at = finite_values(trajectory, k, "position"), float(trajectory.times[k])
            velocity = in_space(finite_values(trajectory, k, "velocity")) if to == "usd" else None
            drawing.follow(position, at, values and values(k))
            view = np.zeros((4, 3))
            if stage is not None:
                camera = stage.camera_at(at, position)
                view = np.array([camera.right, camera.up, -camera.forward, camera.eye])
            yield [_in_frame(one, in_space(position), velocity, at) for one in found] + floor, view

    return frames(), more


def bodies_of(drawing: Drawing, parts: Sequence[Part], scene: Scene, *, curves: bool = False) -> list[Piece]:
    """Return parts divided into bodies, those of a body one after the other."""
    system, names = scene.system, dict[Any, str]()
    groups = {name: mask_of(group, system.particle_count) for name, group in system.groups.items()}
    # Ties and ropes join bodies that have surfaces, but do not make them one.
    joined = pieces(system.particle_count, system.connections)
    bodies = pieces(system.particle_count, system.connections[~uncovered(system)])

    def named(part: Part, body: object, particles: NDArray) -> str:
        """Return the name of a body: that of its look, or of the smallest group that holds it."""
        around = [name for name, mask in groups.items() if mask[particles].all()] if len(particles) else []
        own = part.name in scene.looks or not around
        wanted = part.name if own else min(around, key=lambda name: np.count_nonzero(groups[name]))
        return names.setdefault((wanted, body), free_name(wanted, names.values()))

    found = list[Piece]()
    for part in parts:
        mesh, triangles = _mesh_of(part, drawing), part.triangles - part.vertices.start
        colors_move = drawing.colors_move and part in drawing.body
        if isinstance(part, Obstacle):
            whole = mesh._replace(name=named(part, part, np.zeros(0, int)))
            found.append(Piece(part, whole, slice(None), slice(None), colors_move))
            continue
        particle, weights = (each.numpy() for each in part.mixture)
        of_triangle = (joined if part.radius else bodies)[particle[triangles[:, 0], 0]]
        if part.is_one_body:
            of_triangle = np.full(len(triangles), part.vertices.start)
        for body in np.unique(of_triangle):
            mine = np.flatnonzero(of_triangle == body)
            vertices, corners = np.unique(triangles[mine], return_inverse=True)
            particles = np.unique(particle[vertices][weights[vertices] != 0])
            one = mesh._replace(name=named(part, body, particles), uv=mesh.uv[vertices])
            if mesh.color.ndim > 1:
                one = one._replace(color=mesh.color[vertices])
            if not (curves and part.of_rope) or colors_move:
                corners = corners.reshape(-1, 3).astype(np.int32)
                found.append(Piece(part, one._replace(triangles=corners), vertices, mine, colors_move))
            elif isinstance(part, Tubes):
                firsts = mine[:: part.corners]
                springs = np.searchsorted(particles, part.connections.numpy()[firsts // part.corners])
                rope = one._replace(normals=None, triangles=springs.astype(np.int32), radius=part.radius)
                found.append(Piece(part, rope, vertices, firsts, colors_move, particles))
    order = list(names.values())
    return sorted(found, key=lambda one: order.index(one.mesh.name))


def _mesh_of(part: Part, drawing: Drawing) -> DrawnMesh:
    """Return a part as a mesh, with its material."""
    gloss, made_of = part.finish.gloss, part.finish.reflectance
    roughness = max(0.15, 0.9 - gloss) if made_of == FINISHES["matt"] else made_of.roughness
    color = part.colors.numpy() if drawing.colors_move and part in drawing.body else part.finish.color
    texture = None if drawing.texture is None else part.finish.texture
    shape = part.points.numpy(), part.normals.numpy(), part.triangles - part.vertices.start, part.uv
    return DrawnMesh(
        part.name, *shape, color, texture, gloss, roughness, made_of.metallic, made_of.opacity, part.moves
    )


def _in_frame(one: Piece, position: NDArray, velocity: NDArray | None, time: float) -> DrawnMesh:
    """Return a body in the frame that the drawing shows, given positions and velocities of particles in space."""
    part, mesh, visible, moving = one.part, one.mesh, one.part.drawn_at(time), None
    visible = None if visible is None else visible[one.triangles]
    if one.rope is not None:
        moving = None if velocity is None else velocity[one.rope]
        return mesh._replace(points=position[one.rope], velocities=moving, visible=visible)
    points, normals = (each.numpy()[one.vertices] for each in (part.points, part.normals))
    color = part.colors.numpy()[one.vertices] if one.colors_move else mesh.color
    if velocity is not None and not isinstance(part, Obstacle):
        particle, weights = (part.mixture[k].numpy()[one.vertices] for k in range(2))
        moving = np.einsum("vk,vkd->vd", weights, velocity[np.asarray(particle, int)])
    return mesh._replace(points=points, normals=normals, color=color, visible=visible, velocities=moving)
