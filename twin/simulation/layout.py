"""Where each state stands: shared states first, then n chambers; with variable gaps n pockets, gaps and speeds more."""

P_D, P_C, P_I, P_CTRL, X, V_SPOOL, ALPHA, ALPHA_DOT, THETA, OMEGA, X_STROKE, V_STROKE, X_RATE, V_RATE = range(14)
N_SHARED = 14
"""Pressures of discharge, case, return junction and control volume [Pa absolute]; spool [m, m/s]; tilt [rad, rad/s];
shaft angle and speed [rad, rad/s]; stroking and rate piston towards the plate [m, m/s] (used with contact only)."""

N_VOLUMES = 4
"""The first states are the pressures of these volumes; so are the first masses of a step, chambers and pockets behind."""

SPOOL_SPEED, TILT_RATE = 4, 5
"""Unknowns of a step's shared system: P_D, P_C, P_I, P_CTRL as above, then the speeds of spool and plate."""
N_SOLVED = 6

STATE_NAMES: tuple[str, ...] = (
    "discharge pressure",
    "case pressure",
    "return pressure",
    "control pressure",
    "spool position",
    "spool speed",
    "tilt",
    "tilt rate",
    "shaft angle",
    "shaft speed",
    "stroking piston position",
    "stroking piston speed",
    "rate piston position",
    "rate piston speed",
)

(Q_LOAD, Q_DRAIN, Q_RETURN, Q_SUCTION, TORQUE, Q_SYSTEM, Q_SLIPPER) = range(7)
N_FLOWS = 7
"""What a step reports: load, drain line, return line, suction [m3/s], shaft torque with friction [N m], leak of the
circuit, all slippers into the case [m3/s]."""

TILT_MEAN = N_VOLUMES
N_STATE_MEANS = N_VOLUMES + 1
N_MEAN = N_STATE_MEANS + N_FLOWS
"""A mean: P_d, P_c, P_i, P_ctrl, tilt, then the flows."""
END, FIRST_MEAN = 0, 1
"""Columns of a row of means: when its revolution ended [s], then N_MEAN values."""

(G_D, G_S, G_L, DRAG, VOLUME, ROTATION, TILT, COS, SIN, DENSITY, CAPACITY, MASS) = range(12)
G_LAND, G_RING, SUBSTEPS, POCKET = range(12, 16)
FIRST_SCRATCH = 16
BY_D, BY_C, BY_W = 1, 2, 3
"""An affine quantity of a chamber is four columns: its constant, then its slopes by P_d', P_c' and the tilt rate."""
N_COLUMNS = FIRST_SCRATCH + 53
"""Columns of the table of chambers, shape (n, N_COLUMNS): passages at the start of a step, then the step's scratch."""


OF_PISTON, OF_SLIPPER = 0, 1
"""Columns of the clearances, shape (n, 2): factors on the gap of each piston and of each slipper."""


def n_states(n: int, variable: bool) -> int:
    """Number of states of a pump with n pistons."""
    return N_SHARED + (4 * n if variable else n)


def state_name(index: int, n: int) -> str:
    """Name of a state in words, for messages."""
    if index < N_SHARED:
        return STATE_NAMES[index]
    kind, k = divmod(index - N_SHARED, n)
    return f"{('chamber pressure', 'pocket pressure', 'slipper gap', 'piston speed')[kind]} of piston {k + 1}"
