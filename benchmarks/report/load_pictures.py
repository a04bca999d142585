"""Small pictures of what acts on bodies, of shipped scenes and of scenes of a few lines.

    python -m benchmarks.report.load_pictures [--only NAME ...] [--out FOLDER]

simulates on the CPU and writes docs/images/loads/*.webp, which docs/loads.md and docs/pictures.md show.
"""

import argparse
import dataclasses
import io
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import warp as wp
from numpy.typing import NDArray
from PIL import Image

import msdwarp as msd
from msdwarp.bodies import stress, von_mises
from msdwarp.pictures.timelapse import timelapse
from msdwarp.studies.plots import BLUE, DARK, RED
from msdwarp.textures import gingham, voxels
from msdwarp.world import FINISHES

from ..common import IMAGES, scene_scripts

FOLDER = IMAGES / "loads"
SIZE = (480, 320)
QUALITY = 82
"""Of WebP, in per cent."""


def at_times(scene: msd.Scene, times: Sequence[float]) -> NDArray[np.uint8]:
    """Return a picture of a scene at some times, the poses laid over each other."""
    simulation = msd.Simulation.from_scene(scene, device="cpu")
    frames = list(simulation.frames(times[-1]))
    if scene.system.tears:  # what is torn is drawn apart
        torn = scene.system.replace(broken_at=simulation.snapshot().broken_at)
        scene = dataclasses.replace(scene, system=torn)
    shown = [min(frames, key=lambda frame: abs(frame.time - time)) for time in times]
    positions, when = [frame.position for frame in shown], [frame.time for frame in shown]
    renderer = msd.Renderer(scene, np.array(positions), resolution=SIZE)
    return timelapse(renderer, positions, when) if len(times) > 1 else renderer.image(positions[0], when[0])


def shipped(name: str, *times: float) -> NDArray[np.uint8]:
    """Return a picture of a scene in scenes/."""
    return at_times(scene_scripts()[name].build(), times)


def force() -> NDArray[np.uint8]:
    """Return a beam, clamped at one end, that a growing force on its other end bends."""
    beam = msd.box((25, 4, 4), 0.04, mass=0.005, stiffness=4000.0, damping=2.0)
    x = beam.position[:, 0]
    beam = beam.pin(x < x.min() + 0.01)
    pull = msd.Force(lambda t: (0, 0, -4.0 * t), on=x > x.max() - 0.01, total=True)
    look = msd.Look(color="#2f6f9f", azimuth=-80, elevation=12)
    scene = msd.Scene(system=beam.translate((0, 0, 0.5)), loads=[pull], gravity=0.0, look=look)
    return at_times(scene, (0.0, 1.0, 2.0))


def bending() -> NDArray[np.uint8]:
    """Return two strips clamped at one end: a slack one, and a stiff one of the same cloth that bends."""
    strips = []
    for place, name, bending in ((-0.2, "slack", None), (0.2, "stiff", 0.06)):
        strip = msd.sheet((31, 9), 0.03, mass=3e-5, stiffness=600.0, damping=0.02, bending=bending)
        strip = strip.pin(strip.position[:, 0] < strip.position[:, 0].min() + 0.04)
        strips.append(strip.translate((0, place, 1.05)).named(name))
    look = msd.Look(azimuth=-72, elevation=14)
    looks = {"slack": msd.Look(color="#8d99a6"), "stiff": msd.Look(color="#d9603b")}
    air = msd.Wind((0, 0, 0))  # in which they come to rest
    scene = msd.Scene(system=strips[0] + strips[1], colliders=[msd.Plane()], loads=[air], look=look, looks=looks)
    return at_times(scene, (4.0,))


def drive() -> NDArray[np.uint8]:
    """Return a rope whose one end is moved up and down: waves run along it."""
    rope = msd.chain(121, 0.02, mass=5e-4, stiffness=400.0, damping=0.01)
    rope = rope.replace(rest_length=rope.length / 1.05).pin(120)
    shake = msd.PrescribedMotion([0], lambda t: (0, 0, 0.1 * np.sin(24 * t)))
    look = msd.Look(azimuth=-80, elevation=8)
    scene = msd.Scene(
        system=rope.translate((0, 0, 0.4)).named("rope"),
        loads=[shake],
        gravity=0.0,
        look=look,
        looks={"rope": msd.Look(color="#b3382c", tube=0.014, gloss=0.6)},
    )
    return at_times(scene, (0.6,))


def attachment() -> NDArray[np.uint8]:
    """Return a cloth that springs hold, by one edge, at a rail that moves to and fro."""
    cloth = msd.sheet((31, 25), 0.04, mass=4e-4, stiffness=80.0, damping=0.05, bending=2e-4)
    cloth = cloth.rotate(np.pi / 2, axis=(1, 0, 0)).translate((0, 0, 0.9))
    rail = msd.Capsule((-0.7, 0, 1.4), (0.7, 0, 1.4), 0.02, motion=lambda t: (0, 0.35 * np.sin(4 * t), 0))
    top = np.flatnonzero(cloth.position[:, 2] > cloth.position[:, 2].max() - 0.01)
    hold = msd.Attachment(top[::5], rail, stiffness=400.0, damping=0.2)
    look = msd.Look(texture=gingham("#2f6f9f", "#f4f1e8"), gloss=0.05, azimuth=-40, elevation=14)
    scene = msd.Scene(system=cloth, colliders=[msd.Plane(), rail], loads=[hold], look=look)
    return at_times(scene, (2.2,))


def looks() -> NDArray[np.uint8]:
    """Return three bodies in one scene, each with its own look."""
    ball = msd.ball(0.25, 0.1, mass=0.02, stiffness=800.0, damping=1.0).translate((0, 0, 0.26)).named("ball")
    cube = (
        msd.box((5, 5, 5), 0.1, mass=0.01, stiffness=800.0, damping=1.0).translate((0.65, 0, 0.21)).named("cube")
    )
    rope = msd.chain(25, 0.05, mass=0.002, stiffness=500.0, damping=0.05)
    wave = rope.position + np.sin(9 * rope.position[:, :1]) * (0, 0.1, 0)
    rope = rope.replace(position=wave).translate((0.3, -0.5, 0.02)).named("rope")
    rope = rope.replace(rest_length=rope.length)
    looks = {
        "ball": msd.Look(color="#c03020", gloss=0.9),
        "cube": msd.Look(texture=gingham("#3b7a57", "#f4f1e8"), gloss=0.05),
        "rope": msd.Look(color="#d9a441", tube=0.02),
    }
    system = ball + cube + rope
    look = msd.Look(azimuth=-70, elevation=20)
    return at_times(msd.Scene(system=system, colliders=[msd.Plane()], look=look, looks=looks), (0.5,))


def finishes() -> NDArray[np.uint8]:
    """Return the same ball with each finish, in two colors, before a bar."""
    ball, rows = msd.ball(0.25, 0.05), []
    for color in ("#c8503c", "#a3acb6"):
        balls = [ball.translate((0.62 * k, 0, 0.25)).named(name) for k, name in enumerate(FINISHES)]
        system = sum(balls[1:], balls[0])
        looks = {name: msd.Look(color=color, gloss=0.5, finish=name) for name in FINISHES}
        solids = [msd.Plane(), msd.Box((1.24, 0.6, 0.2), (3.2, 0.1, 0.4))]
        look = msd.Look(azimuth=-90, elevation=12, field_of_view=8.0, obstacle="#8a6238")
        scene = msd.Scene(system=system, colliders=solids, look=look, looks=looks)
        rows.append(msd.Renderer(scene, system.position, resolution=(960, 240)).image(system.position))
    return np.concatenate(rows)


def section() -> NDArray[np.uint8]:
    """Return two balls in a press, cut in half, in the colors of their stress."""
    scene = scene_scripts()["press"].build()
    scene = scene.replace(look=dataclasses.replace(scene.look, cut=msd.Plane((0, -1, 0))))
    simulation = msd.Simulation.from_scene(scene, device="cpu")
    *_, last = simulation.frames(1.2)
    values = von_mises(stress(simulation.snapshot()))
    scale = msd.ColorScale("von Mises stress [Pa]", 40e3)
    renderer = msd.Renderer(scene, last.position, resolution=(960, 400), coloring=scale)
    return renderer.image(last.position, last.time, values)


def probe() -> NDArray[np.uint8]:
    """Return a plot of what the ground pushes a soft cube with that is dropped on it."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    cube = msd.box((6, 6, 6), 0.1, mass=0.01, stiffness=600.0, damping=0.8).translate((0, 0, 0.6)).named("cube")
    scene = msd.Scene(
        system=cube,
        colliders=[msd.Plane(restitution=0.0)],
        probes={"floor": msd.Probe("cube", "contact force")},
    )
    simulation = msd.Simulation.from_scene(scene, device="cpu", fps=240)
    simulation.step(480)
    times, push = simulation.readings["floor"]
    figure = Figure(figsize=(4.8, 3.2), dpi=100, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.plot(times, push[:, 2], color=BLUE, lw=1.5, label='Probe("cube", "contact force")')
    axes.axhline(9.82 * 0.01 * 6**3, color=RED, lw=1.2, ls="--", label="its weight")
    axes.set_xlabel("time [s]", color=DARK)
    axes.set_ylabel("force [N]", color=DARK)
    axes.margins(x=0)
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    file = io.BytesIO()
    canvas.print_png(file)
    return np.asarray(Image.open(file).convert("RGB"))


def robot() -> NDArray[np.uint8]:
    """Return a crawling robot of voxels, that of docs/howto.md."""
    cells = np.array([[1, 3, 3, 3, 3, 3, 3, 3, 3, 1]] * 2).T
    body = msd.voxels(cells, 0.1).translate((0, 0.1))
    muscle = msd.Actuator(
        lambda t: 0.2 * np.sin(6 * np.pi * t) * np.clip(t, 0, 1),
        cells=msd.voxel_corners(cells, 3),
        along="x",
        delay=(body.position[:, 0] + 0.5) / 6,
    )
    look = msd.Look(texture=voxels(), azimuth=-75, elevation=14)
    floor = msd.Plane(friction=0.9, restitution=0.0)
    return at_times(msd.Scene(system=body, colliders=[floor], loads=[muscle], look=look), (3.3,))


PICTURES: dict[str, Callable[[], NDArray[np.uint8]]] = {
    "force": force,
    "wind": lambda: shipped("flag", 3.6),
    "pressure": lambda: shipped("balloon", 1.5),
    "bending": bending,
    "drive": drive,
    "attachment": attachment,
    "join": lambda: shipped("bridge", 7.0),
    "actuator": lambda: shipped("walker", 3.6),
    "voxels": robot,
    "tear": lambda: shipped("tear", 1.7),
    "snap": lambda: shipped("snap", 0.4),
    "cookie": lambda: shipped("cookie", 0.36),
    "probe": probe,
    "looks": looks,
    "finishes": finishes,
    "section": section,
}


def main() -> None:
    """Draw the pictures that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=PICTURES, default=list(PICTURES), help="by default all")
    parser.add_argument("--out", type=Path, default=FOLDER)
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.only:
        path = options.out / f"{name}.webp"
        Image.fromarray(PICTURES[name]()).save(path, quality=QUALITY, method=6)
        print(f"{path} ({path.stat().st_size / 1e3:.0f} kB)", flush=True)


if __name__ == "__main__":
    main()
