"""What it costs to keep every frame: time, room on the disk, and how much slower a run is.

    python benchmarks/output.py [--device D] [--quick] [--plot-only]

All on a cube of 26 neighbours that falls, spinning, so that every number moves.

How fast is a frame written? By `TrajectoryWriter` with and without strain and compression, by plain h5py
(positions and velocities appended to two arrays), and as PVD + VTP by PyVista (a file a frame, which has the
connections each time, compressed by zlib). The frames were simulated before, and are handed over as fast as they
are taken. MB/s counts positions, velocities and, where it is written, strain as they are in memory, whatever the
file's size. Nothing is forced out of the system's cache of the disk; what was written before is (`os.sync`,
outside the clock).

How much slower is a run? A frame is 1/60 s of 20 substeps. Rounds go through all ways in turn: simulated alone,
read back to the host, and written; the share is of the time of what is read back.

In both the clock starts once the first frame is in the file, with all that there is once (`ms_to_begin`), and
stops when the file is closed.
"""

import gc
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from statistics import median

import h5py
import numpy as np
import warp as wp
from common import arguments, machine, read_csv, table, write_csv

from msdwarp import Plane, Simulation, System, box
from msdwarp.trajectory import Frame
from msdwarp.writer import TrajectoryWriter

FPS, SUBSTEPS = 60.0, 20
SIZES = {"cpu": 46, "cuda": 100}
"""Particles along an edge of the cube that runs."""
WAYS = {
    "trajectory": {},
    "trajectory, no strain": {"strain": False},
    "trajectory, gzip": {"compress": True},
    "trajectory, gzip, no strain": {"compress": True, "strain": False},
}


def simulation(n: int, device: str) -> Simulation:
    """Return a simulation of a falling cube of n³ particles."""
    cube = box((n, n, n), 1 / n, mass=1.0, stiffness=1000.0, damping=1.0).spin((1.0, 2.0, 0.5))
    floor = [Plane(offset=-0.6)]
    return Simulation(cube, colliders=floor, fps=FPS, substeps=SUBSTEPS, device=device, allow_unstable=True)


class Clock:
    """Notes how long beginning took, and what follows."""

    def __init__(self) -> None:
        self.start = time.perf_counter()

    def begun(self) -> None:
        """End the beginning."""
        self.middle = time.perf_counter()

    def stop(self) -> tuple[float, float]:
        """Return seconds to begin, and since."""
        return self.middle - self.start, time.perf_counter() - self.middle


def by_trajectory(folder: Path, system: System, frames: Iterator[Frame], **options) -> tuple[float, float]:
    """Write frames as this package does."""
    clock = Clock()
    with TrajectoryWriter(folder / "run.vtkhdf", system, fps=FPS, **options) as writer:
        writer.write(next(frames))
        while writer.frame_count == 0:
            time.sleep(0.001)
        clock.begun()
        for frame in frames:
            writer.write(frame)
    return clock.stop()


def by_h5py(folder: Path, system: System, frames: Iterator[Frame], **filters) -> tuple[float, float]:
    """Append positions and velocities to arrays, and no more."""
    clock = Clock()
    n = system.particle_count
    shape = {"shape": (0, n, 3), "maxshape": (None, n, 3), "chunks": (1, n, 3)}
    with h5py.File(folder / "run.h5", "w") as file:
        arrays = [file.create_dataset(name, dtype="f4", **shape, **filters) for name in ("position", "velocity")]
        for k, (_, *values) in enumerate(frames):
            for array, value in zip(arrays, values, strict=True):
                array.resize(k + 1, axis=0)
                array[k] = value
            if k == 0:
                clock.begun()
    return clock.stop()


def by_pyvista(folder: Path, system: System, frames: Iterator[Frame]) -> tuple[float, float]:
    """Write a VTP file a frame, and the PVD file that lists them."""
    import pyvista as pv

    clock = Clock()
    lines = np.insert(system.connections, 0, 2, axis=1).ravel()
    surface = system.surface
    triangles = np.insert(surface.particle[surface.triangles], 0, 3, axis=1).ravel()
    entries = []
    for k, frame in enumerate(frames):
        mesh = pv.PolyData(frame.position, lines=lines, faces=triangles)
        mesh.point_data["velocity"] = frame.velocity
        mesh.save(folder / f"run_{k:04d}.vtp")
        entries.append(f'<DataSet timestep="{frame.time}" file="run_{k:04d}.vtp"/>')
        if k == 0:
            clock.begun()
    content = f'<VTKFile type="Collection"><Collection>{"".join(entries)}</Collection></VTKFile>'
    (folder / "run.pvd").write_text(content)
    return clock.stop()


def writers() -> dict[str, tuple[Callable, int]]:
    """Return the ways of writing, and the share of a round's frames that each writes: the slow ones fewer."""
    found = {
        name: (partial(by_trajectory, **options), 4 if "gzip" in name else 1) for name, options in WAYS.items()
    }
    found["h5py"] = (by_h5py, 1)
    found["h5py, gzip"] = (partial(by_h5py, compression="gzip", compression_opts=1, shuffle=True), 4)
    try:
        import pyvista
    except ImportError:
        print("PVD + VTP left out: PyVista is not installed")
    else:
        found[f"PVD + VTP by PyVista {pyvista.__version__}"] = (by_pyvista, 20)
    return found


class Folder:
    """A new folder, removed in the end; what was written before it is on the disk."""

    def __enter__(self) -> Path:
        """Return the folder."""
        os.sync()
        self.path = Path(tempfile.mkdtemp())
        return self.path

    def __exit__(self, *_: object) -> None:
        """Remove it."""
        shutil.rmtree(self.path)


def size_of(folder: Path) -> int:
    """Return the bytes of the files in a folder."""
    return sum(path.stat().st_size for path in folder.iterdir())


def measure_writing(n: int, device: str, count: int, rounds: int) -> list[dict]:
    """Return a row for every way of writing about `count` frames of a cube of n³ particles."""
    moving = simulation(n, device)
    system, kept = moving.system, list(moving.frames(4 / FPS))
    del moving
    ways = writers()
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in ways}
    size = {}
    for _ in range(rounds):
        for name, (write, share) in ways.items():
            more = max(1, count // share)
            frames = [kept[k % len(kept)]._replace(time=k / FPS) for k in range(more + 1)]
            with Folder() as folder:
                begin, others = write(folder, system, iter(frames))
                seconds[name].append((begin, others / more))
                size[name] = size_of(folder) / len(frames)
    rows = []
    for name, times in seconds.items():
        held = kept[0].position.nbytes + kept[0].velocity.nbytes
        if "trajectory" in name and "no strain" not in name:
            held += system.connection_count * kept[0].position.itemsize
        one = row(system, "write", name, times)
        one["mb_per_second"], one["mb_per_frame"] = held / one["ms_per_frame"] / 1e3, size[name] / 1e6
        rows.append(one)
    return rows


def row(system: System, question: str, way: str, times: list[tuple[float, float]]) -> dict:
    """Return a row of what all have; times are to begin, and of a frame."""
    begin, frame = zip(*times, strict=True)
    found = {"question": question, "way": way, "particles": system.particle_count}
    found |= {"connections": system.connection_count, "ms_to_begin": median(begin) * 1e3}
    found |= {"ms_per_frame": median(frame) * 1e3, "spread": (max(frame) - min(frame)) / median(frame)}
    return found | {"frames_per_second": 1 / median(frame), "mb_per_second": "", "mb_per_frame": "", "slower": ""}


def measure_run(n: int, device: str, count: int, rounds: int) -> list[dict]:
    """Return a row for every way of running `count` frames of a cube of n³ particles."""
    running = simulation(n, device)
    running.step(2)  # compiles, and records the frame

    def alone(_: Path) -> tuple[float, float]:
        clock = Clock()
        clock.begun()
        running.step(count)
        wp.synchronize_device(device)
        return clock.stop()

    def read_back(_: Path) -> tuple[float, float]:
        clock, frames = Clock(), running.frames(count / FPS)
        next(frames)
        clock.begun()
        for _ in frames:
            pass
        return clock.stop()

    def written(folder: Path, options: dict) -> tuple[float, float]:
        return by_trajectory(folder, running.system, running.frames(count / FPS), frame_count=count + 1, **options)

    ways: dict[str, Callable[[Path], tuple[float, float]]] = {"simulated alone": alone, "read back": read_back}
    ways |= {name: partial(written, options=options) for name, options in WAYS.items()}
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in ways}
    for _ in range(rounds):
        for name, way in ways.items():
            running.reset()
            running.step()
            with Folder() as folder:
                begin, frames = way(folder)
                seconds[name].append((begin, frames / count))
    rows = [row(running.system, "run", name, times) for name, times in seconds.items()]
    base = next(one["ms_per_frame"] for one in rows if one["way"] == "read back")
    for one in rows:
        one["slower"] = one["ms_per_frame"] / base - 1
    return rows


def measure(options) -> list[dict]:
    """Measure everything."""
    kind = "cpu" if options.device == "cpu" else "cuda"
    plan = [(46, 60, 5)] if not options.quick else [(20, 20, 2)]
    plan += [] if options.quick else [(100, 20, 3)]
    rows = []
    for n, count, rounds in plan:
        rows += measure_writing(n, options.device, count, rounds)
        gc.collect()
    n, count, rounds = (20, 10, 2) if options.quick else (SIZES[kind], 10 if kind == "cpu" else 60, 7)
    return rows + measure_run(n, options.device, count, rounds)


def main() -> None:
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    path = options.folder / "output.csv"
    if not options.plot_only:
        write_csv(path, measure(options), machine(options.device))
    line, rows = read_csv(path)
    print(line)
    columns = ("way", "particles", "ms_to_begin", "ms_per_frame", "spread", "frames_per_second")
    head = ["way", "particles", "ms to begin", "ms/frame", "spread", "frames/s"]
    for question, more, names in (
        ("write", ("mb_per_second", "mb_per_frame"), ["MB/s", "MB/frame on disk"]),
        ("run", ("slower",), ["slower than read back by"]),
    ):
        lines = [[r[c] for c in (*columns, *more)] for r in rows if r["question"] == question]
        table({"write": "Writing frames", "run": "Running and writing"}[question], head + names, lines)


if __name__ == "__main__":
    sys.exit(main())
