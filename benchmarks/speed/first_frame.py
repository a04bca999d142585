"""How long until the first frame: with nothing compiled, and with everything compiled.

Each time is that of a fresh process, from its start to the end of the scene's first frame; with nothing compiled
the folder of compiled kernels is fresh, too. `--against FOLDER` measures the version in another folder in turn.

    python -m benchmarks.speed.first_frame --scenes cube,cloth,dice --rounds 3
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from ..common import RESULTS, arguments, machine, read_csv, scene_scripts, table, write_csv

SCENES = ("cube", "cloth", "curtain", "tower", "dice")
PROGRAM = """
import importlib, sys, time
import warp as wp
wp.config.log_level = wp.LOG_ERROR
import msdwarp
scene = importlib.import_module("msdwarp.scenes." + sys.argv[1]).build()
simulation = msdwarp.Simulation.from_scene(scene, device=sys.argv[2])
simulation.step()
wp.synchronize()
now = time.time()
worst = 0.0
for _ in range(int(sys.argv[3])):
    begun = time.perf_counter()
    simulation.step()
    wp.synchronize()
    worst = max(worst, time.perf_counter() - begun)
from msdwarp.runtime import Compiling
print("first", now, Compiling.modules, worst)
"""


def first_frame(scene: str, device: str, cache: str, version: Path, frames: int) -> tuple[float, int, float]:
    """Return (seconds until the first frame, kernels compiled until the end, longest of the later frames [s])."""
    path = os.pathsep.join(filter(None, (str(version), os.environ.get("PYTHONPATH"))))
    environment = os.environ | {"WARP_CACHE_PATH": cache, "PYTHONPATH": path}
    command = [sys.executable, "-c", PROGRAM, scene, device, str(frames)]
    begun = time.time()  # of all processes; a performance counter may be a process's own
    done = subprocess.run(command, env=environment, cwd=version, capture_output=True, text=True)
    words = (done.stdout.splitlines() or [""])[-1].split()
    if done.returncode or words[:1] != ["first"]:
        raise SystemExit(f"{scene} failed:\n{done.stderr}")
    return float(words[1]) - begun, int(words[2]), float(words[3])


def measured(options: argparse.Namespace) -> list[dict]:
    """Measure each scene and version in turn, `rounds` times, and return the medians."""
    here = Path(__file__).parents[2]
    versions = {"this": here} | ({"other": Path(options.against).resolve()} if options.against else {})
    found: dict[tuple[str, str], list[tuple]] = {}
    for _ in range(options.rounds):
        for scene in options.scenes.split(","):
            for name, folder in versions.items():
                with tempfile.TemporaryDirectory() as cache:
                    cold = first_frame(scene, options.device, cache, folder, options.frames)
                    warm = first_frame(scene, options.device, cache, folder, 0)
                found.setdefault((scene, name), []).append((*cold, warm[0]))
    rows = []
    for (scene, name), all_rounds in found.items():
        cold, modules, longest, warm = (sorted(one)[len(one) // 2] for one in zip(*all_rounds, strict=True))
        row = {"scene": scene, "version": name, "nothing_compiled_s": cold, "all_compiled_s": warm}
        rows.append(row | {"kernels": modules, "longest_later_frame_s": longest, "rounds": options.rounds})
    return rows


def main() -> None:
    """Measure, write and print."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--scenes", default=",".join(SCENES), help="names, separated by commas; or all")
    own.add_argument("--rounds", type=int, default=3, help="how often each is measured; the median counts")
    own.add_argument("--frames", type=int, default=90, help="later frames, of which the longest is told")
    own.add_argument("--against", help="a folder with another version, to measure in turn")
    options = arguments(__doc__.splitlines()[0], own)
    if options.quick:
        options.scenes, options.rounds, options.frames = "cube", 1, 3
    if options.scenes == "all":
        options.scenes = ",".join(scene_scripts())
    path = options.folder / "first_frame.csv"
    if not options.plot_only:
        line = machine(options.device)
        if hasattr(os, "getloadavg"):
            line += f"; other programs' load at the start {os.getloadavg()[0]:.1f}"
        write_csv(path, measured(options), line)
        print("wrote", path.relative_to(RESULTS.parents[1]) if path.is_relative_to(RESULTS) else path)
    line, rows = read_csv(path)
    columns = [
        "scene",
        "version",
        "nothing compiled [s]",
        "all compiled [s]",
        "kernels",
        "longest later frame [s]",
    ]
    table(f"First frame: {line}", columns, [list(row.values())[:6] for row in rows])


if __name__ == "__main__":
    main()
