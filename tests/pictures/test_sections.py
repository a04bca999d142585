"""Bodies cut by a plane: what is left of them, and what is inside."""

import numpy as np
import pytest
from backends import BACKENDS, pixel_of
from test_coloring import colors_of

import msdwarp as msd
from msdwarp import checks
from msdwarp.cli.picture_options import Pictures
from msdwarp.pictures import Drawing
from msdwarp.pictures.parts import Tubes
from msdwarp.world.stored_scene import scene_as_stored, scene_from_stored

SIZE = (320, 180)
BOX, BALL = msd.box((6, 6, 6), 0.2), msd.ball(0.5, 0.1)
RING = msd.from_mesh(msd.icosphere(0.5, 2), 0.125).named("ball") + msd.box((4, 3, 3), 0.1).translate((0.8, 0, 0))
AXIS, DIAGONAL = msd.Plane((0, -1, 0)), msd.Plane((1, 1, 1))


def cut(system, plane, coloring="texture", **look):
    drawing = Drawing(msd.Scene(system=system, look=msd.Look(cut=plane, **look)), coloring)
    drawing.follow(system.position)
    return drawing


def volume_and_plane_area(drawing, normal):
    """Return the volume that the triangles enclose, and the area of those whose normal is that of the plane."""
    a, b, c = np.moveaxis(drawing.points.numpy()[drawing.triangles].astype(float), 1, 0)
    twice = np.cross(b - a, c - a)
    size = np.linalg.norm(twice, axis=1)
    in_plane = twice @ normal > (1 - 1e-4) * size
    return np.einsum("td,td->t", a, twice).sum() / 6, size[in_plane & (size > 0)].sum() / 2


@pytest.mark.parametrize(
    ("plane", "area"), [(AXIS, 1.0), (DIAGONAL, 3 * np.sqrt(3) / 4), (msd.Plane((0, 0, 1), 0.1), 1.0)]
)
def test_the_section_of_a_cube_is_a_square_or_a_hexagon(plane, area):
    normal = plane.unit_normal(3)
    volume, found = volume_and_plane_area(cut(BOX, plane), normal)
    # float32 places: 1e-6. What is left has no hole: its volume would be another.
    assert volume == pytest.approx(0.5 + plane.offset, abs=1e-5)
    assert found == pytest.approx(area, abs=1e-5)


@pytest.mark.parametrize("system", [BALL, RING], ids=["ball", "two bodies"])
@pytest.mark.parametrize("plane", [AXIS, DIAGONAL], ids=["along", "across"])
def test_what_is_on_both_sides_is_the_body(system, plane):
    whole = Drawing(msd.Scene(system=system), "texture")
    whole.follow(system.position)
    other = msd.Plane(tuple(-x for x in plane.normal))
    halves = [volume_and_plane_area(cut(system, one), one.unit_normal(3)) for one in (plane, other)]
    # Delaunay's triangles may leave slivers at the rim: less than a thousandth of the body.
    assert sum(volume for volume, _ in halves) == pytest.approx(
        volume_and_plane_area(whole, (0, 0, 1))[0], rel=1e-3
    )
    assert halves[0][1] == pytest.approx(halves[1][1], rel=1e-3)


def test_the_section_moves_and_shows_values_with_its_particles():
    scale = msd.ColorScale("x [m]", 2.0)
    drawing = cut(BALL, DIAGONAL, scale)
    turn = np.array([[1.0, 0.3, 0.0], [0.0, 1.2, -0.4], [0.2, 0.0, 0.9]])
    volume = volume_and_plane_area(drawing, DIAGONAL.unit_normal(3))[0]
    position = BALL.position @ turn.T + (1.0, 0.0, 0.0)
    drawing.follow(position, values=position[:, 0])
    assert volume_and_plane_area(drawing, (1, 0, 0))[0] == pytest.approx(np.linalg.det(turn) * volume, rel=1e-4)
    points = drawing.points.numpy()
    np.testing.assert_allclose(drawing.colors.numpy(), colors_of(points[:, 0], 2.0), atol=1e-4)  # float32
    (_, inside) = drawing.body
    assert len(inside.points) > 50  # with corners within
    normal = np.linalg.inv(turn).T @ DIAGONAL.unit_normal(3)
    np.testing.assert_allclose((inside.points.numpy() - (1, 0, 0)) @ normal, 0, atol=1e-5)


@pytest.mark.parametrize("backend", BACKENDS)
def test_inside_is_seen_in_its_color(backend):
    look = msd.Look(color="#c03020", inside="#2040c0", cut=AXIS, gloss=0.0, azimuth=-90, elevation=10)
    renderer = msd.Renderer(msd.Scene(system=BALL, look=look), BALL.position, resolution=SIZE, backend=backend)
    image = renderer.image(BALL.position).astype(float)
    for place in ((0, 0, 0), (0.3, 0, 0.3), (-0.4, 0, -0.2)):
        color = image[pixel_of(renderer, place)]
        np.testing.assert_allclose(color / color.max(), np.array(checks.color("", "#2040c0")) / 0.7529, atol=0.02)


def test_a_look_of_a_part_colors_its_part_of_the_section():
    left = BOX.replace(groups={"left": np.flatnonzero(BOX.position[:, 0] < 0)})
    scene = msd.Scene(system=left, look=msd.Look(cut=AXIS), looks={"left": msd.Look(inside="#2040c0")})
    drawing = Drawing(scene, "texture")
    drawing.follow(BOX.position)
    assert volume_and_plane_area(drawing, AXIS.unit_normal(3))[1] == pytest.approx(1.0, abs=1e-5)
    blue = drawing.colors.numpy()[:, 2] > 0.7
    corners = drawing.points.numpy()[blue]
    np.testing.assert_allclose([corners[:, 0].min(), corners[:, 0].max()], [-0.5, -0.1], atol=1e-6)


@pytest.mark.parametrize("coloring", ["texture", "strain"])
def test_of_chosen_bodies_alone_is_a_section_drawn(coloring):
    ball, cube = BALL.named("ball"), BOX.translate((1.5, 0.0, 0.2)).named("cube")
    both, plane = msd.Scene(system=ball + cube, colliders=[msd.Box((0, 0, -2), (1, 1, 1))]), msd.Plane((0, 0, -1))
    both = both.replace(look=msd.Look(cut=plane))
    found = [Drawing(both, coloring, bodies=[name]) for name in ("ball", "cube")]
    for drawing, body in zip(found, (ball, cube), strict=True):
        drawing.follow(both.system.position)
        alone = cut(body, plane, coloring)
        assert not drawing.obstacles
        sizes = [volume_and_plane_area(one, (0, 0, -1)) for one in (drawing, alone)]
        np.testing.assert_allclose(*sizes, rtol=1e-5, atol=1e-5)  # of float32 places
        assert [len(part.triangles) for part in drawing.body] == [len(part.triangles) for part in alone.body]
    beside = both.replace(look=msd.Look(cut=msd.Plane((1, 0, 0), 0.7)))
    with pytest.raises(ValueError, match=r"look\.cut is .*, which leaves nothing of cube to draw"):
        Drawing(beside, coloring, bodies=["cube"])
    assert len(Drawing(beside, coloring, bodies=["obstacles"]).obstacles) == 1


def test_shells_and_sheets_have_no_inside_and_ropes_end():
    shell, rope = msd.shell(msd.icosphere(0.5, 2)), msd.chain(5, 0.1).rotate(np.pi / 2)
    hollow = cut(shell, AXIS)
    assert len(hollow.body) == 1
    assert not hollow.closed.any()  # its inner side is seen
    assert hollow.points.numpy()[hollow.triangles][..., 1].min() > -1e-6
    tubes = [part for part in cut(rope, AXIS, color="#102030").body if isinstance(part, Tubes)]
    assert len(tubes[0].connections) == 2
    lattice = cut(msd.box((14, 14, 14), 0.1), AXIS, "strain")
    ends = lattice.body[0].connections.numpy()
    middle = msd.box((14, 14, 14), 0.1).position[ends].mean(axis=1)
    assert (np.abs(middle) < 0.2).all(axis=1).any()  # those at the section are drawn


def test_a_section_parts_where_its_body_is_torn():
    across = np.diff(BOX.position[BOX.connections][..., 0] > 0.01, axis=1)[:, 0]
    torn = BOX.replace(break_strain=0.5, broken_at=np.where(across, 1.0, np.inf))
    drawing = cut(torn, msd.Plane((0, -1, 0), 0.05))
    apart = torn.position + np.where(torn.position[:, :1] > 0.01, 1.0, 0.0) * (1, 0, 0)
    for time, longest in ((0.5, 2.0), (2.0, 1.0)):
        drawing.follow(apart, time)
        width = np.ptp(drawing.points.numpy()[drawing.triangles][..., 0], axis=1).max()
        assert (width > 1.0) == (longest > 1.0)


@pytest.mark.parametrize("coloring", ["texture", "strain"])
def test_a_plane_above_all_bodies_cuts_nothing_and_one_below_is_refused(coloring):
    drawings = [cut(BOX, plane, coloring) for plane in (None, msd.Plane((0, 0, 1), 9.0))]
    assert len(drawings[0].triangles) == len(drawings[1].triangles)
    with pytest.raises(ValueError, match=r"look.cut is Plane.* all bodies are above it"):
        cut(BOX, msd.Plane((0, 0, 1), -9.0), coloring)


def test_a_cut_is_stored_and_given_by_a_flag():
    scene = msd.Scene(system=BOX, look=msd.Look(cut=msd.Plane((0, -1, 0), 0.2)))
    assert scene_from_stored(BOX, *scene_as_stored(scene, [0.0])).look.cut == msd.Plane((0, -1, 0), 0.2)
    assert Pictures(cut="0,-1,0,0.2").aimed(msd.Look()).cut == msd.Plane((0, -1, 0), 0.2)
    assert Pictures(cut="0,0,1").aimed(msd.Look()).cut == msd.Plane((0, 0, 1))
    assert Pictures(azimuth=5).aimed(scene.look).cut is scene.look.cut
    for wrong in ("y", "1,2", "0,0,0", "1,2,3,4,5"):
        with pytest.raises(ValueError, match=r"cut is .* it must be X,Y,Z or X,Y,Z,OFFSET"):
            Pictures(cut=wrong).check(1)
    with pytest.raises(ValueError, match=r"look\.cut: normal is"):
        msd.Scene(system=BOX, look=msd.Look(cut=msd.Plane((0, 1))))
    with pytest.raises(ValueError, match="cut is a plane with a motion"):
        msd.Look(cut=msd.Plane(motion=lambda t: (0, 0, t)))


def test_run_and_film_take_the_plane_of_a_look(tmp_path):
    plane = msd.Plane((0.3, -1, 0.1), 0.01)
    scene, how = msd.Scene(system=BOX, duration=0.02), {"resolution": (64, 64)}
    drawn = scene.replace(look=msd.Look(cut=plane))
    for of, more, folder in ((scene, {"cut": plane}, "flag"), (drawn, {}, "look")):
        msd.run(of, tmp_path / folder, quiet=True, **how, **more)
        msd.film(of, tmp_path / f"{folder}.webp", **how, **more)
    for name in ("{}/frame_0001.png", "{}.webp"):
        one, other = ((tmp_path / name.format(folder)).read_bytes() for folder in ("flag", "look"))
        assert one == other
    before = set(tmp_path.iterdir())
    moving = msd.Plane(motion=lambda t: (0, 0, t))
    for wrong, told in ((moving, "a plane with a motion"), (msd.Plane((0, 1)), "it must have 3 coordinates")):
        with pytest.raises(ValueError, match=told):
            msd.run(scene, tmp_path / "wrong", cut=wrong)
        with pytest.raises(ValueError, match=told):
            msd.film(scene, tmp_path / "wrong.webp", cut=wrong)
    with pytest.raises(ValueError, match="cut is 3"):
        msd.film(scene, tmp_path / "new" / "wrong.webp", cut=3)
    assert set(tmp_path.iterdir()) == before
