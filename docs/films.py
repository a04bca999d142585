"""The films of the gallery: each scene plays, with its command and its script, made from the scenes themselves."""

import ast
from pathlib import Path
from typing import Any

PAGE = "gallery"
HERE = Path(__file__).parent
FILMS, SCENES = HERE / "films", HERE.parent / "scenes"


def append(_: Any, page: str, source: list[str]) -> None:
    """Add the films to the page of the gallery as Sphinx reads it."""
    if page == PAGE:
        source[0] += "\n## All films\n\n" + "\n".join(_shown(film) for film in sorted(FILMS.glob("*.mp4")))


def _shown(film: Path) -> str:
    script = SCENES / f"{film.stem}.py"
    text = script.read_text(encoding="utf-8")
    what = (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]
    attributes = 'controls loop muted playsinline preload="metadata" style="width: 100%; max-width: 640px"'
    return f"""### {film.stem}

{what}

<video {attributes} src="_static/{film.name}"></video>

```sh
msdwarp run {film.stem}
```

<details><summary>scenes/{script.name}, {len(text.splitlines())} lines</summary>

```{{literalinclude}} ../scenes/{script.name}
:language: python
```

</details>
"""
