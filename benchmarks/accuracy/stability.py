"""Where do the methods fail? Stability limits, measured and predicted, and the bound that a simulation uses.

    python -m benchmarks.accuracy.stability [--device D] [--quick] [--plot-only]

For each scene's body at rest, without gravity: its fastest mode and a random displacement, of 1e-8 m together,
are released, the mode with a speed of 1e-8 m a step, and the displacement in the last quarter of a run is compared
with that in the second, unless a hundredfold growth is seen before. Bisection on the step finds where it begins
to grow. A run is long enough to see the growth predicted 1 % beyond the limit; where that takes too long (1e8
connection updates) nothing is measured. Predicted is the least step at which any mode grows, from the largest
eigenvalue (`theory`); bounded is what `msdwarp.stability_limit` says without knowing any eigenvalue.
"""

import math
import sys

import numpy as np

from msdwarp import RKC2, Simulation, SimulationDiverged, System, stability_limit

from ..cases import CASES
from ..common import COLORS, MARKERS, METHODS, arguments, machine, pyplot, read_csv, save, table, write_csv
from .theory import amplification, stable_step, top_mode

AMPLITUDE = 1e-8


def body_at_rest(name: str) -> System:
    """Return the body of a scene, still and without strain."""
    system = CASES[name]().system
    if name == "chain":
        return system.replace(position=np.arange(system.particle_count)[:, None] * 1.0)
    if name in ("mattress", "jelly", "soft_cube"):
        first, last = system.position[0], system.position[-1]
        shape = {"mattress": (20, 7, 2), "jelly": (10, 10, 10), "soft_cube": (7, 7, 7)}[name]
        extent = np.abs(last - first)
        system = system.replace(position=(system.position - first) * (np.array(shape) - 1) / extent)
    return system.with_velocity(0.0)


def grows(system: System, method, h: float, mode, *, steps: int, device: str) -> bool:
    """Tell whether a tiny displacement grows from the middle to the end of `steps` substeps of h seconds."""
    noise = np.random.default_rng(1).uniform(-0.1, 0.1, mode.shape) * ~system.pinned[:, None]
    start, velocity = system.position + AMPLITUDE * (mode + noise), AMPLITUDE / h * mode
    seeded = system.replace(position=start, velocity=velocity)
    substeps = 20
    simulation = Simulation(
        seeded,
        gravity=0.0,
        integrator=method,
        fps=1 / (h * substeps),
        substeps=substeps,
        allow_unstable=True,
        energy_limit=math.inf,
        device=device,
        precision="float64",
    )
    sizes = []
    try:
        for _ in range(math.ceil(steps / substeps)):
            with np.errstate(over="ignore", invalid="ignore"):
                simulation.step()
            sizes.append(np.abs(simulation.frame().position - system.position).max())
            if sizes[-1] > 100 * AMPLITUDE:
                return True
    except SimulationDiverged:
        return True
    quarter = len(sizes) // 4
    return max(sizes[-quarter:]) > 1.5 * max(sizes[quarter : 2 * quarter])


def measured_limit(system: System, method, predicted: float, mode, *, steps: int, device: str) -> float:
    """Return the step at which growth begins [s], by bisection from half to twice the predicted one."""
    low, high = 0.5 * predicted, 2.0 * predicted
    if grows(system, method, low, mode, steps=steps, device=device):
        return float("nan")
    middle = predicted  # bisection starts close: growth at 2 % beyond and none at 2 % below
    for share, beyond in ((0.98, False), (1.02, True)):
        if grows(system, method, share * middle, mode, steps=steps, device=device) is beyond:
            low, high = (low, share * middle) if beyond else (share * middle, high)
    while high - low > 1e-3 * predicted:
        middle = (low + high) / 2
        if grows(system, method, middle, mode, steps=steps, device=device):
            high = middle
        else:
            low = middle
    return (low + high) / 2


def measure(options) -> list[dict]:
    """Return a row for every scene and method."""
    rows = []
    for name in ["chain", "mattress"] if options.quick else CASES:
        system = body_at_rest(name)
        largest, mode = top_mode(system)
        ratio = float(system.damping[0] / system.stiffness[0])
        print(name, end=" ", flush=True)
        for method_name, method in METHODS.items():
            method = RKC2(5) if method_name == "RKC2" else method
            predicted = stable_step(method, largest, ratio)
            row = {"scene": name, "method": method_name, "largest_eigenvalue": largest, "predicted": predicted}
            steps = run_length(method, predicted, largest, ratio)
            row["measured"] = float("nan")
            work = steps * (system.connection_count + 500) * method.evaluations
            if work < (2e7 if options.quick else 1e8):
                row["measured"] = measured_limit(
                    system, method, predicted, mode, steps=steps, device=options.device
                )
            row["bounded"] = stability_limit(system, method)
            rows.append(row)
    return rows


def run_length(method, predicted: float, largest: float, ratio: float) -> float:
    """Return the substeps in which the growth predicted 1 % beyond the limit is seen, at least 1000."""
    modes = largest * np.linspace(0, 1, 401)[1:]
    rate = math.log(amplification(method, 1.01 * predicted, modes, ratio).max())
    return max(1000, math.ceil(2 / rate)) if rate > 1e-9 else math.inf


def show(rows: list[dict]) -> None:
    """Print limits in milliseconds, and ratios."""
    body = [
        [
            r["scene"],
            r["method"],
            *(f"{1e3 * r[k]:.4g}" for k in ("predicted", "measured", "bounded")),
            *(f"{r[k] / r['predicted']:.4f}" for k in ("measured", "bounded")),
        ]
        for r in rows
    ]
    head = ["scene", "method", "predicted [ms]", "measured [ms]", "bound [ms]", "measured / predicted"]
    table("Largest stable step", [*head, "bound / predicted"], body)


def plot(rows: list[dict]) -> None:
    """Draw measured and bounded limits over predicted ones."""
    plt = pyplot()
    scenes = list(dict.fromkeys(r["scene"] for r in rows))
    figure, axes = plt.subplots(1, 2, figsize=(9.6, 4.4), sharey=True, layout="constrained")
    for k, method in enumerate(METHODS):
        mine = [r for r in rows if r["method"] == method]
        heights = [scenes.index(r["scene"]) + 0.11 * (k - 2.5) for r in mine]
        style = {"color": COLORS[method], "marker": MARKERS[method], "linestyle": "none", "markersize": 6}
        axes[0].plot([r["measured"] / r["predicted"] for r in mine], heights, label=method, **style)
        axes[1].plot([r["bounded"] / r["predicted"] for r in mine], heights, **style)
    for axis in axes:
        axis.axvline(1, color="#333333", linewidth=1)
        axis.grid(axis="y", visible=False)
        for k in range(1, len(scenes)):
            axis.axhline(k - 0.5, color="#eeeeee", linewidth=1)
    labels = [s.replace("_", " ") for s in scenes]
    axes[0].set_yticks(range(len(scenes)), labels)
    axes[0].invert_yaxis()
    axes[0].axvspan(0.995, 1.005, color="#333333", alpha=0.05, linewidth=0)
    axes[0].set(xlim=(0.98, 1.02), xlabel="measured limit / predicted limit")
    axes[0].set_title("Theory predicts where methods fail …")
    axes[1].set(xlim=(0, 1.1), xlabel="step the simulator allows / predicted limit")
    axes[1].set_title("… and the simulator stays below")
    axes[1].axvspan(1, 1.1, color="#c8352b", alpha=0.08, linewidth=0)
    axes[1].text(1.05, 0.5, "unstable", rotation=90, color="#c8352b", ha="center", va="center",
                 transform=axes[1].get_xaxis_transform())  # fmt: skip
    figure.legend(loc="outside lower center", ncols=6)
    save(figure, "stability.png")


def main() -> None:
    """Measure, write, print and draw."""
    options = arguments(__doc__.splitlines()[0])
    path = options.folder / "stability.csv"
    if not options.plot_only:
        write_csv(path, measure(options), machine(options.device))
    _, rows = read_csv(path)
    show(rows)
    if not options.quick:
        plot(rows)


if __name__ == "__main__":
    sys.exit(main())
