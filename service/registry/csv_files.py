"""The registry as CSV, out and in: all faults of a file by line, and all of its lines or none."""

import csv
import io
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from pydantic import ValidationError
from sqlalchemy import select
from sqlalchemy.orm import Session

from service.access import audit
from service.access.security import Principal
from service.answers import cells
from service.answers.documents import RowValues
from service.bodies import Body
from service.errors import Fault, Invalid, Problem, Undecodable
from service.history.archive import Archive
from service.history.neighbours import look_alikes
from service.monitoring.behind import fold_behind
from service.monitoring.refold import Cause
from service.reading import queries
from service.registry import aircraft, installations, pumps
from service.registry.fields import Name
from service.registry.locks import locked_pump, locked_pumps
from service.storage.tables import Aircraft, Installation, Pump

MOST_LINES = 100_000
"""Lines of a file (our choice: more than any fleet has, less than a request can take)."""
Kind = Literal["pumps", "aircraft", "installations"]
_Outcome = Literal["created", "changed", "unchanged"]


class PumpLine(Body):
    """One pump."""

    operator: Name | None = None
    serial: Name
    pump_type: Name
    confirmed: bool = True


class AircraftLine(Body):
    """One aircraft; its sensors are not part of the file and stay as they are."""

    operator: Name | None = None
    aircraft: Name
    aircraft_type: Name | None = None
    fluid: Name | None = None
    circuit: Name
    confirmed: bool = True


class InstallationLine(installations.NewInstallation):
    """One entered installation."""

    operator: Name | None = None
    pump: Name


@dataclass(frozen=True, slots=True)
class Imported:
    """How many lines of a file were new, changed something, or said what was known."""

    created: int
    changed: int
    unchanged: int


_LINES: Mapping[Kind, type[Body]] = {"pumps": PumpLine, "aircraft": AircraftLine, "installations": InstallationLine}


def columns(kind: Kind) -> list[str]:
    """Columns of a file in order."""
    fields = _LINES[kind].model_fields
    named = [field.alias or name for name, field in fields.items()]
    own = [name for name in ("operator", "pump") if name in named]
    return own + [name for name in named if name not in own]


def exported(session: Session, principal: Principal, kind: Kind) -> Iterator[str]:
    """Lines of a registry file, header first; the caller's session must stay open."""
    rows = {"pumps": _pump_rows, "aircraft": _aircraft_rows, "installations": _installation_rows}[kind]
    yield _written([columns(kind)])
    for row in rows(session, principal):
        yield _written([["" if row[name] is None else cells.written(row[name]) for name in columns(kind)]])


def imported(session: Session, principal: Principal, kind: Kind, content: bytes, archive: Archive) -> Imported:
    """Take a registry file into the session's transaction.

    Raises
    ------
    Undecodable
        when it is not text.
    Invalid
        with every fault by line; the caller's transaction must not be committed then.
    """
    lines, faults = _parsed(kind, content)
    apply = _APPLY[kind]
    counts: dict[str, Counter[str]] = {}
    moved: set[int] = set()
    for number, line in lines:
        try:
            outcome = apply(session, principal, line, archive, moved)
            counts.setdefault(principal.operator_of(line.operator), Counter())[outcome] += 1
        except Problem as problem:
            named = problem.errors or (Fault("", problem.detail),)
            faults += [_located(number, fault.where.removeprefix("body."), fault.problem) for fault in named]
    if faults:
        raise Invalid(f"the file has {len(faults)} fault(s); nothing was changed", faults)
    fold_behind(session, locked_pumps(session, moved), archive, Cause(installations.CHANGED, "registry import"))
    for operator, count in counts.items():
        if count["created"] or count["changed"]:
            audit.note(session, principal, "registry.import", f"registry/{kind}.csv", operator, count)
    total = sum(counts.values(), Counter[str]())
    return Imported(created=total["created"], changed=total["changed"], unchanged=total["unchanged"])


def _located(number: int, where: str, problem: str) -> Fault:
    return Fault(f"line {number}.{where}" if where else f"line {number}", problem)


def _written(rows: Iterable[list[Any]]) -> str:
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    return out.getvalue()


def _parsed(kind: Kind, content: bytes) -> tuple[list[tuple[int, Any]], list[Fault]]:
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise Undecodable(f"the file is not UTF-8 text (byte {error.start}): save it as UTF-8") from None
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        header = [name.strip() for name in next(reader, [])]
        faults = _header_faults(kind, header)
        if faults:
            raise Invalid("the header is wrong; nothing was changed", faults)
        lines: list[tuple[int, Any]] = []
        for row in reader:
            number = reader.line_num
            if len(lines) >= MOST_LINES:
                raise Invalid(f"the file has more than {MOST_LINES} lines: split it")
            if not any(cell.strip() for cell in row):
                continue
            if len(row) != len(header):
                faults.append(_located(number, "", f"has {len(row)} cells, the header has {len(header)}"))
                continue
            given = {name: cells.read(cell.strip()) for name, cell in zip(header, row, strict=True) if cell.strip()}
            try:
                lines.append((number, _LINES[kind].model_validate(given)))
            except ValidationError as error:
                faults += [_located(number, ".".join(map(str, e["loc"])), e["msg"]) for e in error.errors()]
    except csv.Error as error:
        raise Undecodable(f"the file is not CSV: {error} (line {reader.line_num})") from None
    return lines, faults


def _header_faults(kind: Kind, header: list[str]) -> list[Fault]:
    known = columns(kind)
    required = {f.alias or n for n, f in _LINES[kind].model_fields.items() if f.is_required()}
    faults = [Fault("line 1", f"column {name} is missing") for name in known if name in required - set(header)]
    faults += [
        Fault("line 1", f"column {name!r} is not known; known: {', '.join(known)}")
        for name in header
        if name not in known
    ]
    return faults + [Fault("line 1", f"column {n} is there twice") for n in {h for h in header if header.count(h) > 1}]


def _apply_pump(session: Session, principal: Principal, line: PumpLine, archive: Archive, moved: set[int]) -> _Outcome:
    operator = principal.operator_of(line.operator)
    known = session.scalar(select(Pump.id).where(Pump.operator == operator, Pump.serial == line.serial))
    if known is None:
        row = pumps.create(
            session, operator, pumps.NewPump(serial=line.serial, pump_type=line.pump_type), principal.owner
        )
        moved |= {other.id for other in look_alikes(session, row)}
    else:
        row = locked_pumps(session, (known,))[0]
    if (row.pump_type, row.confirmed) == (line.pump_type, line.confirmed):
        return "created" if known is None else "unchanged"
    change = pumps.PumpChange(pump_type=line.pump_type, confirmed=line.confirmed)
    pumps.change(session, row, change, principal.owner, archive)
    return "created" if known is None else "changed"


def _apply_aircraft(
    session: Session, principal: Principal, line: AircraftLine, archive: Archive, _moved: set[int]
) -> _Outcome:
    operator = principal.operator_of(line.operator)
    query = select(Aircraft).where(Aircraft.operator == operator, Aircraft.name == line.aircraft)
    row = session.scalar(query)
    wanted = line.model_dump(exclude={"operator", "aircraft"})
    if row is None:
        aircraft.create(session, operator, aircraft.NewAircraft(aircraft=line.aircraft, **wanted), principal.owner)
        return "created"
    held: dict[str, object] = dict(aircraft.document(session, row))
    if all(held[name] == value for name, value in wanted.items()):
        return "unchanged"
    aircraft.change(session, row, aircraft.AircraftChange(**wanted), principal.owner, archive)
    return "changed"


def _apply_installation(
    session: Session, principal: Principal, line: InstallationLine, _archive: Archive, moved: set[int]
) -> _Outcome:
    pump = locked_pump(session, principal, line.pump, principal.operator_of(line.operator))
    same = select(Installation.row_id).where(
        Installation.pump_id == pump.id,
        Installation.withdrawn_at.is_(None),
        Installation.aircraft == line.aircraft,
        Installation.position == line.position,
        Installation.installed_at == line.start,
        Installation.removed_at.is_(None) if line.end is None else Installation.removed_at == line.end,
    )
    if session.scalar(same) is not None:
        return "unchanged"
    installations.entered(session, pump, line, principal.owner)
    moved.add(pump.id)
    return "created"


_APPLY: Mapping[Kind, Callable[[Session, Principal, Any, Archive, set[int]], _Outcome]] = {
    "pumps": _apply_pump,
    "aircraft": _apply_aircraft,
    "installations": _apply_installation,
}


def _pump_rows(session: Session, principal: Principal) -> Iterator[RowValues]:
    for row in session.scalars(queries.pumps(principal)):
        yield {name: getattr(row, name) for name in columns("pumps")}


def _aircraft_rows(session: Session, principal: Principal) -> Iterator[RowValues]:
    for row in session.scalars(aircraft.listed(principal)):
        yield dict(aircraft.document(session, row))


def _installation_rows(session: Session, principal: Principal) -> Iterator[RowValues]:
    query = select(Installation, Pump.operator, Pump.serial).join(Pump, Installation.pump_id == Pump.id)
    query = query.where(Installation.withdrawn_at.is_(None))
    if principal.operator is not None:
        query = query.where(Pump.operator == principal.operator)
    for row, operator, serial in session.execute(query.order_by(Pump.operator, Pump.serial, Installation.installed_at)):
        shown = installations.document(row)
        end = row.removed_at.isoformat() if row.removed_at else None
        instants = {"from": row.installed_at.isoformat(), "to": end}
        yield dict(shown) | instants | {"operator": operator, "pump": serial}
