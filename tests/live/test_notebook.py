"""What a notebook shows, without one: a stand-in for IPython keeps what it is given."""

import base64
import io
import sys
import types

import numpy as np
import pytest
from PIL import Image

import msdwarp as msd
from msdwarp.live import notebook


@pytest.fixture
def cell(monkeypatch):
    """Return what the output of a cell showed, one thing after another."""
    shown = []

    class Output:
        def update(self, html):
            shown.append(html)

    def display(html, display_id=False):
        shown.append(html)
        return Output()

    module = types.ModuleType("IPython.display")
    module.HTML, module.display = str, display  # pyright: ignore[reportAttributeAccessIssue]
    package = types.ModuleType("IPython")
    package.display, package.get_ipython = module, object  # pyright: ignore[reportAttributeAccessIssue]
    monkeypatch.setitem(sys.modules, "IPython", package)
    monkeypatch.setitem(sys.modules, "IPython.display", module)
    return shown


def pictures_in(html):
    return [
        Image.open(io.BytesIO(base64.b64decode(part.split('"')[0])))
        for part in html.split('src="data:image/webp;base64,')[1:]
    ]


SCENE = msd.Scene(system=msd.chain(3, 0.5, dim=3).pin(0), duration=0.1)


@pytest.mark.slow
def test_a_scene_is_simulated_and_shown_as_a_film(cell):
    msd.show(SCENE, resolution=(96, 64))
    (film,) = pictures_in(cell[-1])
    assert film.n_frames == 6  # 0.1 s at 60 frames a second
    assert film.size == (96, 64)
    assert any("<progress" in html for html in cell[:-1])


def test_a_trajectory_is_shown_as_a_film(cell, tmp_path):
    simulation = msd.Simulation.from_scene(SCENE)
    with msd.TrajectoryWriter(tmp_path / "t.vtkhdf", simulation.system, fps=simulation.fps) as writer:
        for frame in simulation.frames(0.05):
            writer.write(frame)
    msd.show(tmp_path / "t.vtkhdf", resolution=(96, 64))
    (film,) = pictures_in(cell[-1])
    assert film.n_frames == 4


@pytest.mark.slow
def test_a_simulation_is_shown_from_all_sides(cell):
    simulation = msd.Simulation.from_scene(SCENE)
    msd.show(simulation, resolution=(96, 64))
    assert simulation.time == 0  # it did not go on
    first = pictures_in(cell[-1])[0]
    assert np.asarray(first).std() > 1
    assert cell[-1].count('", "') == 11  # 12 views


def test_without_a_notebook_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "IPython", None)
    with pytest.raises(RuntimeError, match=r"pip install 'msdwarp\[notebook\]'"):
        msd.show(SCENE)


def test_what_cannot_be_shown_is_named(cell):
    with pytest.raises(ValueError, match="shown is 3"):
        msd.show(3)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="duration is 0"):
        msd.show(SCENE, duration=0)
    with pytest.raises(ValueError, match="resolution is 0"):
        msd.show(SCENE, resolution=0)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("duration", [None, 0.05])
def test_what_has_torn_in_a_simulation_is_shown_torn(cell, monkeypatch, duration):
    drawn, real = [], notebook.Renderer
    monkeypatch.setattr(notebook, "VIEWS", 1)
    monkeypatch.setattr(
        notebook, "Renderer", lambda scene, *rest, **how: drawn.append(scene) or real(scene, *rest, **how)
    )
    hung = msd.chain(3, 0.5, dim=3).rotate(np.pi / 2, (0, 1, 0)).pin(0).replace(break_force=[1e9, 1.0])
    simulation = msd.Simulation(hung, device="cpu")
    list(simulation.frames(0.1))
    msd.show(simulation, duration=duration, resolution=(96, 64))
    assert drawn[0].system.broken.tolist() == [False, True]


def test_a_script_is_told_that_show_needs_a_notebook(cell, monkeypatch):
    # Outside of one IPython prints the name of the object.
    monkeypatch.setattr(sys.modules["IPython"], "get_ipython", lambda: None)
    for shown in (SCENE, msd.Simulation.from_scene(SCENE)):
        with pytest.raises(RuntimeError, match=r"here is none; msdwarp\.view"):
            msd.show(shown, resolution=(96, 64))
    assert not cell
