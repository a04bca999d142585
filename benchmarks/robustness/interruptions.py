"""Five hundred commands interrupted at random moments: each ends with a word and its code, and can be finished.

Run: python -m benchmarks.robustness.interruptions
"""

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from msdwarp import Trajectory

from ..common import arguments, machine, read_csv, table, write_csv
from .forked import ended, import_all

FAILURES = ("traceback", "signal", "hang", "unsaid", "left", "lost")
WORDS = {
    "run": "run cube --size 4 --duration 0.3 --resolution 64x64 --device cpu --frames png --out run",
    "resume": "resume run --duration 0.5 --force",
    "render": "render run --resolution 64x64 --frames png --video webp --out pictures",
    "export obj": "export run --to obj --out all.obj",
    "export npz": "export run --to npz --out all.npz",
    "plot": "plot run --out plot.png",
    "info": "info run",
}
SHARES = (50, 14, 14, 8, 4, 6, 4)
"""How many of a hundred commands are each of these."""


def started(words: list[str], folder: Path) -> subprocess.Popen:
    """Start a command in a folder, hearing signals as in a terminal."""
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "msdwarp", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


class Whole:
    """Commands that nothing interrupts: what they take and leave."""

    def __init__(self, root: Path) -> None:
        self.folder, self.seconds = root / "whole", {}
        for name, words in WORDS.items():
            folder = self.ready(name, root / name.replace(" ", "_"))
            for _ in range(2):  # the first compiles
                shutil.rmtree(folder)
                self.ready(name, folder)
                began = time.monotonic()
                process = started(words.split(), folder)
                _, err = process.communicate(timeout=120)
                assert process.returncode == 0, err
                self.seconds[name] = time.monotonic() - began
            if name == "run":
                shutil.copytree(folder, self.folder)
        self.frames = {"run": frames(self.folder), "resume": frames(root / "resume")}

    def ready(self, name: str, folder: Path) -> Path:
        """Return a folder with what a command needs."""
        if name == "run":
            folder.mkdir()
        else:
            shutil.copytree(self.folder, folder)
        return folder


def frames(folder: Path) -> bytes:
    """Return the numbers of a run's frames."""
    with Trajectory(folder / "run" / "trajectory.vtkhdf") as found:
        return found.times.tobytes() + found.positions[:].tobytes()


def case(k: int, seed: int, root: Path, whole: Whole) -> dict:
    """Interrupt command number k; return what became of it."""
    chance = random.Random(f"{seed} {k}")
    name = chance.choices(list(WORDS), SHARES)[0]
    number = signal.SIGTERM if chance.random() < 0.2 else signal.SIGINT
    after = chance.uniform(0.0, 1.02 * whole.seconds[name])
    folder = whole.ready(name, root / f"case{k}")
    process = started(WORDS[name].split(), folder)
    time.sleep(after)
    os.killpg(process.pid, number)
    try:
        out, err = process.communicate(timeout=60)
        outcome = judged(name, number, process.returncode, out, err, folder, whole)
    except subprocess.TimeoutExpired:
        process.kill()
        out, err = process.communicate()
        outcome = "hang"
    if outcome in FAILURES:
        print(f"\ncommand {k} ({name}), {number.name} after {after:.3f} s: {outcome}, {process.returncode}")
        print((out + err)[-3000:], *sorted(map(str, folder.rglob("*"))), sep="\n", flush=True)
    shutil.rmtree(folder)
    return {"command": name, "signal": number.name, "after": after, "code": process.returncode, "outcome": outcome}


def judged(name: str, number: int, code: int, out: str, err: str, folder: Path, whole: Whole) -> str:
    """Return the class of an outcome."""
    traced = "Traceback" in err or "Fatal Python error" in err or "Exception ignored" in err
    if (traced and "msdwarp/" not in err) or (code == -number and not err):
        return "left" if name == "run" and any(folder.iterdir()) else "before"  # while Python starts, before us
    if traced:
        return "traceback"
    if code < 0:
        return "signal"
    if code == 0:
        return "complete" if not err and finished(name, folder, whole, ()) else "unsaid"
    word = "interrupted" if number == signal.SIGINT else "terminated"
    if code != 128 + number or not err.startswith(word) or err.count("\n") != 1:
        return "unsaid"
    if any(".unfinished" in path.name for path in folder.rglob("*")):
        return "left"
    begun = name != "run" or (folder / "run" / "restart.h5").exists()
    if not begun:
        return "lost" if (folder / "run").exists() and any((folder / "run").iterdir()) else "not begun"
    return "finished" if finished(name, folder, whole, ("--force",)) else "lost"


def finished(name: str, folder: Path, whole: Whole, again: tuple[str, ...]) -> bool:
    """Tell whether a command has done, or where `again` is given does when asked again, what it should."""
    if again and name != "info":
        words = ["resume", "run"] if name in ("run", "resume") else WORDS[name].split()
        longer = ["--duration", "0.5"] if name == "resume" else []
        end = ended([*words, *longer, *again], folder)
        if end.code != 0:
            print(end.err)
            return False
    return name not in whole.frames or frames(folder) == whole.frames[name]


def main() -> None:
    """Interrupt commands, print and write what became of them."""
    own = argparse.ArgumentParser(add_help=False)
    own.add_argument("--commands", type=int, default=500, help="how many")
    own.add_argument("--minutes", type=float, default=90.0, help="after which no other is begun")
    own.add_argument("--seed", type=int, default=1, help="of chance; moments are the same again, machines are not")
    options = arguments(__doc__ or "", own)
    path = options.folder / "interruptions.csv"
    if options.plot_only:
        line, rows = read_csv(path)
    else:
        count = 10 if options.quick else options.commands
        line, rows = machine("cpu"), campaign(count, options.seed, options.minutes)
        write_csv(path, rows, line)
    report(line, rows)


def campaign(count: int, seed: int, minutes: float) -> list[dict]:
    """Return what became of so many commands."""
    import_all()
    rows, began = [], time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        whole = Whole(Path(folder))
        for k in range(count):
            if time.monotonic() - began > 60 * minutes:
                break
            rows.append(case(k, seed, Path(folder), whole))
            if k % 50 == 49:
                print(f"{k + 1} commands", flush=True)
    return rows


def report(line: str, rows: list[dict]) -> None:
    """Print how many outcomes there were of each class."""
    print(line)
    counted = Counter((row["command"], row["outcome"]) for row in rows)
    outcomes = sorted({row["outcome"] for row in rows})
    lines = [[name, *(str(counted[name, one]) for one in outcomes)] for name in WORDS]
    table(f"{len(rows)} interrupted commands", ["command", *outcomes], lines)
    print(f"failures: {sum(row['outcome'] in FAILURES for row in rows)}")


if __name__ == "__main__":
    main()
