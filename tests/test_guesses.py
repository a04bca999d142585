"""Guessed names lead to those there are: by errors that tell them, with the user's own lines as traceback."""

import inspect
import pickle
import pydoc
import re
import traceback

import numpy as np
import pytest

import msdwarp as msd
from msdwarp.runtime.guesses import KEYWORDS, NAMES

BODY = msd.chain(3, 0.1)
SIMULATION = msd.Simulation(BODY, device="cpu")


@pytest.mark.parametrize(
    ("call", "told"),
    [
        (lambda: msd.box((2, 2, 2), stifness=3.0), "box() got an unexpected keyword argument 'stifness'. Did"),  # type: ignore[call-arg]
        (
            lambda: msd.box((2, 2, 2), density=1e3),
            "Did you mean material=Material(density=..., youngs_modulus=...",
        ),  # type: ignore[call-arg]
        (lambda: msd.Plane(mu=0.5), "Plane() got an unexpected keyword argument 'mu'. Did you mean friction?"),  # type: ignore[call-arg]
        (lambda: msd.Scene(BODY, fps=30.0), "Did you mean duration, while fps is an argument of Simulation"),  # type: ignore[call-arg]
        (lambda: msd.Look(colour="#d9603b"), "Did you mean color?"),  # type: ignore[call-arg]
        (lambda: msd.Look(lens=3), "'lens'; it takes color, inside, texture, smooth"),  # type: ignore[call-arg]
        (lambda: msd.Ensemble(BODY, 2, restitution=[0, 1]), "Did you mean worlds, which may differ in stiffness,"),  # type: ignore[call-arg]
        (
            lambda: msd.Ensemble(BODY, 2, youngs_modulus=[1, 2]),
            "Did you mean worlds, whose stiffness is factors[:",
        ),  # type: ignore[call-arg]
        (lambda: msd.Material(rho=1e3, youngs_modulus=1e6), "Did you mean density?"),  # type: ignore[call-arg]
        (lambda: msd.chain(3, radius=0.1), "Did you mean area, that of the cross section?"),  # type: ignore[call-arg]
        (lambda: msd.Ensemble(BODY, 2, amplitude=[0, 1]), "Did you mean strain, a function of time, such as"),  # type: ignore[call-arg]
        (
            lambda: msd.film(SIMULATION, "a.webp", seconds=2.0),
            "keyword argument 'seconds'. Did you mean duration?",
        ),  # type: ignore[call-arg]
        (lambda: msd.Renderer(None, None, colouring=""), "Did you mean coloring?"),  # type: ignore
        (lambda: msd.Simulation(BODY, dt=0.01), "Did you mean substeps, the steps of a frame"),  # type: ignore[call-arg]
        (
            lambda: SIMULATION.step(frame=3),
            "Simulation.step() got an unexpected keyword argument 'frame'. Did you mean frames?",
        ),
        (
            lambda: BODY.replace(positions=3),
            "System.replace() got an unexpected keyword argument 'positions'. Did",
        ),
        (
            lambda: msd.Scene(system=BODY).replace(sistem=BODY),
            "Scene.replace() got an unexpected keyword argument 'sistem'. Did",
        ),
    ],
    ids=[
        "typo",
        "material",
        "class",
        "fps",
        "look",
        "listed",
        "worlds",
        "modulus",
        "density",
        "radius",
        "gait",
        "film",
        "renderer",
        "step",
        "method",
        "system",
        "scene",
    ],
)
def test_keywords_lead_to_parameters(call, told):
    with pytest.raises(TypeError, match=re.escape(told)) as error:
        call()
    if "replace" not in told:  # which raises the error itself; elsewhere only the test's own lines are shown
        assert {one.filename for one in traceback.extract_tb(error.value.__traceback__)} == {__file__}


@pytest.mark.parametrize(
    ("of", "name", "told"),
    [
        (msd, "rope", "module 'msdwarp' has no attribute 'rope'. Did you mean chain?"),
        (msd, "sphere", "Did you mean ball, which is a body, or Sphere, an obstacle?"),
        (msd, "Chain", "Did you mean chain?"),
        (msd, "combine", "Did you mean a + b, sum([a, b]), or join?"),  # though Cone is near
        (msd, "Muscle", "Did you mean Actuator?"),  # though MUSCLE, a material, is nearer
        (msd, "ColourScale", "Did you mean ColorScale?"),
        (BODY, "points", "'System' object has no attribute 'points'. Did you mean position?"),
        (BODY, "masss", "Did you mean mass?"),
        (SIMULATION, "run", "Did you mean step(frames)"),
        (SIMULATION, "probe", "Did you mean readings, of the argument probes?"),
        (SIMULATION, "tension", 'Did you mean readings, of a Probe([i, j], "tension")'),
        (msd, "egg", "Did you mean from_mesh, of pyvista.ParametricEllipsoid"),
        (msd, "to_gltf", "Did you mean msdwarp export FILE --to glb"),
        (BODY, "mask", "Did you mean group(name), or pinned, which are masks?"),  # though mass is near
        (SIMULATION, "t", "Did you mean time?"),
        (SIMULATION.frame(), "x", "Did you mean position?"),
        (msd.Ensemble(BODY, 2, device="cpu"), "film", "Did you mean simulation_of(k), which msdwarp.film,"),
        (msd, "spring_force", 'Did you mean Probe([i, j], "tension")'),
    ],
)
def test_attributes_lead_to_names(of, name, told):
    with pytest.raises(AttributeError, match=re.escape(told)) as error:
        getattr(of, name)
    shown = "".join(traceback.format_exception_only(error.value))
    assert shown.count("Did you mean") == 1  # Python, which guesses as well, leaves it at that


def test_what_guesses_lead_to_is_there():
    owners = {"msdwarp": msd, "System": BODY, "Scene": msd.Scene(system=BODY)}
    owners |= {"Frame": msd.Frame, "Ensemble": msd.Ensemble, "FitResult": msd.FitResult, "Modes": msd.Modes}
    for owner, texts in NAMES.items():
        of = owners.get(owner, SIMULATION)
        for text, guesses in texts.items():
            for name in re.findall(r"msdwarp\.(\w+)", text):
                assert hasattr(msd, name), text
            if " " not in (first := re.split(r"[(.,]| or | \[", text)[0]) and first != "msdwarp":
                assert hasattr(of, first), text
            assert not [one for one in guesses.split() if hasattr(of, one)], text  # else it is no guess
    things = [thing for name in msd.__all__ if inspect.isfunction(thing := getattr(msd, name))]
    classes = [msd.System, msd.Scene, msd.Simulation, msd.Ensemble, msd.Renderer, msd.Plane, msd.Box, msd.Look]
    classes += [msd.Material]
    things += [*classes, *(one for cls in classes for one in vars(cls).values() if inspect.isfunction(one))]
    parameters = {one for thing in things for one in inspect.signature(thing).parameters}
    assert {re.split("[=,]", text)[0] for text in KEYWORDS} <= parameters


def test_a_property_s_own_error_stays(monkeypatch):
    monkeypatch.setattr(msd.Simulation, "own", property(lambda self: self.missing), raising=False)
    with pytest.raises(AttributeError, match="'missing'"):
        SIMULATION.own  # type: ignore[attr-defined]  # noqa: B018


def test_guided_functions_are_what_they_were():
    assert msd.box is msd.shapes.box  # type: ignore[attr-defined]
    assert pickle.loads(pickle.dumps(msd.box)) is msd.box
    assert list(inspect.signature(msd.Plane).parameters)[:2] == ["normal", "offset"]
    assert pydoc.render_doc(msd.chain, renderer=pydoc.plaintext).splitlines()[2].startswith("chain(count: 'int'")


def test_errors_show_no_functions_that_pass_calls_on():
    for call in (lambda: SIMULATION.step(-1), lambda: msd.Simulation(BODY, fps=-1.0), lambda: msd.chain(-1)):
        with pytest.raises(ValueError, match="it must be") as error:
            call()
        files = [one.filename for one in traceback.extract_tb(error.value.__traceback__)]
        assert files[0] == files[1] == __file__
        assert not [one for one in files if "runtime" in one]


def test_help_of_a_load_ends_with_its_description():
    text = pydoc.render_doc(msd.Actuator, renderer=pydoc.plaintext)
    assert len(text.splitlines()) <= 40
    assert "delay: 'ArrayLike'" in text
    assert "Raises" in text


def test_systems_are_counted_summed_and_scaled():
    body = msd.box((3, 3, 3), 0.1, material=msd.JELLY).translate((0.0, 0.0, 1.0))
    assert len(body) == 27
    both = sum([body, body])
    assert isinstance(both, msd.System)
    assert len(both) == 54
    big = body.scale(2.0)
    np.testing.assert_allclose(np.ptp(big.position, axis=0), 0.4)
    np.testing.assert_allclose(big.center_of_mass, body.center_of_mass, atol=1e-15)
    np.testing.assert_allclose(big.strain, 0.0, atol=1e-15)  # it is at rest, its cells too
    assert big.cells is not None
    assert body.cells is not None
    np.testing.assert_allclose(big.cells.rest_volume, 8 * body.cells.rest_volume)
    np.testing.assert_allclose(big.cells.slopes(big.position), 0.0, atol=1e-10 * msd.JELLY.youngs_modulus)
    np.testing.assert_allclose(body.scale(0.5, about=(0, 0, 0)).center_of_mass, (0, 0, 0.5), atol=1e-15)
    assert big.mass[0] == body.mass[0]
    flat = msd.sheet((3, 3), 0.1, material=msd.JELLY, thickness=0.01).scale(3.0)
    assert flat.cells is None or np.allclose(flat.cells.rest_volume, 0.09)
    yielded = msd.chain(2, 1.0).replace(original_length=[0.9]).scale(2.0)
    assert yielded.original_length[0] == pytest.approx(1.8)
    with pytest.raises(ValueError, match="factor is 0"):
        body.scale(0.0)


def test_a_part_has_a_name():
    low = BODY.position[:, 0] < 0.05
    for which in (low, np.flatnonzero(low), slice(2), lambda x: x[:, 0] < 0.05):
        named = BODY.named("start", which)
        np.testing.assert_array_equal(named.group("start"), low)
    assert BODY.named("start", low).named("all").named("same", "start").group("same").sum() == low.sum()
    with pytest.raises(ValueError, match=r"which is .*; it must name one particle at least"):
        BODY.named("start", lambda x: x[:, 0] > 9)


def test_what_one_number_cannot_do_leads_to_what_can():
    for call in (lambda: msd.ball((0.1, 0.1, 0.2), 0.03), lambda: BODY.scale((1, 1, 1.3))):  # type: ignore[arg-type]
        with pytest.raises(ValueError, match=r"; from_mesh makes an ellipsoid, of pyvista\.ParametricEllipsoid"):
            call()
    ensemble = msd.Ensemble(BODY, 2, device="cpu")
    with pytest.raises(TypeError, match=r"the Ensemble has no items; simulation_of\(k\) is a world"):
        ensemble[1]
    with pytest.raises(ValueError, match=r"shown is an Ensemble; .* ensemble\.simulation_of\(0\)"):
        msd.film(ensemble, "a.webp")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="'youngs_modulus'; 'stiffness' is its factor"):
        msd.fit(msd.Scene(system=BODY), {"energy": ([0.1], [1.0])}, ["youngs_modulus"])


def test_a_file_leads_from_a_mesh_to_a_volume():
    with pytest.raises(
        ValueError, match=r"mesh is 'x.obj'; it must be a PyVista .*; from_volume makes a solid of a file"
    ):
        msd.from_mesh("x.obj", across=3)
