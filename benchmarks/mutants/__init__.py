"""One-line changes that tests must notice: ``python -m benchmarks.mutants``, or ``make mutants``."""
