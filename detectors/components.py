"""What differs between pumps, aircraft and sensors: the components of the state, by number and by name."""

COMPONENTS: tuple[str, ...] = (
    "ln_slipper",  # own slipper leakage over the nominal one, logarithm
    "ln_laminar",  # the same of pistons and port plate
    "slipper_extra",  # leakage that came on top, with the slippers' temperature law [L/min at the reference]
    "laminar_extra",  # with the law of a laminar gap [L/min at the reference]
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
)
N_COMPONENTS = len(COMPONENTS)
(
    LN_SLIPPER,
    LN_LAMINAR,
    SLIPPER_EXTRA,
    LAMINAR_EXTRA,
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
) = range(N_COMPONENTS)
INDEX = {name: i for i, name in enumerate(COMPONENTS)}
