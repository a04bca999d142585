"""What a file or an error says is shown and not obeyed: a terminal would take some characters as its commands."""


def printable(text: str) -> str:
    """Return a text with what a terminal would not print, but obey, written out by its number."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def printable_lines(text: str) -> str:
    """Return the same of each line of a text."""
    return "\n".join(map(printable, text.split("\n")))
