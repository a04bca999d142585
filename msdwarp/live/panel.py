"""Panel: the buttons, sliders, keys and texts of a page."""

import numbers
import time
from collections.abc import Callable
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from ..pictures import ColorScale
from .commands import SENDS, camera_flags
from .handling import ROUGH, SCALED, SIDES, Handling
from .keys import ARROWS, KEYS, SCENES
from .shown import COLORS, ENERGIES
from .sources import Source

if TYPE_CHECKING:
    from .view import View

LEAST, MOST = 0.1, 10.0
"""Ends of sliders that multiply a parameter."""
MOST_FRICTION, LEAST_RESTITUTION = 2.0, 0.05
"""Upper end of friction sliders; least restitution between bodies (see `Contact`)."""
SPEEDS = {"1/16": 1 / 16, "1/8": 1 / 8, "1/4": 1 / 4, "1/2": 1 / 2, "1": 1.0, "2": 2.0, "4": 4.0}
"""Playback speeds relative to real time."""
PATIENCE = 1.0
"""Time until an entry that the simulation has not adopted is replaced [s]."""
CURVES = ("kinetic", "elastic", "sum")
PLAY = {"pause / continue": "pause", "one frame": "step", "restart": "reset"}
BUTTONS = {
    "freeze shape (f)": "freeze",
    "pin pulled particles (p)": "pin",
    "record: start / stop": "record",
    "film of the last recording": "film",
    "save picture": "screenshot",
}
ASK = ("list of keys (h)", "camera's flags (v)")
LAYOUT = """<style>@media (max-width: 36em) {
:has(> .mantine-Notifications-root) { flex-direction: column }
.mantine-Notifications-root ~ .mantine-Paper-root { position: static !important; width: 100% !important;
  max-height: 45% !important; flex: none }
.mantine-Notifications-root ~ .mantine-Paper-root [style*="width: 20em"] { width: 100% !important }
}</style>"""
"""On a phone viser puts the panel over the picture; this style puts it below."""
STILL = """document.documentElement.addEventListener("keydown",
  event => /^(Key[WASDQE]|Arrow)/.test(event.code) && event.stopPropagation())"""
"""Keys that have commands would move viser's camera, too: it listens at the document, one level above hotkeys."""


class Control:
    """A viser widget that shows the value returned by `read`, unless the value is None."""

    def __init__(self, widget: Any, read: Callable[[], Any]) -> None:
        self._widget, self._read = widget, read
        self._value, self._since = None, 0.0

    def update(self) -> None:
        """Show the current value. A new entry stays until the simulation adopts it at its next frame."""
        value, now = self._read(), time.monotonic()
        if value is None:
            return
        if getattr(self._widget, "min", None) is not None:
            value = min(max(value, self._widget.min), self._widget.max)
        if self._widget.value != value:
            if value == self._value and now - self._since < PATIENCE:
                return
            self._widget.value = value
        self._value, self._since = value, now


class Panel:
    """The controls of a page. Callbacks run in viser's thread, and do nothing but post commands."""

    def __init__(self, server: Any) -> None:
        self._server, self._gui = server, server.gui
        self._parts: list[Any] = []
        self._controls: list[Control] = []
        self._scene: Source | None = None
        self._notice, self._lists = "", dict[int, Any]()

    def open(self, view: "View") -> None:
        """Build the controls that all scenes have."""
        self._view, gui = view, self._gui
        gui.add_html(LAYOUT)
        gui._websock_interface.queue_message(_script(STILL))
        self._status = gui.add_markdown("")
        self._legend = gui.add_html("", visible=False)
        play = gui.add_button_group("play", tuple(PLAY))
        play.on_click(_called(lambda: _can_show(play) and view.post(PLAY[play.value])))
        speed = gui.add_dropdown("speed (1 is real time)", tuple(SPEEDS), initial_value="1")
        labels = {value: label for label, value in SPEEDS.items()}
        self._control(speed, lambda: labels.get(view.speed), "pace", lambda label: {"value": SPEEDS[label]})
        colors = gui.add_dropdown("colors", COLORS, initial_value=COLORS[0])
        self._control(colors, lambda: view.shown.color, "color")
        wires = gui.add_checkbox("connections", initial_value=False)
        self._control(wires, lambda: view.shown.wires, "wires")
        sends = gui.add_dropdown("sent as", SENDS, initial_value="auto")
        self._control(sends, lambda: view.sends, "send")
        ask = gui.add_button_group("help", ASK)
        ask.on_click(lambda event: (self._list_keys if ask.value == ASK[0] else self._tell_flags)(event))
        self._fixed = len(self._controls)
        own = {"help": self._list_keys, "flags": self._tell_flags}
        for name, command, values, text, shift in KEYS:
            hotkey = f"arrow{name}" if name in ARROWS else name.upper() if len(name) == 1 else name
            key = gui.add_command(text, hotkey=hotkey, modifier="shift" if shift else None)
            key.on_trigger(own.get(command) or self._posts(command, **values))
        for k, name in zip(SCENES, view.scenes, strict=False):
            gui.add_command(f"scene {name}", hotkey=k).on_trigger(self._posts("scene", number=int(k)))

    async def _list_keys(self, event: Any) -> None:
        """Show the list of keys to a client, or close the list."""
        if (listed := self._lists.pop(event.client_id, None)) is not None:
            listed.close()
            return
        self._lists[event.client_id] = event.client.gui.add_modal("keys")
        with self._lists[event.client_id]:
            rows = (line.split("  ", 1) for line in self._view.keys().splitlines())
            event.client.gui.add_markdown(
                "| | |\n|-|-|\n" + "\n".join(f"| **{k}**&ensp; | {does} |" for k, does in rows)
            )
            event.client.gui.add_button("close (h)").on_click(self._list_keys)

    async def _tell_flags(self, event: Any) -> None:
        """Show a client the flags of its camera, and copy them to the clipboard if the browser allows it."""
        camera, shift = event.client.camera, self._view.following.shift
        eye, target = camera.position + shift, camera.look_at + shift
        flags = camera_flags(eye, target, self._view.source.scene.look.field_of_view)
        copy = f"navigator.clipboard?.writeText({flags!r}).catch(() => {{}})"
        event.client._websock_connection.queue_message(_script(copy))
        self._view.post("flags", eye=eye, target=target)

    def _posts(self, command: str, **values: Any) -> Any:
        return _called(partial(self._view.post, command, **values))

    def _control(
        self,
        widget: Any,
        read: Callable[[], Any],
        command: str,
        values: Callable[[Any], dict[str, Any]] = lambda entered: {"value": entered},
    ) -> Any:
        """Let a widget show the value returned by `read`, and post a command with entered values."""

        async def entered(event: Any) -> None:
            if event.client_id is not None and _can_show(widget):
                self._view.post(command, **values(widget.value))

        widget.on_update(entered)
        self._controls.append(Control(widget, read))
        return widget

    def _slider(self, label: str, ends: tuple[float, float], read: Callable[[], Any], *more: Any) -> None:
        """Add a slider; `more` are further arguments of `_control`."""
        first = min(max(read(), ends[0]), ends[1])
        self._control(self._gui.add_slider(label, *ends, 0.01, first), read, *more)

    def _folder(self, label: str, *, expand: bool = False) -> Any:
        """Add a folder that is removed with the scene."""
        self._parts.append(self._gui.add_folder(label, expand_by_default=expand))
        return self._parts[-1]

    def stage(self) -> None:
        """Build the controls of a scene, if the scene has changed."""
        view, gui, source = self._view, self._gui, self._view.source
        if self._scene is source:
            return
        self._scene = source
        for part in self._parts:
            part.remove()
        self._parts, self._energies = [], None
        del self._controls[self._fixed :]
        if source.frame_count is not None:
            slider = gui.add_slider("frame", 0, max(source.frame_count - 1, 1), 1, 0)
            self._parts.append(self._control(slider, lambda: source.index, "seek", lambda k: {"k": k}))
        if source.handling is not None:
            with self._folder("body", expand=True):
                self._add_body(source.handling)
            self._add_parameters(source)
            curves = [{"label": name, "stroke": ENERGIES[name], "width": 2} for name in CURVES]
            self._energies = gui.add_uplot(
                (np.zeros(2),) * (1 + len(CURVES)),
                ({"label": "t [s]"}, *curves),
                title="energies [J]",
                height=180,
                scales={"x": {"time": False}},
            )
            self._parts.append(self._energies)
        if view.scenes:
            with self._folder("scenes"):
                for k, name in enumerate(view.scenes, 1):
                    button = gui.add_button(f"{k}  {name}" if k < 10 else name)
                    button.on_click(self._posts("scene", number=k))

    def _add_body(self, handling: Handling) -> None:
        for name in SCALED:
            ends = (0.5, 2.0) if name == "rest_length" else (LEAST, MOST)
            label, read = f"{name.replace('_', ' ')} ×", lambda n=name: handling.factors[n]
            self._slider(label, ends, read, "scale", lambda factor, n=name: {"name": n, "factor": factor})
        if not callable(handling.gravity):
            down = np.array([*handling.simulation.model.gravity], dtype=float)
            size = float(np.linalg.norm(down))
            unit = down / size if size else -np.eye(len(down))[-1]
            ends, read = (0.0, max(20.0, 2 * size)), lambda: float(np.linalg.norm(handling.gravity))
            self._slider("gravity [m/s²]", ends, read, "gravity", lambda size: {"value": (size * unit).tolist()})
        if handling.wind is not None:
            wind = self._gui.add_vector3("wind [m/s]", handling.wind, step=0.1)
            self._control(wind, lambda: handling.wind, "wind", lambda velocity: {"velocity": list(velocity)})
        for side, name in product(SIDES, ROUGH):
            read = partial(handling.contact, side, name)
            if read() is not None:
                least = LEAST_RESTITUTION if (side, name) == ("bodies", "restitution") else 0.0
                ends, of = (least, 1.0 if name == "restitution" else MOST_FRICTION), {"side": side, "name": name}
                self._slider(f"{name}, {side}", ends, read, "contact", lambda value, of=of: {**of, "value": value})
        for label, command in BUTTONS.items():
            self._gui.add_button(label).on_click(self._posts(command))

    def _add_parameters(self, source: Source) -> None:
        own = {
            n: v for n, v in source.parameters.items() if isinstance(v, numbers.Real | str) and type(v) is not bool
        }
        if not own or self._view.rebuild is None:
            return
        gui, post = self._gui, self._view.post
        with self._folder("scene"):
            fields = {
                n: gui.add_text(n, v) if isinstance(v, str) else gui.add_number(n, v) for n, v in own.items()
            }
            build = gui.add_button("rebuild")
            build.on_click(_called(lambda: post("parameters", **{n: field.value for n, field in fields.items()})))

    def tell(self) -> None:
        """Update texts and controls."""
        view = self._view
        text = "\n\n".join([f"**{view.source.title or 'msdwarp'}**", f"*{view.hint}*", *view.lines])
        if text != self._status.content:
            self._status.content = text
        notice = view.notice
        if notice and notice != self._notice:
            for client in self._server.get_clients().values():
                client.add_notification(notice, "", auto_close_seconds=1.5 + len(notice) / 20)
        self._notice = notice
        for control in self._controls:
            control.update()
        drawing = self._view.shown.drawing
        self._legend.visible = drawing.scale is not None
        if drawing.scale is not None:
            colors = ", ".join(f"rgb({', '.join(str(round(255 * c)) for c in stop)})" for stop in drawing.stops)
            least, most = _ends(drawing.scale)
            self._legend.content = (
                f'<div style="padding:0 1em;font-size:0.8em">{drawing.scale.label}'
                f'<div style="height:0.8em;background:linear-gradient(to right,{colors})"></div>'
                f'<div style="display:flex;justify-content:space-between"><span>{least}</span>'
                f"<span>{most}</span></div></div>"
            )
        if self._energies is not None and len(view.readings) > 1:
            curves = ([getattr(one, name) for one in view.readings] for name in ("time", *CURVES))
            self._energies.data = tuple(np.array(curve) for curve in curves)


def _ends(scale: ColorScale) -> tuple[str, str]:
    """Return the values at both ends of a scale, with their unit; strain is in percent."""
    _, _, unit = scale.label.rstrip("]").partition(" [")
    full = f"{scale.full:.2g} {unit}" if unit else f"{100 * scale.full:.2g} %"
    return (f"−{full}", f"+{full}") if scale.signed else ("0", f"{full} or more")


def _called(call: Callable[[], Any]) -> Any:
    """Return a viser callback that calls `call`; it is asynchronous, so that requests keep their order."""

    async def called(event: Any) -> None:
        call()

    return called


def _script(source: str) -> Any:
    """Return the message that makes a page run JavaScript."""
    from viser._messages import RunJavascriptMessage

    return RunJavascriptMessage(source)


def _can_show(widget: Any) -> bool:
    """Return whether a widget can show the value that a client has entered."""
    options, least = getattr(widget, "options", None), getattr(widget, "min", None)
    if options is not None:
        return widget.value in options
    return isinstance(widget.value, bool | tuple) or (least is not None and least <= widget.value <= widget.max)
