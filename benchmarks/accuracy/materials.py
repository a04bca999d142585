"""Does a material show the modulus and the ratio that it is given? A pulled bar, a cantilever, a bonded block.

    python -m benchmarks.accuracy.materials [--device D] [--quick] [--plot-only]

Four questions, each a CSV; bodies are led to equilibrium by `Simulation.settle`:

- material_bar.csv: a bar is pulled at its ends, with nothing else held, until it is about 1 % and 10 % longer.
  Which Poisson's ratio and Young's modulus does its middle show? By logarithmic strains, and by nominal stress.
  `substeps` is the number that stability asks for over that of springs alone.
- material_bending.csv: a bar six times as long as high bends under moments at its ends, with nothing held, or
  under a force at one end while the other is clamped. Is its deflection that of a beam, by Timoshenko's theory?
  The clamped end hinders the contraction across, which theory does not know.
- material_block.csv: a cube is bonded to two plates and compressed by 0.01 % and 30 %. Is it as stiff as by finite
  elements (scikit-fem, 8³ hexahedra of second order in an eighth, small strain)? How small is the smallest cell?
- material_steps.csv: how many substeps does stability ask for, with dampers and without, over those of springs
  alone that are damped alike? A bar and a cube, each of one material.
"""

import warnings
from typing import Any

import numpy as np
from scipy.sparse.linalg import splu

from msdwarp import Force, Material, Simulation, System, box

from ..common import arguments, machine, pyplot, read_csv, save, table, write_csv

RATIOS = (0.0, 0.1, 0.25, 0.35, 0.45, 0.49)
ACROSS = (4, 6, 8)
MODULUS, SPACING = 1e5, 0.05
PARTS = ("bar", "bending", "block", "steps")
BODIES = {"bar 2 × 2 × 40": (3, 3, 41), "cube 10 × 10 × 10": (11, 11, 11)}


def material(ratio: float | None, damping_ratio: float = 0.0) -> Material:
    """Return the material of all bodies."""
    return Material(1000.0, MODULUS, damping_ratio, poissons_ratio=ratio)


def cost(shape: tuple[int, int, int], ratio: float, device: str, damping_ratio: float = 0.0) -> float:
    """Return the least number of substeps over that of springs alone."""
    stuffs = [material(one, damping_ratio) for one in (None, ratio)]
    bodies = [box(shape, SPACING, material=stuff) for stuff in stuffs]
    limits = [Simulation(body, gravity=0.0, device=device).choice.limit for body in bodies]
    return limits[0] / limits[1]


def measure_steps(options: Any) -> list[dict[str, Any]]:
    """Measure the substeps that stability asks for, over those of springs alone with the same damping ratio."""
    return [
        {"body": name, "damping_ratio": zeta, "ratio": ratio, "times": cost(shape, ratio, options.device, zeta)}
        for name, shape in BODIES.items()
        for zeta in (0.0, 0.05)
        for ratio in RATIOS
    ]


def settled(system: System, device: str, tolerance: float, loads: Any = ()) -> Simulation:
    """Return a simulation of a system in equilibrium."""
    simulation = Simulation(system, loads=loads, gravity=0.0, device=device, precision="float64")
    if not simulation.settle(tolerance).converged:
        warnings.warn("a body has not settled", stacklevel=2)
    return simulation


def spread(force: Any, system: System, where: np.ndarray) -> list[Force]:
    """Return loads that spread a force over particles as a uniform stress does: in proportion to their masses."""
    share = system.mass / system.mass[where].sum()
    return loads_of(share[:, None] * np.array(force), where)


def loads_of(forces: np.ndarray, where: np.ndarray) -> list[Force]:
    """Return a load for each group of particles on which equal forces act."""
    different, group = np.unique(forces[where].round(12), axis=0, return_inverse=True)
    members = np.flatnonzero(where)
    return [Force(tuple(one), on=members[group.ravel() == k]) for k, one in enumerate(different)]


def measure_bar(options: Any) -> list[dict[str, Any]]:
    """Pull bars."""
    rows = []
    for ratio in RATIOS:
        for n in ACROSS[:1] if options.quick else ACROSS:
            shape = (2 * n + 1, n + 1, n + 1)
            system = box(shape, SPACING, material=material(ratio))
            x = system.position
            ends = [x[:, 0] < x[:, 0].min() + SPACING / 2, x[:, 0] > x[:, 0].max() - SPACING / 2]
            middle = np.abs(x[:, 0]) < SPACING / 2
            area = (n * SPACING) ** 2
            for strain in (0.01, 0.1):
                pull = MODULUS * strain * area
                loads = spread((-pull, 0, 0), system, ends[0]) + spread((pull, 0, 0), system, ends[1])
                now = settled(system, options.device, 1e-6 * pull, loads).frame().position
                longer = np.ptp(now[:, 0]) / np.ptp(x[:, 0])
                wider = np.ptp(now[middle, 1]) / np.ptp(x[middle, 1])
                rows.append(
                    {
                        "ratio": ratio,
                        "across": n,
                        "strain": longer - 1,
                        "measured_ratio": -np.log(wider) / np.log(longer),
                        "measured_modulus": strain / (longer - 1),
                        "substeps": cost(shape, ratio, options.device),
                    }
                )
    return rows


def measure_bending(options: Any) -> list[dict[str, Any]]:
    """Bend bars."""
    rows = []
    for ratio in (0.1, 0.25, 0.45, 0.49):
        for n in ACROSS[:1] if options.quick else ACROSS:
            system = box((6 * n + 1, n + 1, n + 1), SPACING, material=material(ratio))
            x, h = system.position, n * SPACING
            first, last = x[:, 0] < x[:, 0].min() + SPACING / 2, x[:, 0] > x[:, 0].max() - SPACING / 2
            length, inertia, area = 6 * h, h**4 / 12, h**2
            # By moments, that bend the middle away from the ends by 0.1 % of the length.
            moment = 1e-3 * length * 8 * MODULUS * inertia / length**2
            pull = np.zeros_like(x)
            pull[:, 0] = system.mass * x[:, 2]
            pull *= moment / (pull[last, 0] @ x[last, 2])
            loads = loads_of(pull, last) + loads_of(-pull, first)
            now = settled(system, options.device, 1e-6 * np.abs(pull).max(), loads).frame().position
            line = (np.abs(x[:, 1:]) < SPACING / 4).all(axis=1)
            height = now[line, 2] - x[line, 2]
            bent = abs(height[len(height) // 2] - (height[0] + height[-1]) / 2) / (1e-3 * length)
            # By a force; Cowper's coefficient of shear for a rectangle.
            shear = 10 * (1 + ratio) / (12 + 11 * ratio)
            theory = length**3 / (3 * MODULUS * inertia) + length * 2 * (1 + ratio) / (shear * MODULUS * area)
            force = 1e-3 * length / theory
            loads = spread((0, 0, -force), system, last)
            now = settled(system.pin(first), options.device, 1e-6 * force, loads).frame().position
            sag = float(np.average((x - now)[last, 2], weights=system.mass[last])) / (1e-3 * length)
            rows.append({"ratio": ratio, "across": n, "by_moments": bent, "by_a_force": sag})
    return rows


def finite_elements(ratio: float, cells: int) -> float:
    """Return the modulus of a bonded cube over E, by finite elements of an eighth of it, and small strain."""
    from skfem import Basis, BilinearForm, ElementHex2, ElementVector, MeshHex, condense, solve
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    line = np.linspace(0.0, 0.5, cells + 1)
    basis = Basis(MeshHex.init_tensor(line, line, line), ElementVector(ElementHex2()))
    stiffness = BilinearForm(linear_elasticity(*lame_parameters(1.0, ratio))).assemble(basis)
    plate, u = basis.get_dofs(lambda x: np.isclose(x[2], 0.5)), basis.zeros()
    held = [plate.all()]
    for k in range(3):  # planes of symmetry
        held.append(basis.get_dofs(lambda x, k=k: np.isclose(x[k], 0.0)).all(f"u^{k + 1}"))
    u[plate.all("u^3")] = -0.5
    how = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    condensed = condense(stiffness, x=u, D=np.unique(np.concatenate(held)))
    u = solve(*condensed, solver=lambda matrix, load: splu(matrix.tocsc(), **how).solve(load))
    return float(8 * u @ (stiffness @ u))


def measure_block(options: Any) -> list[dict[str, Any]]:
    """Compress cubes between plates."""
    rows = []
    for ratio in RATIOS[2:]:
        reference = finite_elements(ratio, 2 if options.quick else 8)
        for n in ACROSS[:1] if options.quick else ACROSS:
            system = box((n + 1,) * 3, SPACING, material=material(ratio))
            x, side = system.position, n * SPACING
            held = np.abs(x[:, 2]) > side / 2 - SPACING / 2
            cells = box((n + 1,) * 3, SPACING, material=material(0.45)).cells
            assert cells is not None
            row: dict[str, Any] = {"ratio": ratio, "across": n, "finite_elements": reference}
            for name, strain in (("small", 1e-4), ("large", 0.3)):
                squeezed = system.replace(position=x * (1, 1, 1 - strain)).pin(held)
                scale = MODULUS * strain * side**2
                simulation = settled(squeezed, options.device, 1e-5 * scale / n**2)
                # Twice the energy over strain²: the secant modulus by energy.
                row[f"{name}_strain"] = 2 * simulation.measure().energy / (strain**2 * side**3 * MODULUS)
            row["least_volume"] = float((cells.volumes(simulation.frame().position) / cells.rest_volume).min())
            rows.append(row)
    return rows


def draw(bar: list[dict[str, Any]]) -> None:
    """Draw the ratios and moduli of the bar."""
    plt = pyplot()
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
    for strain, color, marker in ((0.01, "#0072b2", "o"), (0.1, "#c8352b", "D")):
        rows = [row for row in bar if abs(row["strain"] / strain - 1) < 0.5 and row["across"] == ACROSS[-1]]
        asked = [row["ratio"] for row in rows]
        how = {"color": color, "marker": marker, "label": f"{strain:.0%} longer"}
        left.plot(asked, [row["measured_ratio"] for row in rows], **how)
        right.plot(asked, [row["measured_modulus"] for row in rows], **how)
    left.plot([0, 0.5], [0, 0.5], color="#999999", linewidth=1, zorder=0)
    right.axhline(1, color="#999999", linewidth=1, zorder=0)
    left.set(title="Poisson's ratio", xlabel="asked for", ylabel="measured")
    right.set(title="Young's modulus", xlabel="Poisson's ratio asked for", ylabel="measured over asked for")
    for axes in (left, right):
        axes.legend()
    save(figure, "materials.png")


def main() -> None:
    """Measure, write, print and draw."""
    options = arguments(__doc__.splitlines()[0])
    paths = {part: options.folder / f"material_{part}.csv" for part in PARTS}
    measures = {"bar": measure_bar, "bending": measure_bending, "block": measure_block, "steps": measure_steps}
    for part, path in paths.items():
        if not options.plot_only:
            write_csv(path, measures[part](options), machine(options.device))
        _, rows = read_csv(path)
        table(path.name, list(rows[0]), [list(row.values()) for row in rows])
    if not options.quick:
        draw(read_csv(paths["bar"])[1])


if __name__ == "__main__":
    main()
