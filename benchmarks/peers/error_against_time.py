"""Error against computing time: msdwarp's methods and newton's solvers in one chart.

    python -m benchmarks.peers.error_against_time [--device D] [--quick] [--plot-only]

Cases, errors, steps and solvers are those of `equal_error`. Each method is run with twice as many steps again and
again, from 60 a simulated second until its error is 1e-5, no longer falls, or a run takes too long.
Each run is timed by itself, without compiling; a short one three times on a CPU, whose other work would show.
"""

import math
import sys
import time
from pathlib import Path
from statistics import median

from ..cases import CASES, Case, reference, relative_error
from ..common import COLORS, MARKERS, arguments, machine, pyplot, read_csv, save, table, write_csv
from .compare import attempt
from .equal_error import FEWEST, MOST, MSDWARP, Msdwarp, Newton

SOLVERS = ("semi-implicit", "XPBD, 2 iterations (default)", "VBD, 10 iterations (default)")
NEWTON_COLORS = dict(zip(SOLVERS, ("#7a3e9d", "#a0522d", "#555555"), strict=True))
LONGEST = {"cpu": 2.0, "gpu": 0.3}
"""Runs that take longer [s] are the last of their method."""
SHORT = 0.1
"""Runs that take less [s] are timed three times on a CPU."""
ACCURATE, FLAT = 1e-5, 1.5
"""An error that is small enough; and how much of it twice the steps must take away once it is below a tenth."""


def curve(case: Case, code: str, method: str, wanted, device: str, rounds: int) -> list[dict]:
    """Return a row for each number of steps that was tried with a method."""
    row = {"case": case.name, "code": code, "method": method, "steps_per_second": float("nan")}
    row |= {"error": float("nan"), "seconds_per_simulated_second": float("nan"), "note": ""}
    solver = attempt(row, {"msdwarp": Msdwarp, "newton": Newton}[code], case, method, device)
    if solver is None:
        return [row]
    rows, before, rate = [], math.inf, FEWEST
    for _ in range(rounds):
        position, seconds = solver.run(round(rate * case.duration))
        if device == "cpu" and seconds < SHORT:
            seconds = median([seconds, *(solver.run(round(rate * case.duration))[1] for _ in range(2))])
        error = relative_error(case, position, wanted)
        if math.isfinite(error) and error < 10:
            found = {"error": error, "seconds_per_simulated_second": seconds / case.duration}
            rows.append(row | {"steps_per_second": float(rate)} | found)
            falls = before > 0.1 or error * FLAT < before
            if error < ACCURATE or not falls or seconds > LONGEST["cpu" if device == "cpu" else "gpu"]:
                break
            before = error
        rate *= 2
        if rate > MOST:
            break
    return rows or [row | {"note": "diverged"}]


def measure(options, path: Path) -> None:
    """Measure every case and method; what is known is written after each case."""
    rows = []
    for name in ("cloth",) if options.quick else ("cloth", "jelly"):
        start = time.perf_counter()
        case = CASES[name]()
        wanted = reference(case, 1e-9)
        for code, methods in {"msdwarp": MSDWARP, "newton": SOLVERS}.items():
            for method in methods:
                rows += curve(case, code, method, wanted, options.device, 3 if options.quick else 99)
        write_csv(path, rows, machine(options.device))
        print(f"{case.title}: {time.perf_counter() - start:.0f} s", flush=True)


def draw(line: str, rows: list[dict], name: str) -> None:
    """Draw a chart of both cases."""
    plt = pyplot()
    cases = list(dict.fromkeys(row["case"] for row in rows))
    figure, axes = plt.subplots(1, len(cases), figsize=(5.2 * len(cases), 4.8), sharey=True, layout="constrained")
    for axis, case in zip([axes] if len(cases) == 1 else axes, cases, strict=True):
        for code, method in dict.fromkeys((row["code"], row["method"]) for row in rows):
            mine = [row for row in rows if (row["case"], row["code"], row["method"]) == (case, code, method)]
            mine = [row for row in mine if row["error"] == row["error"]]
            x, y = [1e3 * row["seconds_per_simulated_second"] for row in mine], [row["error"] for row in mine]
            own = code == "msdwarp"
            style = {"color": COLORS[method], "marker": MARKERS[method]} if own else {"marker": "P"}
            style |= {} if own else {"color": NEWTON_COLORS[method], "linestyle": "--"}
            axis.loglog(x, y, label=method if own else f"newton: {method.partition(' (')[0]}", **style)
        axis.set(title=case, xlabel="computing time for a simulated second [ms]")
        axis.grid(visible=True, which="major", alpha=0.3)
    first = figure.axes[0]
    first.set_ylabel("relative position error")
    figure.legend(*first.get_legend_handles_labels(), loc="outside lower center", ncols=4)
    title = f"Error against computing time, float32 ({line.split(';')[0]})"
    figure.suptitle(title, x=0.01, ha="left", fontsize=12)
    save(figure, f"error_against_time_{name}.png")


def main() -> None:
    """Measure, write, print and draw."""
    options = arguments(__doc__.splitlines()[0])
    path = options.folder / "error_against_time.csv"
    if not options.plot_only:
        measure(options, path)
    line, rows = read_csv(path)
    print(line)
    columns = ["case", "code", "method", "steps_per_second", "error", "seconds_per_simulated_second", "note"]
    table("Error against computing time", columns, [[row[one] for one in columns] for row in rows])
    if not options.quick:
        draw(line, rows, options.folder.name)


if __name__ == "__main__":
    sys.exit(main())
