"""How Sphinx builds the site of these pages: `sphinx-build -W docs build/docs`."""

import shutil
import sys
from pathlib import Path

from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent))

import commands
import films

import msdwarp

project = "msdwarp"
author = "The msdwarp developers"
copyright = "The msdwarp developers, Apache-2.0"
version = release = msdwarp.__version__

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon"]
source_suffix = {
    ".rst": "restructuredtext",  # first, as autosummary writes files of the first kind
    ".md": "myst-nb",
    ".ipynb": "myst-nb",
}
nb_execution_mode = "off"  # notebooks are kept with what they showed; tests/test_notebooks.py executes them
exclude_patterns = ["images", "templates", "paper.md"]  # the paper is typeset from its source, with its references
templates_path = ["templates"]
html_static_path = ["films"]
# Read as they stand, pages link to headings as GitHub names them.
myst_heading_anchors = 4

html_theme = "furo"
html_title = "msdwarp"

autosummary_generate = True
shutil.rmtree(Path(__file__).parent / "api", ignore_errors=True)  # pages of names that are no more
# Some file systems take Box.html and box.html for one.
_clash = ("box", "cone", "view")
autosummary_filename_map = {f"msdwarp.{name}": f"msdwarp.{name}-function" for name in _clash}
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # numpydoc's "Parameters" say what arguments are; signatures of unions take half a page
napoleon_numpy_docstring = True
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
default_role = "code"  # docstrings have single backticks for code


def bars(_app: Sphinx, _what: str, _name: str, _of: object, _options: object, lines: list[str]) -> None:
    """Keep the bars of |x| in docstrings, which reStructuredText would take for the name of a substitution."""
    code = False
    for k, line in enumerate(lines):
        parts = line.split("`")
        for i in range(len(parts)):
            if not code:
                parts[i] = parts[i].replace("|", r"\|")
            code ^= i < len(parts) - 1
        lines[k] = "`".join(parts)


def skip(_app: Sphinx, _what: str, _name: str, member: object, skipped: bool, _options: object) -> bool:
    """Skip fields of named tuples, which Python calls an "Alias for field number": the class describes them."""
    return skipped or str(member.__doc__).startswith("Alias for field")


def setup(app: Sphinx) -> None:
    """Let the pages of commands and of scenes end with what these say of themselves."""
    app.connect("source-read", commands.append)
    app.connect("source-read", films.append)
    app.connect("autodoc-process-docstring", bars)
    app.connect("autodoc-skip-member", skip)
