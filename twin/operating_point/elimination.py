"""Small dense linear systems inside kernels, without allocation."""

import numpy as np
from numpy.typing import NDArray

from twin.compiled import compiled

Matrix = NDArray[np.float64]


@compiled
def solve_in_place(A: Matrix, b: Matrix) -> bool:
    """Solve A X = b by Gaussian elimination with partial pivoting; False when A is singular.

    ``A``, shape (n, n), is spent; ``b``, shape (n, m), becomes the solution.
    """
    n, m = b.shape
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[pivot, k]):
                pivot = i
        if not abs(A[pivot, k]) > 0.0:
            return False
        if pivot != k:
            for j in range(k, n):
                A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
            for j in range(m):
                b[k, j], b[pivot, j] = b[pivot, j], b[k, j]
        inverse = 1.0 / A[k, k]
        for i in range(k + 1, n):
            f = A[i, k] * inverse
            if f != 0.0:
                for j in range(k + 1, n):
                    A[i, j] -= f * A[k, j]
                for j in range(m):
                    b[i, j] -= f * b[k, j]
    for k in range(n - 1, -1, -1):
        for j in range(m):
            total = b[k, j]
            for i in range(k + 1, n):
                total -= A[k, i] * b[i, j]
            b[k, j] = total / A[k, k]
    return True
