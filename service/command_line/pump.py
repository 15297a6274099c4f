"""``casedrain pump``: another pump from a base."""

from pathlib import Path
from typing import Annotated

import typer

from service.command_line.command import Command, Commands
from service.command_line.console import Json, failure, listener, say, say_json

pump_app = typer.Typer(cls=Commands, no_args_is_help=True, help="Pump types: another pump from a base.")


@pump_app.callback()
def pump() -> None:
    """Pump types: another pump from a base."""


@pump_app.command(cls=Command)
def new(
    name: Annotated[str, typer.Argument(help="Id of the new pump type")],
    flow: Annotated[float, typer.Option(help="Delivery at full tilt and nominal speed [L/min], 8 to 60")],
    pressure: Annotated[float, typer.Option(help="Regulated pressure at zero flow [bar], 103 to 210")],
    speed: Annotated[float, typer.Option(help="Nominal speed [rpm]")],
    pistons: Annotated[int, typer.Option(help="Number of pistons, 5 to 13")] = 9,
    base: Annotated[str, typer.Option("--from", help="Pump type to scale: its name, or a parameter file")] = "h225",
    output: Annotated[
        Path | None, typer.Option(help="Parameter file to write: .toml; without it NAME.toml", dir_okay=False)
    ] = None,
    json_: Json = False,
) -> None:
    """Make a commented parameter file of another pump by scaling a base; exit code 2 with every fault if it cannot be.

    With --json: {"output", "id", "zero_flow_pressure_bar", "case_flow_limit_lpm"}. Then: casedrain simulate --pump FILE,
    casedrain analyse --pump FILE, or POST /pump-types.
    """
    from service.pump_types.parameter_files import named_or_written, whole_toml  # noqa: PLC0415 - heavy, and only here
    from twin.pumps import PUMP_TYPES  # noqa: PLC0415
    from twin.pumps.scaling import RULES, Wanted, scaled  # noqa: PLC0415
    from twin.pumps.written import ParameterFaultsError  # noqa: PLC0415

    to = output or Path(f"{name}.toml")
    if name in PUMP_TYPES:
        raise failure(f"{name}: there is a pump type of that name already", 2)
    if to.suffix.lower() != ".toml":
        raise failure(f"--output {to}: ends not in .toml", 2)
    try:
        kind = scaled(named_or_written(base), name, Wanted(flow, pressure, speed, pistons))
    except ParameterFaultsError as error:
        faults = "".join(f"\n  {where}: {words}" for where, words in error.faults)
        raise failure(f"{name} has {len(error.faults)} fault(s){faults}", 2) from None
    except ValueError as error:
        raise failure(str(error), 2) from None
    remarks = (
        f"{kind.title}, {pistons} pistons.",
        "Scaled numbers say their rule in their source; replace them by the drawing's as you know them better.",
        "length is the cube root of the ratio of swept volumes; all ratios are new over base:",
        *(f"  {path}: {words}" for path, (words, _) in RULES.items()),
        "Not scaled: gaps and clearances (what machining leaves), the valve's spool, ratios, coefficients, the fluid.",
    )
    try:
        to.parent.mkdir(parents=True, exist_ok=True)
        to.write_text(whole_toml(kind, remarks), encoding="utf-8")
    except OSError as error:
        raise failure(str(error)) from None
    limit = kind.limits["case_flow_lpm"].value
    say(f"{to}: {kind.title}; case flow limit {limit:.2g} L/min", to=listener(json_))
    if json_:
        document = {"output": str(to), "id": name, "zero_flow_pressure_bar": pressure, "case_flow_limit_lpm": limit}
        say_json(document)
