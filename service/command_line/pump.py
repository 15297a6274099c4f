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


@pump_app.command(cls=Command)
def gaps(
    pump: Annotated[str, typer.Argument(help="Pump type with slipper.variable = 1: its name, or a parameter file")],
    output: Annotated[
        Path | None, typer.Option(help="File to write: .json; without it NAME.gaps.json beside the set", dir_okay=False)
    ] = None,
    picture: Annotated[Path | None, typer.Option(help="Error map to draw: .svg or .png", dir_okay=False)] = None,
    nodes: Annotated[int, typer.Option(min=60, max=4000, help="Runs of the transient pump that are fitted")] = 640,
    held_out: Annotated[int, typer.Option(min=20, max=2000, help="Runs that say the error")] = 200,
    json_: Json = False,
) -> None:
    """Fit the metamodel of a set's variable slipper gap, so that the operating point knows it; exit code 2 if it cannot be.

    Minutes; needs the extra fit. A command that reads the parameter file finds it beside the file, a service in
    slipper-maps in its data directory. With --json: {"output", "fitted_to", "errors": {answer: {"rms", "p95", "largest"}}}.
    """
    from rich.progress import Progress  # noqa: PLC0415

    from service.command_line.console import complaints  # noqa: PLC0415
    from service.pump_types.parameter_files import named_or_written  # noqa: PLC0415 - heavy, and only here
    from service.pump_types.slipper_maps import SUFFIX, beside, written_map  # noqa: PLC0415
    from service.studies.slipper_gap import error_map  # noqa: PLC0415
    from twin.metamodel import fit_map  # noqa: PLC0415

    if picture is not None and picture.suffix.lower() not in (".svg", ".png"):
        raise failure(f"--picture {picture}: ends neither in .svg nor in .png", 2)
    try:
        kind = named_or_written(pump)
        to = output or (beside(Path(pump)) if Path(pump).suffix else Path(f"{kind.name}{SUFFIX}"))
        with Progress(console=complaints(), transient=True) as bar:
            task = bar.add_task("running the transient pump", total=1.0)
            fit = fit_map(kind, nodes, held_out, progress=lambda share: bar.update(task, completed=share))
    except ImportError:
        raise failure("fitting needs scikit-learn: pip install 'casedrain[fit]'") from None
    except ValueError as error:
        raise failure(str(error), 2) from None
    try:
        to.parent.mkdir(parents=True, exist_ok=True)
        to.write_text(written_map(fit.stored), encoding="utf-8")
        if picture is not None:
            picture.parent.mkdir(parents=True, exist_ok=True)
            picture.write_bytes(error_map(kind, fit, picture.suffix.lower().removeprefix(".")))
    except OSError as error:
        raise failure(str(error)) from None
    errors = {name: dict(found) for name, found in fit.stored.errors.items()}
    leakage = errors["case_leakage_lpm"]
    say(
        f"{to}: leakage into the case within {leakage['p95']:.2g} L/min in 95 of 100 runs held out, "
        f"{leakage['largest']:.2g} at most",
        to=listener(json_),
    )
    if json_:
        say_json({"output": str(to), "fitted_to": fit.stored.fitted_to, "errors": errors})
