"""What it costs to keep every frame: time, room on the disk, and how much slower a run is.

    python -m benchmarks.speed.output [--device D] [--quick] [--plot-only]

All on a cube of 26 neighbours that falls, spinning, so that every number moves.

How fast is a frame written? By `TrajectoryWriter` with and without strain and compression, by plain h5py
(positions and velocities appended to two arrays), and as PVD + VTP by PyVista (a file a frame, which has the
connections each time, compressed by zlib). "Raw bytes" are as many as positions, velocities and strain have, and
are given to the system as they are: what this disk can take. The frames were simulated before, and are handed over
as fast as they are taken; strain is computed on the host. MB/s counts positions, velocities and, where it is
written, strain as they are in memory, whatever the file's size. Nothing is forced out of the system's cache of the
disk; what was written before is (`os.sync`, outside the clock).

How much slower is a run? A frame is 1/60 s of 20 substeps. It is simulated alone, which writes nothing; read back
to the host, by `Simulation.frames`; and each frame (on a GPU also each 10th or 60th only) is written as `msdwarp
run` does it: by `Readback`, with strain computed on the device, and `TrajectoryWriter`. Times are of a simulated
frame, whether it is kept or not. Rounds go through all ways in turn; the share is of the time in which the same
round simulated the same frames alone, and the median of all rounds.

In both the clock starts once the first frame is in the file, with all that there is once (`ms_to_begin`), and
stops when the file is closed.
"""

import gc
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from statistics import median

import h5py
import numpy as np
import warp as wp

from msdwarp import Frame, Plane, Simulation, System, TrajectoryWriter, box
from msdwarp.simulation import Readback

from ..common import arguments, machine, read_csv, table, write_csv

FPS, SUBSTEPS = 60.0, 20
SIZES = {"cpu": 46, "cuda": 100}
"""Particles along an edge of the cube that runs."""
RUNS = {"cpu": {1: 10}, "cuda": {1: 40, 10: 400, 60: 1800}, "quick": {1: 10, 10: 20, 60: 60}}
"""Frames that a run simulates, by which of them it keeps: each, each 10th, each 60th. Where it waits for the disk,
it keeps many more than can wait in memory."""
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


def by_system(folder: Path, system: System, frames: Iterator[Frame]) -> tuple[float, float]:
    """Hand the system as many bytes as a frame with strain has, and no more than bytes."""
    strain = np.random.default_rng(0).random(system.connection_count, np.float32)
    clock = Clock()
    file = os.open(folder / "run.raw", os.O_WRONLY | os.O_CREAT)
    for k, (_, position, velocity) in enumerate(frames):
        for values in (position, velocity, strain):
            rest = memoryview(np.ascontiguousarray(values)).cast("B")
            while rest:
                rest = rest[os.write(file, rest) :]
        if k == 0:
            clock.begun()
    os.close(file)
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
    found["raw bytes"] = (by_system, 1)
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
        if name == "raw bytes" or ("trajectory" in name and "no strain" not in name):
            held += system.connection_count * kept[0].position.itemsize
        one = row(system, "write", name, 1, times)
        one["mb_per_second"], one["mb_per_frame"] = held / one["ms_per_frame"] / 1e3, size[name] / 1e6
        rows.append(one)
    return rows


def row(system: System, question: str, way: str, every: int | str, times: list[tuple[float, float]]) -> dict:
    """Return a row of what all have; times are to begin, and of a frame."""
    begin, frame = zip(*times, strict=True)
    found = {"question": question, "way": way, "every": every, "particles": system.particle_count}
    found |= {"connections": system.connection_count, "ms_to_begin": median(begin) * 1e3}
    found |= {"ms_per_frame": median(frame) * 1e3, "spread": (max(frame) - min(frame)) / median(frame)}
    return found | {"frames_per_second": 1 / median(frame), "mb_per_second": "", "mb_per_frame": "", "slower": ""}


def simulated_alone(running: Simulation, counts: Iterable[int]) -> dict[int, float]:
    """Simulate, and keep nothing; return seconds a frame of the first so many frames."""
    done, found, start = 0, {}, time.perf_counter()
    for count in sorted(counts):
        running.step(count - done)
        wp.synchronize_device(running.device)
        done, found[count] = count, (time.perf_counter() - start) / count
    return found


def read_back(folder: Path, running: Simulation, count: int) -> tuple[float, float]:
    """Have every frame on the host, one after the other, and keep none."""
    clock, frames = Clock(), running.frames(count / FPS)
    next(frames)
    clock.begun()
    for _ in frames:
        pass
    return clock.stop()


def kept(folder: Path, running: Simulation, count: int, every: int, strain: bool = True) -> tuple[float, float]:
    """Write each `every`-th frame while simulating goes on."""
    clock = Clock()
    options = {"fps": FPS, "frame_count": count + 1, "every": every, "strain": strain}
    readback = Readback(running, strain=strain)
    with TrajectoryWriter(folder / "run.vtkhdf", running.system, **options) as writer:
        writer.write_pending(readback.take())
        while writer.frame_count == 0:
            time.sleep(0.001)
        clock.begun()
        for _ in range(count):
            running.step()
            writer.write_pending(readback.take() if writer.wants_next() else None)
    return clock.stop()


def measure_run(n: int, device: str, counts: dict[int, int], rounds: int) -> list[dict]:
    """Return a row for every way of running a cube of n³ particles; `counts` are frames, by which are kept."""
    running = simulation(n, device)
    running.step(2)  # compiles, and records the frame
    Readback(running, depth=1).take()
    ways: dict[tuple[str, int], Callable] = {("read back", 1): read_back}
    for every in counts:
        ways["trajectory", every] = partial(kept, every=every)
        ways["trajectory, no strain", every] = partial(kept, every=every, strain=False)
    alone: list[dict[int, float]] = []
    seconds: dict[tuple[str, int], list[tuple[float, float]]] = {key: [] for key in ways}
    for _ in range(rounds):
        restart(running)
        alone.append(simulated_alone(running, counts.values()))
        for (name, every), way in ways.items():
            restart(running)
            with Folder() as folder:
                begin, frames = way(folder, running, counts[every])
            seconds[name, every].append((begin, frames / counts[every]))
    most = max(counts.values())
    rows = [row(running.system, "run", "simulated alone", "", [(0.0, times[most]) for times in alone])]
    rows[0]["slower"] = 0.0
    for (name, every), times in seconds.items():
        one = row(running.system, "run", name, every, times)
        shares = [time / base[counts[every]] for (_, time), base in zip(times, alone, strict=True)]
        rows.append(one | {"slower": median(shares) - 1})
    return rows


def restart(running: Simulation) -> None:
    """Go back to the first frame, and record what is launched for one."""
    running.reset()
    running.step()


def measure(options) -> list[dict]:
    """Measure everything."""
    kind = "cpu" if options.device == "cpu" else "cuda"
    # Writing is the host's work alone; beside a GPU it has few rounds.
    plan = {"cpu": [(46, 60, 3), (100, 20, 2)], "cuda": [(46, 30, 3), (100, 8, 2)]}[kind]
    rows = []
    for n, count, rounds in [(20, 20, 2)] if options.quick else plan:
        rows += measure_writing(n, options.device, count, rounds)
        gc.collect()
    # On two cores a round is as noisy as what is to be seen; there what keeps few frames costs nothing to be seen.
    n, counts, rounds = SIZES[kind], RUNS[kind], {"cpu": 15, "cuda": 3}[kind]
    if options.quick:
        n, counts, rounds = 20, RUNS["quick"], 2
    return rows + measure_run(n, options.device, counts, rounds)


def main() -> None:
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    path = options.folder / "output.csv"
    if not options.plot_only:
        write_csv(path, measure(options), machine(options.device))
    line, rows = read_csv(path)
    print(line)
    columns = ("way", "every", "particles", "ms_to_begin", "ms_per_frame", "spread", "frames_per_second")
    head = ["way", "every", "particles", "ms to begin", "ms/frame", "spread", "frames/s"]
    for question, more, names in (
        ("write", ("mb_per_second", "mb_per_frame"), ["MB/s", "MB/frame on disk"]),
        ("run", ("slower",), ["slower than alone by"]),
    ):
        lines = [[r[c] for c in (*columns, *more)] for r in rows if r["question"] == question]
        table({"write": "Writing frames", "run": "Running and writing"}[question], head + names, lines)


if __name__ == "__main__":
    sys.exit(main())
