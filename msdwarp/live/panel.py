"""Panel: the buttons, sliders and keys of a page, and what is written beside them."""

import numbers
import time
from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from .commands import SENDS
from .handling import ROUGH, SCALED, SIDES
from .keys import KEYS, SCENES
from .shown import COLOURS, ENERGIES
from .sources import Source

if TYPE_CHECKING:
    from .view import View

HOTKEYS = {"space": "space", "right": "arrowright", "up": "arrowup", "down": "arrowdown"}
"""What viser calls the keys that are no letters."""
LEAST, MOST = 0.1, 10.0
"""Ends of the sliders that multiply a parameter."""
MOST_FRICTION, LEAST_RESTITUTION = 2.0, 0.05
"""End of the sliders of friction; the least that bodies that touch may have, see `Contact`."""
SPEEDS = ("1/16", "1/8", "1/4", "1/2", "1", "2", "4")
"""Speeds of playing, over real time."""
PATIENCE = 1.0
"""What a person has entered stays for so long, also where the simulation has not taken it up [s]."""
CURVES = tuple((name, ENERGIES[name]) for name in ("kinetic", "elastic", "sum"))
"""The energies that are plotted, and their colours."""


class Panel:
    """What a page has beside the picture.

    Callbacks come in viser's thread, and only post what was asked for.
    """

    def __init__(self, server: Any) -> None:
        self._server, self._parts = server, list[Any]()
        self._said = ""
        self._shown: dict[int, tuple[Any, float]] = {}
        """What each widget was to show last, and when it last did [s]."""
        self._built: Source | None = None

    def open(self, view: "View") -> None:
        """Build what is the same for all scenes."""
        self._view, gui = view, self._server.gui
        self._status = gui.add_markdown("")
        play: Any = gui.add_button_group("play", ("pause / continue", "one frame", "restart"))
        asks = dict(zip(play.options, ("space", "right", "r"), strict=True))
        play.on_click(_asked(lambda: view.press(asks.get(play.value, ""))))
        self._speed = gui.add_dropdown("speed (1 is real time)", SPEEDS, initial_value="1")
        self._speed.on_update(self._if_asked(self._speed, lambda value: view.post("pace", value=_number(value))))
        self._colour = gui.add_dropdown("colours", COLOURS, initial_value=COLOURS[0])
        self._colour.on_update(self._if_asked(self._colour, lambda value: view.post("colour", value=value)))
        self._wires = gui.add_checkbox("connections", initial_value=False)
        self._wires.on_update(self._if_asked(self._wires, lambda value: view.press("w")))
        self._sends = gui.add_dropdown("sent as", SENDS, initial_value="auto")
        self._sends.on_update(self._if_asked(self._sends, lambda value: view.post("send", value=value)))
        self._legend = gui.add_html("", visible=False)
        self._open_keys()

    def _open_keys(self) -> None:
        """Have the page listen to keys."""
        view, gui = self._view, self._server.gui
        for name, several in KEYS.items():
            for key in several:
                hotkey = HOTKEYS.get(name, name.upper())
                command = gui.add_command(key.says, hotkey=hotkey, modifier="shift" if key.shift else None)
                command.on_trigger(_asked(lambda name=name, shift=key.shift: view.press(name, shift=shift)))
        for k, name in zip(SCENES, view.scenes, strict=False):
            command = gui.add_command(f"scene {name}", hotkey=k)
            command.on_trigger(_asked(lambda k=k: view.press(k)))

    def stage(self) -> None:
        """Build what belongs to the scene, where it is another one."""
        view, gui = self._view, self._server.gui
        if self._built is view.source:
            return
        self._built = view.source
        for part in self._parts:
            part.remove()
        self._parts, self._sliders, self._contacts, self._time = [], {}, {}, None
        if view.source.frame_count is not None:
            slider = gui.add_slider("frame", 0, max(view.source.frame_count - 1, 1), 1, 0)
            slider.on_update(self._if_asked(slider, lambda value: view.post("seek", k=value)))
            self._time = slider
            self._parts.append(slider)
        if view.source.handling is not None:
            self._stage_body()
            self._stage_scene()
            self._energies = gui.add_uplot(
                (np.zeros(2), *(np.zeros(2) for _ in CURVES)),
                ({"label": "t [s]"}, *({"label": name, "stroke": colour, "width": 2} for name, colour in CURVES)),
                title="energies [J]",
                height=180,
                scales={"x": {"time": False}},
            )
            self._parts.append(self._energies)
        else:
            self._energies = None
        if view.scenes:
            folder = gui.add_folder("scenes", expand_by_default=False)
            self._parts.append(folder)
            with folder:
                for k, name in enumerate(view.scenes, 1):
                    button = gui.add_button(f"{k}  {name}" if k < 10 else name)
                    button.on_click(_asked(lambda k=k: view.post("scene", number=k)))
        keys = gui.add_folder("keys", expand_by_default=False)
        self._parts.append(keys)
        with keys:
            gui.add_markdown("```\n" + view.keys() + "\n```")

    def _stage_body(self) -> None:
        """Build the sliders of what can be changed as it runs."""
        view, gui = self._view, self._server.gui
        handling = view.source.handling
        assert handling is not None
        folder = gui.add_folder("body")
        self._parts.append(folder)
        with folder:
            for name in SCALED:
                ends = (0.5, 2.0) if name == "rest_length" else (LEAST, MOST)
                slider = gui.add_slider(f"{name.replace('_', ' ')} ×", *ends, 0.01, 1.0)
                self._sliders[name] = slider
                slider.on_update(
                    self._if_asked(slider, lambda value, n=name: view.post("scale", name=n, factor=float(value)))
                )
            if not callable(handling.gravity):
                size = float(np.linalg.norm(handling.gravity))
                direction = handling.simulation.model.gravity
                unit = np.array(list(direction), dtype=float) / (np.linalg.norm(list(direction)) or 1.0)
                if not unit.any():
                    unit[-1] = -1.0
                gravity = gui.add_slider("gravity [m/s²]", 0.0, max(20.0, 2 * size), 0.01, size)
                gravity.on_update(
                    self._if_asked(gravity, lambda value: view.post("gravity", value=(value * unit).tolist()))
                )
            if handling.winds:
                wind = gui.add_vector3("wind [m/s]", tuple(map(float, handling.winds[0].velocity)), step=0.1)
                wind.on_update(self._if_asked(wind, lambda value: view.post("wind", velocity=list(value))))
            self._stage_contact()
            freeze = gui.add_button("freeze shape (f)")
            freeze.on_click(_asked(lambda: view.press("f")))
            pin = gui.add_button("pin pulled particles (p)")
            pin.on_click(_asked(lambda: view.press("p")))
            record = gui.add_button("record: start / stop")
            record.on_click(_asked(lambda: view.post("record")))
            film = gui.add_button("film of the last recording")
            film.on_click(_asked(lambda: view.post("film")))
            shot = gui.add_button("save picture")
            shot.on_click(_asked(lambda: view.post("screenshot")))

    def _stage_contact(self) -> None:
        """Build the sliders of friction and restitution, with obstacles and between bodies."""
        view, handling = self._view, self._view.source.handling
        assert handling is not None
        for side, name in product(SIDES, ROUGH):
            value = handling.contact(side, name)
            if value is None:
                continue
            least = LEAST_RESTITUTION if (side, name) == ("bodies", "restitution") else 0.0
            most = 1.0 if name == "restitution" else MOST_FRICTION
            slider = self._server.gui.add_slider(
                f"{name}, {side}", least, most, 0.01, min(max(value, least), most)
            )
            asked = partial(view.post, "contact", side=side, name=name)
            slider.on_update(self._if_asked(slider, lambda value, a=asked: a(value=float(value))))
            self._contacts[side, name] = slider

    def _stage_scene(self) -> None:
        """Build fields for the numbers that the scene was built with."""
        view, gui = self._view, self._server.gui
        own = view.source.parameters
        own = {n: v for n, v in own.items() if isinstance(v, numbers.Real | str) and not isinstance(v, bool)}
        if not own or not view.can_rebuild:
            return
        folder = gui.add_folder("scene", expand_by_default=False)
        self._parts.append(folder)
        with folder:
            fields = {
                name: gui.add_text(name, value) if isinstance(value, str) else gui.add_number(name, value)
                for name, value in own.items()
            }
            build = gui.add_button("rebuild")
            build.on_click(
                _asked(lambda: view.post("parameters", **{name: field.value for name, field in fields.items()}))
            )

    def tell(self) -> None:
        """Show what is written, and where sliders stand."""
        view, source = self._view, self._view.source
        text = "\n\n".join([f"**{source.title or 'msdwarp'}**", *view.lines])
        if text != self._status.content:
            self._status.content = text
        notice = view.notice
        if notice and notice != self._said:
            for client in self._server.get_clients().values():
                client.add_notification(notice, "", auto_close_seconds=1.5 + len(notice) / 20)
        self._said = notice
        if source.handling is not None:
            for name, factor in source.handling.factors.items():
                self._set(self._sliders[name], min(max(factor, self._sliders[name].min), self._sliders[name].max))
            for (side, name), slider in self._contacts.items():
                value = source.handling.contact(side, name)
                if value is not None:
                    self._set(slider, min(max(value, slider.min), slider.max))
        if self._time is not None:
            self._set(self._time, source.index)
        self._set(self._colour, view.shown.colour)
        self._set(self._wires, view.shown.wires)
        self._set(self._sends, view.sends)
        self._tell_scale()
        if self._energies is not None and len(view.readings) > 1:
            rows = np.array(
                [(r.time, r.kinetic, r.elastic, r.kinetic + r.elastic + r.potential) for r in view.readings]
            )
            self._energies.data = tuple(np.ascontiguousarray(column) for column in rows.T)

    def _tell_scale(self) -> None:
        """Show what colours tell."""
        drawing = self._view.shown.drawing
        self._legend.visible = drawing.scale is not None
        if drawing.scale is not None:
            colours = ", ".join(f"rgb({', '.join(str(round(255 * c)) for c in stop)})" for stop in drawing.stops)
            self._legend.content = (
                f'<div style="padding:0 1em;font-size:0.8em">{drawing.scale.label}'
                f'<div style="height:0.8em;background:linear-gradient(to right,{colours})"></div>'
                f'<div style="display:flex;justify-content:space-between"><span>0</span>'
                f"<span>{drawing.scale.full:.3g}</span></div></div>"
            )

    def _set(self, widget: Any, value: Any) -> None:
        """Have a widget show a value.

        What a person has just entered stays for a moment: the simulation takes it up at its next frame.
        """
        now = time.monotonic()
        told, since = self._shown.get(id(widget), (None, now))
        if widget.value != value and told == value and now - since < PATIENCE:
            return
        if widget.value != value:
            widget.value = value
        self._shown[id(widget)] = value, now

    @staticmethod
    def _if_asked(widget: Any, call: Any) -> Any:
        """Return a callback that is called with what a person has set, if a widget can show that."""

        async def called(event: Any) -> None:
            if event.client_id is not None and _is_shown(widget):
                call(widget.value)

        return called


def _asked(call: Any) -> Any:
    """Return a callback that calls; asynchronous, so that what is asked waits for the view in its order."""

    async def called(event: Any) -> None:
        call()

    return called


def _is_shown(widget: Any) -> bool:
    """Tell whether a widget's value, which a client has set, is one that it can show."""
    options, least, most = (getattr(widget, name, None) for name in ("options", "min", "max"))
    if options is not None:
        return widget.value in options
    return isinstance(widget.value, bool | tuple) or (least is not None and least <= widget.value <= most)


def _number(text: str) -> float:
    over, _, under = text.partition("/")
    return float(over) / float(under or 1)
