"""The small solver against numpy, with pivoting and several right-hand sides."""

import numpy as np
import pytest

from twin.operating_point.elimination import solve_in_place


@pytest.mark.parametrize(("n", "m"), [(1, 1), (5, 17), (6, 1)])
def test_solves_what_numpy_solves(n: int, m: int) -> None:
    rng = np.random.default_rng(n)
    A, b = rng.normal(size=(n, n)), rng.normal(size=(n, m))
    A[0, 0] = 0.0 if n > 1 else 2.0  # needs a pivot
    solution = b.copy()
    assert solve_in_place(A.copy(), solution)
    assert solution == pytest.approx(np.linalg.solve(A, b), rel=1e-9)


def test_a_singular_system_is_said() -> None:
    assert not solve_in_place(np.zeros((3, 3)), np.ones((3, 1)))
