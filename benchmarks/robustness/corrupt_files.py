"""A thousand damaged files through all commands that read files: each ends in words, or right.

Run: python -m benchmarks.robustness.corrupt_files
"""

import argparse
import os
import random
import shutil
import tempfile
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path

import numpy as np

from ..common import arguments, machine, read_csv, table, write_csv
from .corruption import array_ranges, craft, craft_restart, damaged, touches
from .forked import Ended, ended, import_all, probed_once

WAYS = ("flip", "flips", "cut", "page", "noise", "crafted")
FAILURES = ("wrong", "traceback", "signal", "hang", "script", "odd")
COMMANDS = {
    "info": ["info", "run"],
    "export": ["export", "run", "--to", "npz", "--out", "all.npz"],
    "plot": ["plot", "run", "--out", "plot.csv"],
    "render": ["render", "run", "--last", "1", "--resolution", "64x64", "--video", "none", "--out", "pictures"],
    "rerun": ["rerun", "run", "--quiet"],
    "resume": ["resume", "run", "--duration", "0.35", "--quiet"],
}
SCENE = """
import numpy as np
from msdwarp import Box, Look, Plane, Scene, Sphere, at, box

def motion(t):
    return (0.2 * np.sin(9 * t), 0, 0), (0, 0, 3 * t)

def build(*, size: int = 3):
    body = box((size, size, 3), 0.1, mass=0.01, stiffness=300.0, damping=0.2).translate((0, 0, 0.3))
    body = body.replace(groups={"some": [0, 1, 2]})
    texture = np.random.default_rng(0).integers(0, 255, (32, 32, 3)).astype(np.uint8)
    colliders = [Plane(friction=np.inf), Box((0, 0, 0.1), (0.3, 0.1, 0.1), motion=motion), Sphere((1, 0, 0), 0.2)]
    schedule = [at(0.05, stiffness=lambda k: 2 * k, group="some"), at(0.1, mass=0.02)]
    return Scene(system=body, colliders=colliders, schedule=schedule, look=Look(texture=texture), duration=0.3)
"""
EVIL = "from pathlib import Path\nPath(__file__).with_name('ran').touch()\n" + SCENE


class Sound:
    """A run that is sound, and what commands make of it."""

    def __init__(self, root: Path, kind: str) -> None:
        self.folder = root / kind
        self.folder.mkdir()
        words = ["--frames", "none", "--video", "none", "--device", "cpu", "--trajectory", kind, "--out", "run"]
        self.run = self.folder / "run"
        made = ended(["run", str(root / "scene.py"), *words], self.folder)
        assert made.code == 0, made
        self.files = {path.name: path.read_bytes() for path in self.run.iterdir()}
        self.ranges = {name: array_ranges(self.run / name) for name in self.files}
        self.results = {}
        for name, words in COMMANDS.items():
            end = ended(words, self.folder)
            assert end.code == 0, (name, end)
            self.results[name] = results(name, self.folder, end)


def results(command: str, folder: Path, end: Ended) -> dict[str, object]:
    """Return what a command has made, in parts; `frames` are those that come from the numbers of frames."""
    if command == "info":
        first, _, rest = end.out.partition("\n")
        return {"frames": first.rpartition(",")[0], "text": rest}
    if command == "export":
        with np.load(folder / "all.npz") as found:
            arrays = {name: found[name].tobytes() for name in found.files}
        frames = [arrays.pop(name) for name in ("positions", "velocities", "times")]
        return {"frames": frames, "system": arrays}
    if command == "plot":
        return {"frames": (folder / "plot.csv").read_text()}
    if command == "render":
        return {"frames": [path.read_bytes() for path in sorted((folder / "pictures").iterdir())]}
    if command == "resume":
        from msdwarp import Trajectory

        with Trajectory(folder / "run" / "trajectory.vtkhdf") as found:
            new = [one[19:].tobytes() for one in (found.positions, found.velocities, found.times)]
            try:
                old = [one[:19].tobytes() for one in (found.positions, found.velocities, found.times)]
            except OSError:  # a part that was compressed, which is not read to go on behind it
                old = []
        return {"frames": old, "new": new}
    return {}


def judged(command: str, end: Ended, folder: Path, sound: Sound, numbers: bool, crafted: bool) -> str:
    """Return the class of an outcome; `numbers` is whether those of frames were damaged, which nothing notices."""
    if end.hung:
        return "hang"
    if (folder / "ran").exists() or (folder.parent / "ran").exists():
        return "script"
    if end.code < 0:
        return "signal"
    if "Traceback" in end.err or "Error:" in end.err.partition("\n")[0][:30]:
        return "traceback"
    if end.code == 1:
        last = end.err.rstrip("\n").rpartition("\n")[2] if command == "render" else end.err
        return "refused" if last.startswith("error: ") and len(last) < 5000 and _printable(end.err) else "odd"
    if end.code != 0 or not _printable(end.out + end.err):
        return "odd"
    if crafted:
        return "as it says"
    found, expected = results(command, folder, end), sound.results[command]
    if found == expected:
        return "right"
    if "drawn with" in end.err:
        return "told"
    same = all(found[name] == expected[name] for name in expected if name != "frames")
    return "numbers" if same and numbers else "wrong"


def _printable(text: str) -> bool:
    return text.replace("\n", "").isprintable()


def case(k: int, seed: int, given: str | None, restarts: float, root: Path, sounds: list[Sound]) -> list[dict]:
    """Return what became of damaged file number k, by command."""
    chance = random.Random(f"{seed} {k}")
    way, sound = given or WAYS[k % len(WAYS)], sounds[k // len(WAYS) % len(sounds)]
    file = "restart.h5" if chance.random() < 7 * restarts / (7 * restarts + 13) else "trajectory.vtkhdf"
    folder = root / f"case{k}"
    (folder / "run").mkdir(parents=True)
    for name, content in sound.files.items():
        (folder / "run" / name).write_bytes(content)
    evil, path, detail = folder / "evil.py", folder / "run" / file, ""
    evil.write_text(EVIL)
    if way == "crafted":
        raw = file == "trajectory.vtkhdf" or chance.random() < 0.3
        detail = (craft if raw else craft_restart)(path, evil, chance)
    else:
        path.write_bytes(damaged(sound.files[file], way, sound.ranges[file], chance))
    frames = sound.ranges[file][0]  # none in a restart file, where all has checksums
    numbers = touches(frames, sound.files[file], path.read_bytes())
    _probe(path)
    rows = []
    for command in COMMANDS if file == "trajectory.vtkhdf" else ("info", "resume"):
        end = ended(COMMANDS[command], folder)
        outcome = judged(command, end, folder, sound, numbers, way == "crafted")
        row = {"file": k, "kind": file, "way": way, "command": command, "outcome": outcome, "seconds": end.seconds}
        rows.append(row)
        if outcome in FAILURES:
            said = (end.err + end.out)[-1500:]
            print(f"\nfile {k} ({sound.folder.name} {file}, {way} {detail!a}), {command}: {outcome}\n{said!s}")
    shutil.rmtree(folder)
    return rows


def _probe(path: Path) -> None:
    from msdwarp.files import probe

    with suppress(ValueError):
        probe(path)


def main() -> None:
    """Damage files, run the commands, print and write what became of it."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--files", type=int, default=1000, help="how many")
    own.add_argument("--seed", type=int, default=1, help="of chance; a file is the same again by seed and number")
    own.add_argument("--minutes", type=float, default=60.0, help="after which no other is begun")
    own.add_argument("--way", choices=WAYS, help="damage files in this way alone")
    own.add_argument("--restarts", type=float, default=1.0, help="weight of restart files, beside 1")
    own.add_argument("--only", type=int, help="this file alone, by its number")
    options = arguments(__doc__ or "", own)
    path = options.folder / "corrupt_files.csv"
    if options.plot_only:
        line, rows = read_csv(path)
    else:
        count = 24 if options.quick else options.files
        numbers = range(count) if options.only is None else [options.only]
        how = options.seed, options.way, options.restarts, options.minutes
        line, rows = machine("cpu"), campaign(numbers, *how)
        if options.only is None:
            write_csv(path, rows, line)
    report(line, rows)


def campaign(
    numbers: range | list[int], seed: int, way: str | None, restarts: float, minutes: float
) -> list[dict]:
    """Return what became of damaged files of these numbers, by command."""
    import_all()
    probed_once()
    rows, began = [], time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        os.environ["XDG_STATE_HOME"] = str(root / "state")  # the key that seals scripts is not the user's
        (root / "scene.py").write_text(SCENE)
        sounds = [Sound(root, kind) for kind in ("plain", "compressed")]
        for k in numbers:
            if time.monotonic() - began > 60 * minutes:
                break
            rows += case(k, seed, way, restarts, root, sounds)
            if k % 50 == 49:
                print(f"{k + 1} files in {time.monotonic() - began:.0f} s", flush=True)
    return rows


def report(line: str, rows: list[dict]) -> None:
    """Print how many outcomes there were of each class."""
    print(line)
    counted = Counter((row["way"], row["outcome"]) for row in rows)
    kinds = Counter(kind for kind, _ in {(row["kind"], row["file"]) for row in rows})
    print(", ".join(f"{count} of {kind}" for kind, count in kinds.items()))
    outcomes = sorted({row["outcome"] for row in rows})
    ways = [way for way in WAYS if any(row["way"] == way for row in rows)]
    lines = [[way, *(str(counted[way, one]) for one in outcomes)] for way in ways]
    table(f"{len({row['file'] for row in rows})} files, {len(rows)} commands", ["way", *outcomes], lines)
    failures = sum(row["outcome"] in FAILURES for row in rows)
    print(f"failures: {failures}; the longest command took {max(row['seconds'] for row in rows):.1f} s")


if __name__ == "__main__":
    main()
