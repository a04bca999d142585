"""Ten million particles: how long until they move, and how much memory that takes.

    python -m benchmarks.speed.large [--device D] [--quick]

Builds a box of 215 × 215 × 216 particles, joined by 130 million connections, simulates two frames of 20 substeps
each, and writes what every stage took: building on the host, uploading (creating the Simulation, which also bounds
its rates and measures its energy), the first frame (which records the substeps), a further one, and reading all
positions and velocities back. What Warp has not compiled before is compiled in the first stage that needs it.
Memory is the largest that the process has had on the host so far, and what is in use on the GPU.
"""

import math
import resource
import sys
import time

import numpy as np
import warp as wp

from msdwarp import Plane, Simulation, box

from ..common import arguments, machine, read_csv, table, write_csv

SHAPE, QUICK_SHAPE = (215, 215, 216), (60, 60, 60)
SUBSTEPS = 20
FPS = 60.0


class Stopwatch:
    """Notes how long each stage takes, and the memory after it."""

    def __init__(self, device: str) -> None:
        self.device, self.rows = device, []
        self.start = time.perf_counter()

    def note(self, stage: str) -> None:
        """End a stage; what follows is the next one."""
        wp.synchronize_device(self.device)
        seconds = time.perf_counter() - self.start
        self.rows.append({"stage": stage, "seconds": seconds, "host_peak_gb": host_peak()})
        self.rows[-1]["gpu_gb"] = gpu_memory(self.device)
        self.start = time.perf_counter()


def host_peak() -> float:
    """Return the most memory that this process has had [GB]; Linux counts kibibytes, macOS bytes."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e9


def gpu_memory(device: str) -> float | str:
    """Return the memory in use on a GPU [GB], that of other programs and of Warp's pool included."""
    found = wp.get_device(device)
    return (found.total_memory - found.free_memory) / 1e9 if found.is_cuda else ""


def measure(shape: tuple[int, int, int], device: str) -> list[dict]:
    """Return a row for every stage."""
    watch = Stopwatch(device)
    system = box(shape, stiffness=1000.0, damping=20.0)
    watch.note("build")
    simulation = Simulation(
        system, colliders=[Plane(offset=-shape[2] / 2 - 1)], fps=FPS, substeps=SUBSTEPS, device=device
    )
    watch.note("upload")
    simulation.step()
    watch.note("first frame")
    simulation.step()
    watch.note("further frame")
    finite = math.isfinite(float(np.sum(simulation.frame().position, dtype=np.float64)))
    watch.note("read back")
    if not finite:
        raise SystemExit("a position is not finite")
    frame = watch.rows[3]["seconds"]
    counts = {"particles": system.particle_count, "connections": system.connection_count}
    counts |= {"force_algorithm": simulation.model.force_algorithm, "substeps": SUBSTEPS}
    counts["updates_per_second"] = system.connection_count * SUBSTEPS / frame
    return [row | counts for row in watch.rows]


def main() -> None:
    """Measure, write and print."""
    options = arguments(__doc__.splitlines()[0])
    path = options.folder / "large.csv"
    if not options.plot_only:
        rows = measure(QUICK_SHAPE if options.quick else SHAPE, options.device)
        write_csv(path, rows, machine(options.device))
    line, rows = read_csv(path)
    print(line)
    title = f"{rows[0]['particles']:.0f} particles, {rows[0]['connections']:.0f} connections, "
    title += f"{rows[0]['force_algorithm']}, "
    title += f"{rows[0]['substeps']:.0f} substeps a frame: {rows[0]['updates_per_second'] / 1e9:.4g} G updates/s"
    columns = ("stage", "seconds", "host_peak_gb", "gpu_gb")
    head = ["stage", "time [s]", "peak host memory [GB]", "GPU memory in use [GB]"]
    table(title, head, [[row[column] for column in columns] for row in rows])


if __name__ == "__main__":
    sys.exit(main())
