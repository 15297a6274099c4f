"""Studies and measurements: speed side by side, convergence, agreement of both twins; results under ``results/``."""
