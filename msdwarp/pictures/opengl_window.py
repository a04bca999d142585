"""The choice of VTK's window for this machine, and the import of PyVista."""

import ctypes
import functools
import importlib
import os
import sys
import warnings
from typing import Any

_OSMESA = "vtkOSOpenGLRenderWindow"
ADVICE = "install libegl1 and libgl1-mesa-dri, or libosmesa6 (Debian's names)"


def import_pyvista() -> Any:
    """Return PyVista, untyped: a type checker would take half a minute to read all of VTK."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # warnings of VTK and PyVista themselves
        return importlib.import_module("pyvista")


@functools.cache
def opengl_window() -> str | None:
    """Return VTK's window class for off-screen drawing; VTK_DEFAULT_OPENGL_WINDOW has priority.

    Return "" for VTK's own choice outside Linux, and None if Linux has no OpenGL library: VTK's own search would
    crash.
    """
    chosen = os.environ.get("VTK_DEFAULT_OPENGL_WINDOW")
    if chosen or not sys.platform.startswith("linux"):
        return chosen or ""
    if _egl_device() is not None:
        return "vtkEGLRenderWindow"
    for name in ("libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"):
        try:
            ctypes.CDLL(name)
        except OSError:
            continue
        return _OSMESA
    return None


def has_card() -> bool:
    """Return whether a graphics card draws off-screen, as far as drivers tell; a CPU would be slow."""
    return opengl_window() not in (None, _OSMESA) and "EGL_MESA_device_software" not in (_egl_device() or "")


@functools.cache
def _egl_device() -> str | None:
    """Return the extensions of the first EGL device that can be initialised; None without device or libGL."""
    try:
        egl = ctypes.CDLL("libEGL.so.1")
        ctypes.CDLL("libGL.so.1")
    except OSError:
        return None
    integer, pointer = ctypes.c_int, ctypes.c_void_p
    egl.eglGetProcAddress.restype, egl.eglGetProcAddress.argtypes = pointer, [ctypes.c_char_p]
    names = (b"eglQueryDevicesEXT", b"eglGetPlatformDisplayEXT", b"eglQueryDeviceStringEXT")
    query, display_of, text_of = map(egl.eglGetProcAddress, names)
    if not query or not display_of or not text_of:
        return None
    devices, found = (pointer * 16)(), integer(0)
    if not ctypes.CFUNCTYPE(integer, integer, pointer, pointer)(query)(16, devices, ctypes.byref(found)):
        return None
    egl.eglInitialize.argtypes, egl.eglTerminate.argtypes = [pointer] * 3, [pointer]
    for device in devices[: found.value]:
        # 0x313F is EGL_PLATFORM_DEVICE_EXT.
        display = ctypes.CFUNCTYPE(pointer, integer, pointer, pointer)(display_of)(0x313F, device, None)
        if display and egl.eglInitialize(display, None, None):
            egl.eglTerminate(display)
            text = ctypes.CFUNCTYPE(ctypes.c_char_p, pointer, integer)(text_of)(device, 0x3055)  # EGL_EXTENSIONS
            return (text or b"").decode()
    return None


def no_display() -> str | None:
    """Return why no window can be opened here, or None if one can.

    VTK ends the process if the X server does not answer, so this tries it and its OpenGL (GLX) first; systems
    other than Linux always have a display.
    """
    if not sys.platform.startswith("linux"):
        return None
    name = os.environ.get("DISPLAY")
    if not name:
        return "there is no display to open a window on: DISPLAY is not set"
    try:
        x11, gl = ctypes.CDLL("libX11.so.6"), ctypes.CDLL("libGL.so.1")
    except OSError as error:
        return f"no window can be opened: {error}; install libgl1 and libx11-6 (Debian's names)"
    pointer = ctypes.c_void_p
    x11.XOpenDisplay.restype, x11.XOpenDisplay.argtypes = pointer, [ctypes.c_char_p]
    x11.XCloseDisplay.argtypes = [pointer]
    gl.glXQueryExtension.argtypes = [pointer, pointer, pointer]
    display = x11.XOpenDisplay(None)
    if not display:
        return f"the display {name} cannot be opened"
    try:
        error, event = ctypes.c_int(), ctypes.c_int()
        if not gl.glXQueryExtension(display, ctypes.byref(error), ctypes.byref(event)):
            return f"the display {name} has no OpenGL (GLX)"
    finally:
        x11.XCloseDisplay(display)
    return None
