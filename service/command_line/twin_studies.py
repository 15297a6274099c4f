"""``casedrain sensitivity`` and what else an engineer asks of the steady twin."""

from pathlib import Path
from typing import Annotated

import typer

from service.command_line.command import Command, Commands
from service.command_line.console import Json, failure, listener, say, say_json

app = typer.Typer(cls=Commands)


@app.command(cls=Command)
def sensitivity(
    output: Annotated[list[str] | None, typer.Option(help="Output, e.g. case_flow_lpm; may be repeated")] = None,
    free: Annotated[list[str] | None, typer.Option(help="Number that varies by its spread; may be repeated")] = None,
    vary: Annotated[list[str] | None, typer.Option(help="Input that varies: NAME=LOW:HIGH; may be repeated")] = None,
    pump: Annotated[str, typer.Option(help="Pump type: its name, or a file")] = "h225",
    circuit: Annotated[str, typer.Option(help="Circuit round the pump: its name, or a file")] = "shared_return",
    at: Annotated[
        list[str] | None, typer.Option(help="Condition: NAME=VALUE, e.g. discharge_flow_lpm=10; may be repeated")
    ] = None,
    method: Annotated[str, typer.Option(help="sobol or morris")] = "sobol",
    samples: Annotated[int, typer.Option(help="Base samples (Sobol: a power of two), or trajectories (Morris)")] = 256,
    json_: Annotated[
        Path | None, typer.Option("--json", help="Also write all numbers: JSON; - is standard output", dir_okay=False)
    ] = None,
) -> None:
    """Say which numbers and inputs move the twin's outputs, and how wide the outputs are; exit code 2 if wrong.

    Without --at: nominal speed and reservoir, 50 degC, zero flow.

    Numbers vary by the spread that is known of them, inputs between two values. Without --free and --vary: the pump's
    gaps, bleed, setting, droop, friction and drain. The JSON: {"method", "factors", "points", "unsolved", "outputs":
    {output: {"band": {"low", "median", "high"}, "indices": {name: [per factor]}}}}; the band holds 90 % of the runs.
    """
    from rich.table import Table  # noqa: PLC0415 - heavy, and only here

    from service.studies.sensitivity import asked  # noqa: PLC0415
    from service.studies.sensitivity import sensitivity as study  # noqa: PLC0415

    outputs = output or ["discharge_pressure_bar", "case_pressure_bar", "case_flow_lpm"]
    try:
        kind, around, condition, factors = asked(pump, circuit, free, vary or [], at or [])
        found = study(kind, around, condition, factors, outputs, method, samples)
    except ValueError as error:
        raise failure(str(error), 2) from None
    to = listener(json_ is not None and str(json_) == "-")
    for name, indices in found.indices.items():
        low, median, high = found.bands[name]
        table = Table(title=f"{name}: {median:.4g}, 90 % within {low:.4g} to {high:.4g}")
        for heading in ("factor", *indices):
            table.add_column(heading)
        order = sorted(
            range(len(found.factors)), key=lambda k: -abs(indices["ST" if method == "sobol" else "mu_star"][k])
        )
        for k in order:
            table.add_row(found.factors[k], *(f"{values[k]:.3g}" for values in indices.values()))
        to.print(table)
    say(f"{found.points} points, {found.unsolved} without a steady state", to=to)
    if json_ is not None and str(json_) == "-":
        typer.echo(found.json(), nl=False)
    elif json_ is not None:
        json_.write_text(found.json(), encoding="utf-8")


@app.command(cls=Command)
def export_fmu(
    output: Annotated[Path, typer.Argument(help="FMU to write: .fmu", dir_okay=False)],
    fmi: Annotated[str, typer.Option(help="2.0 or 3.0; both are co-simulation")] = "3.0",
    model: Annotated[
        str, typer.Option(help="operating-point, or transient: the pump at its ports")
    ] = "operating-point",
    pump: Annotated[str, typer.Option(help="Pump type: its name, or a file")] = "h225",
    circuit: Annotated[str, typer.Option(help="Circuit round the pump: its name, or a file")] = "shared_return",
    json_: Json = False,
) -> None:
    """Write an FMU that needs no Python: the operating point as a table, or the transient pump; exit code 2 if wrong.

    Operating point: inputs are speed, temperature, flow and reservoir pressure, parameters the health. Transient: ports of
    shaft, suction, discharge, case and heat; parameters are the health and every number of pump and drain (SI). Both
    have a status. With a C compiler it holds a binary of this machine beside the sources. With --json: {"output", "fmi",
    "model", "pump_type", "circuit", "platform"}; the platform is null without a compiler.
    """
    from service.pump_types.parameter_files import circuit_named_or_written, named_or_written  # noqa: PLC0415
    from service.studies.fmu.export import export_fmu as export  # noqa: PLC0415 - heavy, and only here
    from service.studies.fmu.transient import export_transient  # noqa: PLC0415

    models = {"operating-point": export, "transient": export_transient}
    if model not in models:
        raise failure(f"--model {model}: is not one of {', '.join(models)}", 2)
    if output.suffix.lower() != ".fmu":
        raise failure(f"{output}: ends not in .fmu", 2)
    try:
        kind, around = named_or_written(pump), circuit_named_or_written(circuit)
        platform = models[model](kind, around, fmi, output)
    except ValueError as error:
        raise failure(str(error), 2) from None
    except OSError as error:
        raise failure(str(error)) from None
    words = f"with a binary for {platform}" if platform else "sources alone: there is no C compiler here"
    say(f"{output}: FMI {fmi}, {model} of {kind.name} in {around.name}, {words}", to=listener(json_))
    if json_:
        document = {"output": str(output), "fmi": fmi, "model": model, "pump_type": kind.name, "circuit": around.name}
        say_json(document | {"platform": platform})


@app.command("test-programme", cls=Command)
def programme(
    test: Annotated[str, typer.Argument(help="A2 or A3 (steady, 50 and 100 degC), B2 or B3 (dynamic)")],
    output: Annotated[Path, typer.Option(help="Folder for the files", file_okay=False)] = Path(),
    pump: Annotated[str, typer.Option(help="Pump type: its name, or a file")] = "h225",
    circuit: Annotated[str, typer.Option(help="Circuit round the pump: its name, or a file")] = "shared_return",
    json_: Json = False,
) -> None:
    """Run a test of the thesis' annex A-1 by its name on the simulated pump; exit code 1 if one stops early, 2 if wrong.

    A2 and A3 write one CSV of 25 steady points, which `casedrain identify` reads; B2 and B3 eight records at 10 kHz. With
    --json: {"test", "pump_type", "circuit", "files", "points": [{"number", "point", "speed_rpm", ..., "problem"}]}; of a
    dynamic test a point has "number", "change", "duration_s" and "problem".
    """
    from rich.table import Table  # noqa: PLC0415 - heavy, and only here

    from service.pump_types.parameter_files import circuit_named_or_written, named_or_written  # noqa: PLC0415
    from service.studies.programme import run_test  # noqa: PLC0415

    try:
        kind, around = named_or_written(pump), circuit_named_or_written(circuit)
        ran = run_test(test, kind, around, output)
    except ValueError as error:
        raise failure(str(error), 2) from None
    except OSError as error:
        raise failure(str(error)) from None
    to = listener(json_)
    table = Table(title=f"{test}: {kind.name} in {around.name}")
    for heading in ran.points[0]:
        table.add_column(heading)
    for point in ran.points:
        table.add_row(*("" if v is None else f"{v:.4g}" if isinstance(v, float) else str(v) for v in point.values()))
    to.print(table)
    say("; ".join(str(path) for path in ran.files), to=to)
    if json_:
        document = {"test": test, "pump_type": kind.name, "circuit": around.name, "files": [str(f) for f in ran.files]}
        say_json(document | {"points": list(ran.points)})
    if ran.stopped:
        raise failure(f"stopped early: {'; '.join(ran.stopped)}")
