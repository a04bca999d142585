"""Classes of which users need the description alone."""


class Described(type):
    """The metaclass of classes whose `help` ends with their docstring: what else they have is for the engine."""

    def __dir__(cls) -> list[str]:
        return []
