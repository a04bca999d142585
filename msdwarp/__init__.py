"""msdwarp: elastic bodies as particles joined by springs and dampers, on the GPU."""

import importlib as _importlib
import os as _os
import signal as _signal
import sys as _sys
import typing as _typing


def _is_the_command() -> bool:
    """Return whether msdwarp is imported to run the command: by its script, or by `python -m msdwarp`."""
    first = getattr(_sys, "argv", None) or [""]
    if first[0] == "-m":  # it is "-m" until the module to run has been found in this package
        return "msdwarp" in _sys.orig_argv
    return _os.path.splitext(_os.path.basename(first[0]))[0] == "msdwarp"


def _leave(number: int, _: object) -> None:
    _os.write(2, b"interrupted\n" if number == _signal.SIGINT else b"terminated\n")
    _os._exit(128 + number)


# No work has started: Ctrl-C and SIGTERM end the process with a one-word message. An exception would show a
# traceback, or be changed by a partly imported module. Later `msdwarp.cli.main` handles signals.
if _is_the_command():
    for _number in (_signal.SIGINT, _signal.SIGTERM):
        if _signal.getsignal(_number) in (_signal.default_int_handler, _signal.SIG_DFL):
            _signal.signal(_number, _leave)

# The links to kernels/ and scenes/ in the folder above may be text files on Windows, and an sdist has none.
if not _os.path.isdir(_os.path.join(__path__[0], "kernels")):
    __path__.append(_os.path.dirname(__path__[0]))

import ast as _ast
import inspect as _inspect

from .runtime import verbose as verbose

if _typing.TYPE_CHECKING:
    from .bodies import (
        CORK as CORK,
        COTTON as COTTON,
        FOAM as FOAM,
        JELLY as JELLY,
        MUSCLE as MUSCLE,
        RUBBER as RUBBER,
        SILICONE as SILICONE,
        STEEL_WIRE as STEEL_WIRE,
        Angles as Angles,
        Cells as Cells,
        CoulombDamper as CoulombDamper,
        Damper as Damper,
        DamperKinds as DamperKinds,
        ExponentialSpring as ExponentialSpring,
        Frame as Frame,
        LimitedSpring as LimitedSpring,
        Material as Material,
        OwnDamper as OwnDamper,
        OwnSpring as OwnSpring,
        PolynomialSpring as PolynomialSpring,
        QuadraticDamper as QuadraticDamper,
        Spring as Spring,
        SpringKinds as SpringKinds,
        Surface as Surface,
        System as System,
        TensionOnlySpring as TensionOnlySpring,
        space_filling_order as space_filling_order,
        stress as stress,
        von_mises as von_mises,
    )
    from .checks import (
        EnergyDriftWarning as EnergyDriftWarning,
        FitWarning as FitWarning,
        GradientWarning as GradientWarning,
        InvertedWarning as InvertedWarning,
        SettleWarning as SettleWarning,
        StartWarning as StartWarning,
        StepWarning as StepWarning,
        StrainWarning as StrainWarning,
        UnitWarning as UnitWarning,
    )
    from .cli import run as run
    from .engine import Measures as Measures
    from .files import Trajectory as Trajectory, TrajectoryWriter as TrajectoryWriter
    from .integrators import (
        RK4 as RK4,
        RKC2 as RKC2,
        ExplicitEuler as ExplicitEuler,
        Integrator as Integrator,
        Leapfrog as Leapfrog,
        LinearlyImplicitEuler as LinearlyImplicitEuler,
        SymplecticEuler as SymplecticEuler,
        UnstableStep as UnstableStep,
        match_stiffness as match_stiffness,
        stability_limit as stability_limit,
    )
    from .live import View as View, film as film, show as show, view as view
    from .pictures import ColorScale as ColorScale, Renderer as Renderer
    from .shapes import (
        ball as ball,
        box as box,
        chain as chain,
        cloth as cloth,
        cone as cone,
        cylinder as cylinder,
        disc as disc,
        from_mesh as from_mesh,
        from_volume as from_volume,
        icosphere as icosphere,
        join as join,
        lattice as lattice,
        rod as rod,
        sheet as sheet,
        shell as shell,
        viscoelastic as viscoelastic,
        voxel_corners as voxel_corners,
        voxels as voxels,
    )
    from .simulation import (
        Ensemble as Ensemble,
        Frames as Frames,
        Gradient as Gradient,
        GroupMean as GroupMean,
        Modes as Modes,
        Simulation as Simulation,
        SimulationDiverged as SimulationDiverged,
        modes as modes,
    )
    from .studies import (
        FieldFit as FieldFit,
        FitResult as FitResult,
        TrackedPoints as TrackedPoints,
        fit as fit,
        fit_field as fit_field,
        simulate_jax as simulate_jax,
        simulate_torch as simulate_torch,
        sweep as sweep,
    )
    from .world import (
        Actuator as Actuator,
        Attachment as Attachment,
        Box as Box,
        Capsule as Capsule,
        Collider as Collider,
        Cone as Cone,
        Contact as Contact,
        EnclosedGas as EnclosedGas,
        Force as Force,
        Load as Load,
        Look as Look,
        Plane as Plane,
        PrescribedMotion as PrescribedMotion,
        Pressure as Pressure,
        Probe as Probe,
        Scene as Scene,
        Sphere as Sphere,
        Viewpoint as Viewpoint,
        Wind as Wind,
        at as at,
    )

__version__ = "0.2.0"

_runtime: _typing.Any = _importlib.import_module(".runtime", __name__)
# The room of each name, read off the imports above. A room, with Warp if the room needs it, is imported when one
# of its names is first used.
_ROOMS = {
    str(node.module): [alias.name for alias in node.names]
    for node in _ast.walk(_ast.parse(_inspect.getsource(_sys.modules[__name__])))
    if isinstance(node, _ast.ImportFrom)
}
__all__ = [name for names in _ROOMS.values() for name in names]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    for room, names in _ROOMS.items():
        if name == room or name in names:
            module = _importlib.import_module(f".{room}", __name__)
            _guide_loaded()
            return module if name == room else globals()[name]
    raise _runtime.no_attribute(_sys.modules[__name__], name, __name__, f"module {__name__!r}")


def _guide_loaded() -> None:
    """Take the names of all rooms that are imported by now, with errors that lead to them."""
    for room, names in _ROOMS.items():
        module = _sys.modules.get(f"{__name__}.{room}")
        for one in names if module else ():
            if one not in globals() and (thing := getattr(module, one, None)) is not None:
                globals()[one] = guided = _runtime.guide(thing)
                if guided is not thing:  # a function: where `pickle` looks for it, too
                    setattr(_sys.modules[thing.__module__], one, guided)
                    setattr(module, one, guided)


def __dir__() -> list[str]:
    return sorted({*globals(), *(room for room in _ROOMS if "." not in room), *__all__})
