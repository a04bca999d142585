"""Bodies with looks of their own, and ropes beside what has a surface."""

import numpy as np
import pytest
import warp as wp
from backends import BACKENDS

import msdwarp as msd
from msdwarp.pictures.drawing import ColorScale, Drawing
from msdwarp.pictures.dressing import part_of, uncovered
from msdwarp.pictures.parts import Balls, Finish, SurfacePart, Tubes

SIZE = (160, 120)
RED, GREEN, BLUE = msd.Look(color="#d01010", gloss=0), msd.Look(color="#10c010"), msd.Look(color="#1010d0")


def tied(system, pairs):
    """Return a system with connections added that are in no lattice direction."""
    count = system.connection_count + len(pairs)
    return msd.System(
        position=system.position,
        mass=system.mass,
        connections=np.concatenate([system.connections, pairs]),
        rest_length=np.concatenate([system.rest_length, np.full(len(pairs), 0.1)]),
        stiffness=np.full(count, 100.0),
        surface=system.surface,
        directions=system.directions,
        groups=system.groups,
    )


BALL = msd.ball(0.2, 0.1).named("ball")
ROPE = msd.chain(6, 0.1).rotate(np.pi / 2, axis=(0, 1, 0)).translate((0, 0, 0.6)).named("rope")
CLOTH = msd.sheet((6, 6), 0.2).translate((0, 0, -0.5)).named("cloth")
SYSTEM = BALL + ROPE + CLOTH
TIE = [[BALL.particle_count - 1, BALL.particle_count]]  # from the last of the ball to the first of the rope
LOOKS = {"ball": RED, "rope": BLUE, "cloth": GREEN}


def parts_of(scene, coloring="texture"):
    """Return the parts of a scene's body, after it has followed its particles."""
    drawing = Drawing(scene, coloring)
    drawing.follow(scene.system.position)
    return drawing.body


def pixels_like(image, channel):
    """Return how many pixels have one channel well above the two others."""
    rest = np.delete(image.astype(int), channel, axis=2).max(axis=2)
    return int((image[..., channel] > rest + 40).sum())


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("textured", [False, True])
def test_each_body_has_its_color(backend, textured):
    # A texture of one body puts the plain colors of the others into an atlas with it.
    texture = np.full((8, 8, 3), (16, 192, 16), np.uint8)
    looks = LOOKS | {
        "cloth": msd.Look(texture=texture) if textured else GREEN,
        "rope": msd.Look(color="#1010d0", tube=0.03),
    }
    scene = msd.Scene(system=tied(SYSTEM, TIE), look=msd.Look(background="#ffffff"), looks=looks)
    renderer = msd.Renderer(scene, SYSTEM.position, resolution=SIZE, backend=backend)
    image = renderer.image(SYSTEM.position)
    for channel in range(3):  # of 19200 pixels the rope, 0.06 by 0.5 m of a view of some 2 m, has some 100
        assert pixels_like(image, channel) > 60
    assert renderer.drawing.scale is None


def test_a_body_without_its_own_look_has_the_scene_s():
    scene = msd.Scene(system=SYSTEM, look=msd.Look(color="#d01010"), looks={"cloth": GREEN})
    image = msd.Renderer(scene, SYSTEM.position, resolution=SIZE, backend="raster").image(SYSTEM.position)
    assert pixels_like(image, 0) > 60
    assert pixels_like(image, 1) > 60
    assert pixels_like(image, 2) == 0


def test_where_looks_meet_the_later_counts():
    system = SYSTEM.named("all")
    first = parts_of(msd.Scene(system=system, looks={"all": RED, "ball": BLUE}))
    surfaces = [part for part in first if isinstance(part, SurfacePart)]
    assert [tuple(part.finish.color > 0.5) for part in surfaces] == [(True, False, False), (False, False, True)]
    assert len(surfaces[1].triangles) == len(BALL.surface.triangles)
    second = parts_of(msd.Scene(system=system, looks={"ball": BLUE, "all": RED}))
    assert len([part for part in second if isinstance(part, SurfacePart)]) == 1


def test_a_look_colors_the_triangles_all_of_whose_corners_are_in_its_group():
    stripe = np.abs(CLOTH.position[:, 0]) < 0.15  # the two middle columns of six, 0.2 m apart
    system = CLOTH.replace(
        groups={"stripe": np.flatnonzero(stripe), "rows": np.flatnonzero(CLOTH.position[:, 1] > 0)}
    )
    drawing = Drawing(msd.Scene(system=system, looks={"rows": RED, "stripe": BLUE}), "texture")
    drawing.follow(system.position)
    points, triangles = drawing.points.numpy(), {part.name: part.triangles for part in drawing.body}
    assert {name: len(of) for name, of in triangles.items()} == {"body": 24, "rows": 16, "stripe": 10}
    assert np.abs(points[triangles["stripe"], 0]).max() < 0.15
    assert points[triangles["rows"], 1].min() > 0


def test_connections_outside_of_surfaces_are_drawn_and_no_others():
    own = slice(BALL.connection_count, BALL.connection_count + ROPE.connection_count)
    expected = np.zeros(SYSTEM.connection_count, dtype=bool)
    expected[own] = True
    np.testing.assert_array_equal(uncovered(SYSTEM), expected)
    np.testing.assert_array_equal(uncovered(tied(SYSTEM, TIE)), [*expected, True])
    for whole in (BALL, CLOTH, msd.box((4, 4, 4)), BALL + CLOTH):
        assert not uncovered(whole).any()
    # Between two bodies with surfaces, and within one.
    first_of_cloth = BALL.particle_count + ROPE.particle_count
    ties = [[0, first_of_cloth], [first_of_cloth, first_of_cloth + 14]]
    np.testing.assert_array_equal(uncovered(tied(SYSTEM, ties))[-2:], [True, False])
    assert uncovered(ROPE).all()


def test_bodies_that_name_no_directions_are_what_hangs_together():
    solid, rope = msd.box((3, 3, 3)).replace(directions=()), msd.chain(4).replace(directions=())
    both = solid + rope.translate((9, 0, 0))
    np.testing.assert_array_equal(uncovered(both), np.arange(both.connection_count) >= solid.connection_count)
    assert not uncovered(tied(both, [[0, 27]])).any()  # one piece, which has a surface: nobody says where it ends


def test_ropes_are_as_thick_as_their_look_says():
    def rope(**look):
        parts = parts_of(msd.Scene(system=SYSTEM, looks={"rope": msd.Look(**look)}))
        return [(type(part), part.radius) for part in parts if not isinstance(part, SurfacePart)]

    assert rope(tube=0.02) == [(Tubes, 0.02), (Balls, 0.02)]
    assert rope(tube=0.02, particles=False) == [(Tubes, 0.02), (Balls, 0.02)]  # which close its bends
    (_, tube), (_, ball) = rope(tube=0.02, particles=True)
    assert ball > 2 * tube
    (_, thin), _ = rope()
    assert 0.0 < thin < 0.05  # of a rope whose particles are 0.1 m apart


@pytest.mark.parametrize(("gap", "rest_length"), [(0.02, 0.002), (0.3, "now")])
def test_seams_are_threads_by_the_spacing_of_what_they_join_or_by_a_look(gap, rest_length):
    cloth = msd.sheet((5, 5), 0.05, neighbors=4)
    rim = np.flatnonzero(cloth.position[:, 0] > 0.09)
    below = cloth.translate((0, 0, -gap)).named("below")
    seam = {"pairs": np.stack([rim, rim], axis=1), "stiffness": 1.0, "rest_length": rest_length}
    sewn = msd.join(cloth, below, **seam)

    def threads(system, **looks):
        parts = parts_of(msd.Scene(system=system, looks=looks))
        return [(type(part), part.radius) for part in parts if not isinstance(part, SurfacePart)]

    assert threads(sewn) == [(Tubes, pytest.approx(0.02 * 0.05))]
    assert threads(sewn, below=msd.Look(tube=0.004)) == [(Tubes, pytest.approx(0.004))]
    hung = msd.join(sewn, msd.chain(3, 0.4).translate((0, 0, 1)), pairs=[[0, 0]], stiffness=1.0)  # on a rope
    assert threads(hung)[:2] == [(Tubes, pytest.approx(0.045 * 0.4)), (Balls, pytest.approx(0.045 * 0.4))]
    assert threads(hung)[2:] == threads(sewn)


@pytest.mark.parametrize("sides", [3, 8])
def test_tubes_have_their_radius_all_around_and_face_outwards(sides):
    scene = msd.Scene(system=ROPE)
    drawing = Drawing(scene, "texture")
    drawing.follow(ROPE.position)
    tubes = Tubes(ROPE.connections, 0.02, Finish(np.ones(3)), "cpu", sides, None)
    points, normals, colors = (wp.zeros(len(tubes.uv), dtype=wp.vec3, device="cpu") for _ in range(3))
    tubes.join(slice(0, len(points)), points, normals, colors)
    tubes.follow(drawing._x, 0.0)
    # The rope is the z axis; float32 coordinates of about one metre.
    np.testing.assert_allclose(np.linalg.norm(points.numpy()[:, :2], axis=1), 0.02, atol=1e-6)
    a, b, c = points.numpy()[tubes.triangles].transpose(1, 0, 2)
    assert (np.einsum("td,td->t", np.cross(b - a, c - a), normals.numpy()[tubes.triangles[:, 0]]) > 0).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_values_color_ropes_and_surfaces_alike(backend):
    scene = msd.Scene(system=SYSTEM, looks={"rope": msd.Look(tube=0.03), "ball": RED})
    renderer = msd.Renderer(
        scene, SYSTEM.position, resolution=SIZE, coloring=ColorScale("speed [m/s]", 1.0), backend=backend
    )
    still = renderer.image(SYSTEM.position, values=np.zeros(SYSTEM.particle_count))
    moving = renderer.image(SYSTEM.position, values=1.0 * SYSTEM.group("rope"))
    changed = (still != moving).any(axis=2)
    assert 60 < changed.sum() < 1000  # the rope alone
    assert not renderer.drawing.gloss.any()


def test_strain_is_shown_of_all_bodies_by_the_looks_of_none():
    parts = parts_of(msd.Scene(system=SYSTEM, looks=LOOKS), "strain")
    assert {type(part) for part in parts} == {Tubes, Balls}
    assert sum(len(part.connections) for part in parts if isinstance(part, Tubes)) == SYSTEM.connection_count


def test_strain_is_shown_on_round_ropes_whose_balls_do_not_stick_out():
    rope = msd.chain(5, 0.1, mass=0.01, stiffness=100.0, damping=0.1)
    both = rope + BALL.translate((9.0, 0.0, 0.0))
    slender, lattice = msd.Look(tube=0.02, particles=False), msd.Look(particles=False)
    tubes, balls = parts_of(msd.Scene(system=rope, look=slender), "strain")
    assert (tubes.corners, tubes.radius) == (16, 0.02)
    assert (balls.radius, len(balls.points)) == (0.02, 5 * 42)
    thin, round_, ends = parts_of(msd.Scene(system=both, look=lattice), "strain")
    assert [thin.corners, round_.corners, len(round_.connections), len(ends.points)] == [6, 16, 4, 5 * 42]


def test_a_part_of_a_surface_is_that_part():
    surface = (BALL + CLOTH).surface
    assert part_of(surface, np.ones(len(surface.triangles), dtype=bool)) is surface
    chosen = surface.triangles_in(np.arange((BALL + CLOTH).particle_count) < BALL.particle_count)
    part, position = part_of(surface, chosen), (BALL + CLOTH).position
    np.testing.assert_array_equal(
        part.points(position)[part.triangles], surface.points(position)[surface.triangles[chosen]]
    )
    np.testing.assert_array_equal(part.uv[part.triangles], surface.uv[surface.triangles[chosen]])
    assert len(part.particle) == len(BALL.surface.particle)


def test_gloss_is_of_each_look():
    scene = msd.Scene(system=SYSTEM, looks={"ball": msd.Look(gloss=0.9), "cloth": msd.Look(gloss=0.0)})
    assert set(np.unique(Drawing(scene, "texture").gloss)) == {0.0, 0.25, 0.9}


def test_a_rope_alone_has_its_look_or_that_of_its_scene():
    for look in ({"look": msd.Look(color="#2040d0")}, {"looks": {"rope": BLUE}}):
        drawing = Drawing(msd.Scene(system=ROPE, **look), "texture")
        assert drawing.scale is None
        assert (drawing.colors.numpy()[:, 2] > 0.5).all()
    assert Drawing(msd.Scene(system=ROPE), "texture").scale is not None
    assert Drawing(msd.Scene(system=ROPE, look=msd.Look(color="#2040d0")), "strain").scale is not None
    assert Drawing(msd.Scene(system=ROPE, look=msd.Look(tube=0.1, azimuth=3.0)), "texture").scale is not None


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize(("look", "coloring"), [({"color": "#2040d0"}, "texture"), ({}, "strain")])
def test_a_rope_has_no_gaps_at_its_bends(backend, look, coloring):
    # A right angle, seen from ahead: the outer corner of the bend is a disc around the particle.
    radius = 0.2
    corner = msd.System(position=[(-1, 0, 0), (0, 0, 0), (0, 0, 1)], connections=[(0, 1), (1, 2)])
    view = msd.Look(**look, particles=False, tube=radius, azimuth=-90.0, elevation=0.0, background="#ffffff")
    scene = msd.Scene(system=corner, look=view)
    drawing = Drawing(scene, coloring)
    drawing.follow(corner.position)
    outer = np.array([np.sqrt(0.5), 0.0, -np.sqrt(0.5)])  # away from both tubes
    near = drawing.points.numpy() @ outer
    assert near.max() > 0.8 * radius  # the tubes alone end at 0.71, as far as the flat end of one reaches
    renderer = msd.Renderer(scene, corner.position, resolution=SIZE, coloring=coloring, backend=backend)
    assert np.isfinite(renderer.image(corner.position)).all()
