"""The robot of DiffTaichi as published: its file is loaded without its window, and learns by its own gradient.

The file is examples/mass_spring.py of https://github.com/taichi-dev/difftaichi (Hu et al., DiffTaichi:
Differentiable Programming for Physical Simulation, ICLR 2020). All physics and the network are its own. The loop
of its `optimize` is repeated here with arrays instead of single numbers, which makes it faster, and with biases
that begin at 0 for each seed.
"""

import importlib
import importlib.util
import math
import re
import sys
import tempfile
import time
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

STEP = 0.2
"""Length of a step against the gradient, that of the published file."""
NAMES = ("weights1", "bias1", "weights2", "bias2")
Weights = dict[str, NDArray]


def load(folder: Path, finer: int = 1) -> ModuleType:
    """Return the published file as a module with robot A, its time step divided by `finer`."""
    ti = importlib.import_module("taichi")
    ti.GUI = lambda *_, **__: None
    text = (folder / "mass_spring.py").read_text(encoding="utf-8")
    if finer > 1:
        text, count = re.subn(r"^dt = 0.004$", f"dt = 0.004 / {finer}", text, flags=re.MULTILINE)
        text, more = re.subn(r"^steps = 2048 // 3$", f"steps = 2048 // 3 * {finer}", text, flags=re.MULTILINE)
        text, room = re.subn(r"^max_steps = 4096$", f"max_steps = 4096 * {finer}", text, flags=re.MULTILINE)
        if (count, more, room) != (1, 1, 1):
            raise ValueError(f"{folder} has another mass_spring.py than expected")
    # Taichi reads the source of kernels from a file, and the module its arguments from the command line.
    copy = Path(tempfile.mkdtemp()) / "mass_spring.py"
    copy.write_text(text, encoding="utf-8")
    before = sys.argv, sys.path[:]
    sys.argv, sys.path[:0] = ["mass_spring.py", "0", "plot"], [str(folder)]
    try:
        spec = importlib.util.spec_from_file_location(f"difftaichi_{finer}", copy)
        module = importlib.util.module_from_spec(spec)  # pyright: ignore[reportArgumentType]
        spec.loader.exec_module(module)  # pyright: ignore[reportOptionalMemberAccess]
        # Lists of the configuration are global: robot A would be added once more.
        sys.modules.pop("mass_spring_robot_config", None)
        module.setup_robot(*module.robots[0]())
    finally:
        sys.argv, sys.path[:] = before
    return module


def begin(module: ModuleType, seed: int) -> None:
    """Set the weights to random ones, as `optimize` of the published file does."""
    random = np.random.default_rng(seed)
    hidden, inputs, springs = module.n_hidden, module.n_input_states(), module.n_springs
    first = random.standard_normal((hidden, inputs)) * math.sqrt(2 / (hidden + inputs)) * 2
    second = random.standard_normal((springs, hidden)) * math.sqrt(2 / (hidden + springs)) * 3
    write(module, {"weights1": first, "bias1": np.zeros(hidden), "weights2": second, "bias2": np.zeros(springs)})


def write(module: ModuleType, weights: Weights) -> None:
    """Set the weights."""
    for name, values in weights.items():
        getattr(module, name).from_numpy(values.astype(np.float32))


def read(module: ModuleType) -> Weights:
    """Return the weights."""
    return {name: getattr(module, name).to_numpy() for name in NAMES}


def distance(module: ModuleType) -> float:
    """Return how far the head goes with the present weights [m]."""
    module.clear()
    module.forward(visualize=False)
    return -module.loss[None] - module.x[0, module.head_id][0]


def learn(module: ModuleType, seed: int, toi: bool, iterations: int) -> dict[str, Any]:
    """Learn to walk from random weights; return distances [m], what gradients promised, time [s], weights."""
    ti = importlib.import_module("taichi")
    module.use_toi = toi
    begin(module, seed)
    distance(module)  # kernels are compiled
    start, found, promised = module.x[0, module.head_id][0], [], 0.0
    begun = time.perf_counter()
    for _ in range(iterations):
        module.clear()
        with ti.ad.Tape(module.loss):
            module.forward(visualize=False)
        found.append(-module.loss[None] - start)
        slope = {name: getattr(module, name).grad.to_numpy() for name in NAMES}
        size = math.sqrt(sum(float((one.astype(np.float64) ** 2).sum()) for one in slope.values()))
        promised += STEP * size
        write(module, {name: one - STEP / (size + 1e-6) * slope[name] for name, one in read(module).items()})
    seconds = time.perf_counter() - begun
    found.append(distance(module))
    return {"distances": found, "promised": promised, "seconds": seconds, "weights": read(module)}
