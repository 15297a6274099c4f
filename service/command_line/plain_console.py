"""The console behind everything that the command line prints; loaded by what prints, and by no help."""

from rich.console import Console, ConsoleDimensions

_PIPE = ConsoleDimensions(100_000, 25)


class PlainConsole(Console):
    """Reads no markup; as wide as its lines where nobody looks on."""

    def __init__(self, *, stderr: bool = False) -> None:
        super().__init__(stderr=stderr, markup=False, highlight=False, emoji=False)

    @property
    def size(self) -> ConsoleDimensions:
        isatty = getattr(self.file, "isatty", None)
        return super().size if isatty is not None and isatty() else _PIPE

    @size.setter
    def size(self, new_size: tuple[int, int]) -> None:
        self._width, self._height = new_size
