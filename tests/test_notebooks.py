"""The notebooks of the docs: executed, they end without an error and find what they say."""

import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "docs" / "notebooks"


def executed(name: str, folder: Path, **shorter: str) -> list:
    """Return the outputs of all cells of a notebook, executed in a folder; `shorter` says what takes less long."""
    nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")
    pytest.importorskip("ipykernel", reason="ipykernel is not installed")
    import nbformat

    source = (FOLDER / name).read_text(encoding="utf-8")
    for long, short in shorter.items():
        assert source.count(long) == 1, long
        source = source.replace(long, short)
    notebook = nbformat.reads(source, as_version=4)
    nbclient.NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(folder)}}).execute()
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def text(outputs: list) -> str:
    """Return what was printed."""
    return "".join(output["text"] for output in outputs if output["output_type"] == "stream")


def shown(outputs: list, kind: str) -> int:
    """Return how many outputs of a kind there are, such as image/png."""
    return sum(kind in output.get("data", {}) for output in outputs)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Jupyter's own
def test_methods_are_compared(tmp_path):
    shorter = {
        "finer in (1, 2, 4, 8)": "finer in (1, 2)",
        "frames(0.5)": "frames(0.1)",
        "duration=1.0": "duration=0.2",
    }
    outputs = executed("methods.ipynb", tmp_path, **shorter)
    assert (shown(outputs, "image/png"), shown(outputs, "text/html")) == (1, 1)  # a plot, and a film alone
    assert len(re.findall(r"[\d.]+ ms +\d+ +[\d.]+ ms", text(outputs))) == 5  # and one method without a limit


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_a_stiffness_is_found_again(tmp_path):
    outputs = executed("fit.ipynb", tmp_path, **{"duration=1.0": "duration=0.2"})
    assert (shown(outputs, "image/png"), shown(outputs, "text/html")) == (1, 1)
    found = re.findall(r"constant: ([\d.]+) ± ([\d.]+)", text(outputs))
    for (value, error), true in zip(found, (520.0, 1.0), strict=True):
        # Four standard errors, which the noise, always the same, stays within.
        assert abs(float(value) - true) < 4 * float(error) < 0.2 * true


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_gradients_throw_find_and_teach(tmp_path):
    shorter = {"iterations=60": "iterations=8", "range(60)": "range(8)", "duration=2.7": "duration=0.5"}
    outputs = executed("gradients.ipynb", tmp_path, **shorter)
    assert (shown(outputs, "image/png"), shown(outputs, "text/html")) == (3, 1)
    found = text(outputs)
    (missed,) = re.findall(r"misses by (\d+) micrometres", found)
    assert int(missed) < 1000  # BFGS ends where the loss is 1e-5 of its start or less
    ((before, after),) = re.findall(r"(\d+) % off before, (\d+) % after", found)
    assert int(after) < int(before)
    ((after, before),) = re.findall(r"walks ([-\d.]+) m in 2.7 s, ([-\d.]+) m before", found)
    assert float(after) > float(before) + 0.05  # eight steps along the gradient; the robot is 0.2 m long


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_the_lesson_agrees_with_its_closed_forms(tmp_path):
    outputs = executed("oscillations.ipynb", tmp_path)
    assert shown(outputs, "image/png") == 6
    found = text(outputs)

    def numbers(pattern: str) -> list[float]:
        (match,) = re.findall(pattern, found)
        return [float(one) for one in match] if isinstance(match, tuple) else [float(match)]

    (pendulum,) = numbers(r"deviation of a pendulum: ([\d.]+) %")
    assert pendulum < 0.05  # rods stretch by m g/k = 1e-4 of their length, and more at the bottom of a swing
    damped = re.findall(r"b = [\d.]+ N s/m: deviates by at most ([-+.\de]+) µm", found)
    assert len(damped) == 3
    assert max(map(float, damped)) < 2.5  # RK4's error of phase, (ω h)⁴/120 of ω t, with 0.1 m, in 4 s undamped
    (resonance,) = numbers(r"largest deviation: ([\d.]+) mm")
    assert resonance < 0.005  # of 10 mm, of which e^(−8) = 3e-4 is left of the start after 20 s
    (beats,) = numbers(r"deviates by at most ([\d.]+) µm of 100 mm in 40 s")
    assert beats < 40  # the same error of phase is 26 µm in 40 s, and more in the faster mode
    tones = re.findall(r"tone \d: ([\d.]+) Hz, closed form ([\d.]+) Hz", found)
    assert len(tones) == 5
    for measured, exact in tones:
        assert float(measured) == pytest.approx(float(exact), abs=0.01)  # Hz; a bin of 16 s is 0.06
    measured, exact = numbers(r"gentle: ([\d.]+) s, closed form ([\d.]+) s")
    assert measured == pytest.approx(exact, rel=5e-4)
    (growth,) = numbers(r"grows by e in ([\d.]+) s")
    assert 0.3 < growth < 3  # exponential growth at the rate of the swings, whose period is 2.6 s
    (gained,) = numbers(r"changed by ([-+.\de]+) J")
    assert abs(gained) < 1e-4  # of 38 J
