"""What differs between pumps, aircraft and sensors: the components of the state, by number and by name.

A filter's state holds them in their order, with a fault's amplitude, rate and law before those that only lines of a burst or
windows under load show: histories without them leave the tail of the state alone. What only a fault moves is no part of
the state.
"""

COMPONENTS: tuple[str, ...] = (
    "ln_slipper",  # own slipper leakage over the nominal one, logarithm
    "ln_laminar",  # the same of pistons and port plate
    "throttled",  # with the law of an orifice [L/min at 175 bar]
    "bleed",  # from the control pressure [L/min]
    "system_orifice",  # leak of the circuit [L/min at 175 bar]
    "system_laminar",  # [L/min at 175 bar and 50 degC]
    "setting",  # [bar]
    "softening",  # change of the regulated difference per 30 K [bar]
    "ln_droop",
    "ln_drain",
    "drain_viscosity",  # weights of the drain's law on top of the circuit's own [-]
    "drain_flow",
    "case_warmth",  # what the twin misses of case pressure per 30 K [bar]
    "ln_viscosity",  # the fluid in this aircraft against the data sheet
    "case_offset",  # zero of the case sensor [bar]
    "reservoir",  # reservoir pressure on top of what is known of it [bar]
    "ln_ripple",  # order n of discharge pressure against the twin's, logarithm
    "ln_case_ripple",  # order n of case pressure against the twin's, logarithm
    "once",  # discharge pressure's line at once per revolution [bar]
    "case_ripple_warmth",  # how the case's ratio changes per 30 K, logarithm
    "answer",  # how much more than the twin's this pump's order n follows what leaks, as a share of its logarithm [-]
    "load_case",  # what the twin misses of both pressures in proportion to the load [bar at LOAD_LPM]
    "load_case_square",  # and to its square [bar at LOAD_LPM]
    "load_warmth",  # how the first changes per 30 K [bar at LOAD_LPM]
    "load_discharge",  # what it misses of the discharge pressure on top of that [bar at LOAD_LPM]
    "load_discharge_square",  # [bar at LOAD_LPM]
    "slipper_extra",  # leakage that came on top, with the slippers' temperature law [L/min at the reference]
    "laminar_extra",  # with the law of a laminar gap [L/min at the reference]
    "drain_extra",  # resistance that came on top of the drain's own, with its law, as a share of it [-]
    "drain_viscous",  # the same with the law of a clogged filter
    "drain_orifice",  # with the law of a narrowed fitting
    "case_span",  # share of its span that the case sensor has gained [-]
)
N_COMPONENTS = len(COMPONENTS)
(
    LN_SLIPPER,
    LN_LAMINAR,
    THROTTLED,
    BLEED,
    SYSTEM_ORIFICE,
    SYSTEM_LAMINAR,
    SETTING,
    SOFTENING,
    LN_DROOP,
    LN_DRAIN,
    DRAIN_VISCOSITY,
    DRAIN_FLOW,
    CASE_WARMTH,
    LN_VISCOSITY,
    CASE_OFFSET,
    RESERVOIR,
    LN_RIPPLE,
    LN_CASE_RIPPLE,
    ONCE,
    CASE_RIPPLE_WARMTH,
    ANSWER,
    LOAD_CASE,
    LOAD_CASE_SQUARE,
    LOAD_WARMTH,
    LOAD_DISCHARGE,
    LOAD_DISCHARGE_SQUARE,
    SLIPPER_EXTRA,
    LAMINAR_EXTRA,
    DRAIN_EXTRA,
    DRAIN_VISCOUS,
    DRAIN_ORIFICE,
    CASE_SPAN,
) = range(N_COMPONENTS)
INDEX = {name: i for i, name in enumerate(COMPONENTS)}

AMPLITUDE, RATE, LAW = range(LN_RIPPLE, LN_RIPPLE + 3)
"""Places of a fault's amplitude, of its change per record, and of how its law lies between the two that it may have."""
_OF_FAULT = LAW + 1 - AMPLITUDE
N_LIVING = SLIPPER_EXTRA
"""Components that live in a filter's state; those after them are moved by faults alone."""
N_SLOW, N_LINES, N_STATE = (k + _OF_FAULT for k in (LN_RIPPLE, LOAD_CASE, N_LIVING))
"""Size of the part of a state that means at zero flow can show, of what lines show with it, and of the whole."""
LOAD_LPM = 20.0
"""Flow of the load at which its components are counted [L/min]."""
PLACE = {name: i if i < LN_RIPPLE else i + _OF_FAULT for name, i in INDEX.items()}
"""Places of the components in a filter's state; beyond N_STATE for those that only faults move."""
PLACES = tuple(PLACE[name] for name in COMPONENTS)
"""The same by the component's number."""
N_PLACES = N_COMPONENTS + _OF_FAULT
