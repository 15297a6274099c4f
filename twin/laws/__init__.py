"""Physical laws as compiled functions of plain floats in SI units, one idea per file.

Sign convention: the flow of a passage is positive from port 0 to port 1. Equation and table numbers are
those of Mkadara 2020; where a printed equation is wrong the docstring says what was mended.
"""
