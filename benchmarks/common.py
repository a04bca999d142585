"""What the benchmark scripts share: the machine in words, runs, CSV files, tables and the look of charts."""

import argparse
import csv
import importlib
import math
import os
import pkgutil
import platform
import re
import tempfile
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType

import numpy as np
import scipy
import warp as wp

import msdwarp
from msdwarp import RK4, RKC2, ExplicitEuler, Leapfrog, Simulation, SimulationDiverged, SymplecticEuler, scenes

RESULTS = Path(__file__).parent / "results"
IMAGES = Path(__file__).parents[1] / "docs" / "images"

METHODS = {
    "explicit Euler": ExplicitEuler(),
    "symplectic Euler": SymplecticEuler(),
    "leapfrog": Leapfrog(),
    "leapfrog θ=½": Leapfrog(damper_extrapolation=0.5),
    "RK4": RK4(),
    "RKC2": RKC2(),
}
COLORS = {
    "explicit Euler": "#9a9a9a",
    "symplectic Euler": "#e69f00",
    "leapfrog": "#0072b2",
    "leapfrog θ=½": "#56b4e9",
    "RK4": "#c8352b",
    "RKC2": "#009e73",
    "RKC2, 20 stages": "#00573f",
}
MARKERS = dict(zip(COLORS, "xo^vsDd", strict=True))


def arguments(description: str, *own: argparse.ArgumentParser) -> argparse.Namespace:
    """Read the flags that every script has, and a script's own, of parsers without `--help`."""
    parser = argparse.ArgumentParser(description=description, parents=own)
    parser.add_argument("--device", help="a Warp device; by default the first CUDA device, else the CPU")
    parser.add_argument("--quick", action="store_true", help="fewer scenes and steps, to see that it works")
    parser.add_argument("--plot-only", action="store_true", help="redraw the charts from the CSV files")
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_ERROR
    wp.init()
    options.device = wp.get_device(options.device or ("cuda:0" if wp.is_cuda_available() else "cpu")).alias
    name = "cpu" if options.device == "cpu" else wp.get_device(options.device).name
    name = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")
    options.folder = Path(tempfile.mkdtemp()) if options.quick else RESULTS / name  # a trial replaces nothing
    return options


def machine(device: str) -> str:
    """Say in a line what the numbers were measured on."""
    found = re.findall(r"model name\s*:\s*(.*)", _read("/proc/cpuinfo"))
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    parts = [f"CPU {found[0] if found else platform.machine()}, {cores} cores"]
    if device != "cpu":
        parts.insert(0, f"GPU {wp.get_device(device).name}")
    versions = f"msdwarp {msdwarp.__version__}, Python {platform.python_version()}, warp {wp.__version__}"
    return "; ".join([*parts, f"{versions}, NumPy {np.__version__}, SciPy {scipy.__version__}"])


def _read(path: str) -> str:
    try:
        return Path(path).read_text()
    except OSError:
        return ""


def scene_scripts() -> dict[str, ModuleType]:
    """Return the scripts of the scenes that come with msdwarp, by name."""
    names = sorted(module.name for module in pkgutil.iter_modules(scenes.__path__))
    return {name: importlib.import_module(f"{scenes.__name__}.{name}") for name in names}


def frames_and_substeps(steps: float, per_frame: int = 32) -> tuple[int, int]:
    """Cut at least `steps` substeps into (frames, substeps per frame) of about `per_frame`."""
    frames = max(1, round(steps / per_frame))
    return frames, math.ceil(steps / frames)


def run(case, integrator, steps: float, *, device: str, precision: str = "float64"):
    """Return (positions at the end of a case, substeps taken, evaluations each); positions None if it diverged."""
    frames, substeps = frames_and_substeps(steps)
    simulation = Simulation(
        case.system,
        gravity=case.gravity,
        colliders=case.colliders,
        integrator=integrator,
        fps=frames / case.duration,
        substeps=substeps,
        allow_unstable=True,
        energy_limit=math.inf,
        device=device,
        precision=precision,
    )
    try:
        simulation.step(frames)
    except SimulationDiverged:
        return None, frames * substeps, simulation.integrator.evaluations
    position = simulation.frame().position.astype(np.float64)
    return position, frames * substeps, simulation.integrator.evaluations


def replay(simulation: Simulation) -> None:
    """Replay the recorded frame; nothing is read back."""
    simulation.stepping.graph()


def write_csv(path: Path, rows: list[dict], machine_line: str) -> None:
    """Write rows with the machine as a comment in the first line."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        file.write(f"# {machine_line}\n")
        writer = csv.DictWriter(file, fieldnames=list(rows[0]), lineterminator="\n")
        writer.writeheader()
        for row in rows:
            writer.writerow({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()})


def read_csv(path: Path) -> tuple[str, list[dict]]:
    """Return (machine, rows) with numbers as floats."""
    if not path.exists():
        raise SystemExit(f"{path.name} is not there for this device; run the script without --plot-only first")
    with path.open(encoding="utf-8") as file:
        line = file.readline().removeprefix("# ").strip()
        return line, [{k: _number(v) for k, v in row.items()} for row in csv.DictReader(file)]


def _number(text: str):
    try:
        return float(text)
    except ValueError:
        return text


def table(title: str, columns: list[str], rows: Iterable[list]) -> None:
    """Print a table, by rich where it is installed."""
    rows = [[c if isinstance(c, str) else f"{c:.4g}" for c in row] for row in rows]
    try:
        from rich.console import Console
        from rich.table import Table
    except ImportError:
        print(title, *(" | ".join(row) for row in [columns, *rows]), "", sep="\n")
        return
    printed = Table(title=title, title_justify="left")
    for k, name in enumerate(columns):
        printed.add_column(name, justify="right" if k > 1 else "left")
    for row in rows:
        printed.add_row(*row)
    Console(width=130).print(printed)


def pyplot():
    """Return pyplot in the look that the charts share."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    plt.rcParams.update(
        {
            "font.size": 10,
            "axes.titlesize": 11,
            "axes.titleweight": "bold",
            "axes.titlelocation": "left",
            "axes.spines.top": False,
            "axes.spines.right": False,
            "axes.edgecolor": "#555555",
            "axes.grid": True,
            "grid.color": "#e6e6e6",
            "grid.linewidth": 0.7,
            "axes.axisbelow": True,
            "legend.frameon": False,
            "lines.linewidth": 1.8,
            "lines.markersize": 4.5,
            "figure.dpi": 130,
            "savefig.facecolor": "white",
        }
    )
    return plt


def save(figure, name: str) -> None:
    """Save a chart for the documentation."""
    IMAGES.mkdir(parents=True, exist_ok=True)
    figure.savefig(IMAGES / name, bbox_inches="tight", pil_kwargs={"optimize": True})
    print("wrote", f"docs/images/{name}")
