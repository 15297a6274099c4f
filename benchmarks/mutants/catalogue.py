"""The changes: in which module, what stands there once, what is put in its place, and which tests own the line."""

import importlib.util
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True, slots=True)
class Mutant:
    """One change of one line.

    ``module`` and ``tests`` are dotted names, so that a moved file is found or missed loudly; ``select`` is pytest's
    ``-k``. ``plain`` runs kernels uncompiled: the changed one would have to be compiled first.
    """

    area: str
    module: str
    fragment: str
    replacement: str
    tests: tuple[str, ...]
    select: str = ""
    plain: bool = False

    @property
    def name(self) -> str:
        """What it is known by in the results."""
        return f"{self.module}: {self.fragment} -> {self.replacement}"


def file_of(module: str) -> Path:
    """File of a module, relative to the root of the repository.

    Raises
    ------
    LookupError
        when there is no such module in this tree.
    """
    try:
        spec = importlib.util.find_spec(module)
    except ModuleNotFoundError:
        spec = None
    if spec is None or spec.origin is None or not Path(spec.origin).resolve().is_relative_to(ROOT):
        raise LookupError(f"{module}: no such module in {ROOT.name}")
    return Path(spec.origin).resolve().relative_to(ROOT)


def faults(mutants: tuple[Mutant, ...]) -> list[str]:
    """Every mutant whose module or tests are missing, or whose fragment does not stand exactly once in its module."""
    return [fault for mutant in mutants for fault in _faults(mutant)]


def _faults(mutant: Mutant) -> Iterator[str]:
    for module in (mutant.module, *mutant.tests):
        try:
            file = file_of(module)
        except LookupError as error:
            yield str(error)
            continue
        count = (ROOT / file).read_text(encoding="utf-8").count(mutant.fragment)
        if module == mutant.module and count != 1:
            yield f"{module}: {mutant.fragment!r} stands there {count} times, not once"
