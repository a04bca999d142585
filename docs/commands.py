"""The command reference, made from the commands themselves: what `--help` shows, as Markdown."""

import re
from typing import Any

from cyclopts import App

from msdwarp.cli.app import app
from msdwarp.cli.options import FitOptions, ModesOptions, Options, SweepOptions, TuneOptions, ViewOptions

PAGE = "commands"
OF_EVERY_SCENE = {
    "run": Options,
    "sweep": SweepOptions,
    "view": ViewOptions,
    "tune": TuneOptions,
    "modes": ModesOptions,
    "fit": FitOptions,
}
"""The flags of commands that take a scene; the scene's own parameters come before them."""


def append(_: Any, page: str, source: list[str]) -> None:
    """Add the reference to the page of the commands as Sphinx reads it."""
    if page == PAGE:
        source[0] += "\n" + reference()


def reference() -> str:
    """Return every command and all its flags, as Markdown with headings of the second level."""
    names = (
        "run",
        "view",
        "modes",
        "tune",
        "fit",
        "sweep",
        "render",
        "info",
        "plot",
        "export",
        "resume",
        "rerun",
        "list",
    )
    return "\n".join(_told(name) for name in names)


def _told(name: str) -> str:
    text = _markdown(app[name])
    if name in OF_EVERY_SCENE:
        # Of the flags' own text only the list is wanted.
        text += "\n**Flags**" + _markdown(_flags(OF_EVERY_SCENE[name])).partition("**Parameters**")[2]
    return re.sub(r"```console\n.*\n```", "", re.sub(r"^## .*", f"## msdwarp {name}", text, count=1), count=1)


def _markdown(command: App) -> str:
    return command.generate_docs(output_format="markdown", heading_level=2, recursive=False)


def _flags(options_type: type) -> App:
    defaults = options_type()

    def every_scene(*, options: Any = defaults) -> None:
        """Say what is common to all scenes."""

    every_scene.__annotations__ = {"options": options_type}
    command = App(name="every", version_flags=(), help_flags=())
    command.default(every_scene)
    return command
