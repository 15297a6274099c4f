"""Changes of what the service decides: layers of thresholds, access and tenancy, alarms, pages."""

from benchmarks.mutants.catalogue import Mutant

_LAYERS, _TIES = ("tests.service.test_thresholds",), ("tests.service.test_ties",)
_LIFE, _LEDGER = ("tests.service.test_alarm_life_cycle",), ("tests.service.test_alarms",)
_TENANCY, _SIGN_IN, _PLACES = (
    ("tests.service.test_tenancy",),
    ("tests.service.test_sign_in",),
    ("tests.service.test_registry_placement",),
)
_UNITS, _LANGUAGE = ("tests.service.test_units",), ("tests.service.test_mapping_language",)
_READER = ("tests.service.test_reader_units",)
_SENTENCES = ("tests.service.test_reader_sentences",)
_PAGES, _FORMS, _FLEET_PAGE, _CHANNELS = (
    ("tests.service.test_pages",),
    ("tests.service.test_alarm_pages",),
    ("tests.service.test_fleet_page",),
    ("tests.service.test_record_pages",),
)
_CHAIN, _BACKUP = ("tests.service.test_audit_chain",), ("tests.service.test_backup",)
_SHARES, _WORDS = ("tests.service.test_fair_shares",), ("tests.service.test_words_of_files",)
_SCOPES, _OIDC, _RETENTION = (
    ("tests.service.test_scopes",),
    ("tests.service.test_oidc",),
    ("tests.service.test_retention",),
)
_LIFE_CYCLE, _LAYERS_OF = "service.alarms.life_cycle", "service.thresholds.layers"


def _layers(fragment: str, replacement: str, select: str = "TestOrder and sqlite") -> Mutant:
    return Mutant("layers", _LAYERS_OF, fragment, replacement, _LAYERS, select)


def _access(module: str, fragment: str, replacement: str, tests: tuple[str, ...], select: str = "sqlite") -> Mutant:
    return Mutant("access", module, fragment, replacement, tests, select)


def _own(module: str, owner: str, asker: str = "principal") -> Mutant:
    """A query that is not confined to the asker's operator any more."""
    confined = f".where({owner}.operator == {asker}.operator)"
    return Mutant("tenancy", module, confined, "", _TENANCY, "nothing_of and sqlite")


def _sentence(fragment: str, replacement: str) -> Mutant:
    return Mutant("pages", "service.reports.sentences", fragment, replacement, _SENTENCES)


def _life(fragment: str, replacement: str) -> Mutant:
    return Mutant("alarms", _LIFE_CYCLE, fragment, replacement, _LIFE)


def _ledger(fragment: str, replacement: str) -> Mutant:
    return Mutant("alarms", "service.alarms.ledger", fragment, replacement, _LEDGER, "sqlite")


def _mapping(module: str, fragment: str, replacement: str, tests: tuple[str, ...] = _LANGUAGE) -> Mutant:
    return Mutant("mappings", f"service.ingest.{module}", fragment, replacement, tests)


def _chain(module: str, fragment: str, replacement: str, select: str = "sqlite") -> Mutant:
    return Mutant("evidence", module, fragment, replacement, _CHAIN, select)


def _backup(module: str, fragment: str, replacement: str) -> Mutant:
    return Mutant("evidence", f"service.keeping.{module}", fragment, replacement, _BACKUP, "not postgres")


MUTANTS: tuple[Mutant, ...] = (
    _mapping("unit_words", "30.0 / _PI:", "30.0:", _UNITS),
    _mapping("unit_words", '60.0: "Hz hertz', '9.55: "Hz hertz', _UNITS),
    _mapping("unit_words", "if compact in _MEANS_OTHERWISE:", "if compact.lower() in _MEANS_OTHERWISE:", _UNITS),
    _mapping("instants", "seconds = seconds + np.cumsum(days)", "seconds = seconds + days"),
    _mapping("instants", "late[0], full[0] = usual - full[0], usual", "late[0], full[0] = 0.0, usual"),
    _mapping("instants", "fold = 1 if local < before - 1800.0 else fold", "fold = 0"),
    _mapping("mapped", "near = age <= rule.between_s", "near = age >= 0.0"),
    _mapping("mapped", "time[known] + delay_s", "time[known] - delay_s"),
    _mapping("mapped_time", "found[i].seconds - first", "found[i].seconds - np.nanmin(found[i].seconds)"),
    _mapping("file_names", "return {**(found or {}), **given}", "return {**given, **(found or {})}"),
    _mapping(
        "file_units", "if not np.isclose(found.slope, 1.0, rtol=1e-6)", "if not np.isclose(found.slope, 1.0, rtol=1e6)"
    ),
    _layers(
        'Scope("pump-type", pump_type),\n        Scope("operator", operator),',
        'Scope("operator", operator),\n        Scope("pump-type", pump_type),',
    ),
    _layers("numbers.where(table.number <= up_to)", "numbers.where(table.number < up_to)"),
    _layers("version = max(version, number)", "version = number"),
    _layers('Scope("pump", serial, operator),', 'Scope("pump", serial),'),
    _layers("number = newest_number(session) + 1", "number = (current.number if current else 0) + 1"),
    _layers(
        'accepted = {"*", tag} if current is None else {tag}', 'accepted = {"*", tag}', "of_two_changes and sqlite"
    ),
    _layers("newest = _newest(session) | {scope: values}", "newest = {scope: values}", "levels_must and sqlite"),
    _layers("Effective(effective(values, kind), ", "Effective(effective(values), ", "own_limits and sqlite"),
    Mutant(
        "layers",
        "service.history.knowledge",
        "key=lambda p: (p.outline.at, p.outline.record_id))",
        "key=lambda p: p.outline.at)",
        _TIES,
        "sqlite",
    ),
    _access(
        "service.access.security", "row.expires_at <= now", "row.expires_at >= now", _SIGN_IN, "TestKeys and sqlite"
    ),
    _access("service.access.security", ">= ROLES.index(role)", "> ROLES.index(role)", _TENANCY, "who_may and sqlite"),
    _access("service.access.security", "if row.revoked_at is not None:", "if False:", _SIGN_IN, "TestKeys and sqlite"),
    _access(
        "service.access.sessions",
        "now - row.last_used_at > timedelta(minutes",
        "now - row.last_used_at < -timedelta(minutes",
        _SIGN_IN,
    ),
    _access(
        "service.access.sessions", "if count >= _MOST_FAILURES[what]:", "if count > _MOST_FAILURES[what]:", _SIGN_IN
    ),
    _access("service.access.sessions", "user is None or user.disabled_at is not None", "user is None", _SIGN_IN),
    _access(
        "service.reading.queries",
        "if row is None or principal.operator not in (None, row.operator):",
        "if row is None:",
        _TENANCY,
        "nothing_of and sqlite",
    ),
    _access("service.history.placement", "at < self.removed_at", "at <= self.removed_at", _PLACES),
    _access(
        "service.history.placement",
        "return self.installed_at <= at and",
        "return self.installed_at < at and",
        _PLACES,
    ),
    _own("service.reading.queries", "Record"),
    _own("service.reading.queries", "Refusal"),
    _own("service.reading.queries", "Pump"),
    _own("service.reading.queries", "table"),
    _own("service.reading.agreement", "Pump"),
    _own("service.reading.exports", "Pump"),
    _own("service.registry.aircraft", "Aircraft"),
    _own("service.registry.csv_files", "Pump"),
    _own("service.alarms.reading", "Alarm"),
    _own("service.jobs.store", "Job"),
    _own("service.access.audit", "AuditEntry"),
    _own("service.registry.operators", "names.c", "asker"),
    Mutant(
        "tenancy",
        "service.registry.operators",
        'if asker.operator not in (None, operator):\n        raise Forbidden(f"the key',
        'if False:\n        raise Forbidden(f"the key',
        _TENANCY,
        "nothing_of and sqlite",
    ),
    _sentence("exact = word in _PLAIN", "exact = False"),
    _sentence("(?![\\w/^·*])", ""),
    _sentence('if text.startswith("+") and', "if False and"),
    _sentence("(_number(parts[end], unit, system, False) for", "(parts[end] for"),
    _sentence('if unit == "L/min" else ""', 'if unit == "bar" else ""'),
    _life(">= rules.on_flights", "> rules.on_flights"),
    _life("{p.flight_id for p in rising}", "{p.record_id for p in rising}"),
    _life(">= rules.off_flights", "> rules.off_flights"),
    _life(">= rules.off_flights or new:", ">= rules.off_flights:"),
    _life(' and open_.levels[-1][0].state != "insufficient_data"', ""),
    _life(" or point.case_pressure_beyond:\n                open_", ":\n                open_"),
    _life("if self.side == Side.NONE and self.case_pressure_beyond", "if self.case_pressure_beyond"),
    _life("(pressed and not known.case_pressure)", "pressed"),
    _life("rules.limit_off_lpm if before else rules.limit_lpm", "rules.limit_lpm"),
    _life("limit * (1.0 - thresholds", "limit * (1.0 + thresholds"),
    Mutant(
        "alarms",
        "detectors.words.states",
        '"Cannot tell yet", "?", 4, "medium")',
        '"Cannot tell yet", "?", 4, "high")',
        _LIFE,
    ),
    _life("unseen = (renamed and rank == known.rank) or", "unseen ="),
    _life("covers = rank >= PRIORITIES.index(life.priority)", "covers = True"),
    _life("known.rank = max(known.rank, rank)", "known.rank = -1"),
    _life("closed_at=action.done_at, acknowledged=True", "closed_at=action.done_at, acknowledged=False"),
    _life(
        "rising = [*rising, point] if point.is_faulty else []",
        "rising = [*rising, point] if point.is_faulty else rising",
    ),
    _ledger("row.withdrawn_at is None and alarm.overlaps", "alarm.overlaps"),
    _ledger("return alarm.covers(row.onset_at)", "return False"),
    _ledger('before["closed_at"] is None and after["closed_at"] is not None', "False"),
    _ledger('"active" if alarm.cleared_at is None else "cleared"', '"active"'),
    _ledger("if row.id not in held and row.withdrawn_at is None:", "if False:"),
    Mutant("pages", "service.history.overview", "(np.minimum, np.maximum)", "(np.maximum, np.maximum)", _CHANNELS),
    Mutant("pages", "service.history.overview", "None) for k in empty]", "None) for k in empty[:0]]", _CHANNELS),
    Mutant(
        "pages", "service.thresholds.layers", "if pump.id in held:", "if False:", _FLEET_PAGE, "one_by_one and sqlite"
    ),
    Mutant("pages", "service.web.dashboard.forms", "visitor.check_form(token", "str(token", _FORMS, "many and sqlite"),
    Mutant(
        "pages", "service.web.dashboard.links", 'is_ours = wanted.startswith("/")', "is_ours = True", _PAGES, "sign"
    ),
    Mutant(
        "pages",
        "service.web.dashboard.forms",
        "in_ours(values[0], name, system)",
        "values[0]",
        _READER,
        "psi and sqlite",
    ),
    Mutant(
        "pages", "service.units", "Fraction(Decimal(text)) if is_short", "Fraction(found) if is_short", _READER, "once"
    ),
    _chain("service.storage.audit_chain", "{entry_id}\\n{content_hash}", "{entry_id}"),
    _chain(
        "service.storage.audit_chain", "if isinstance(value, float) and value.is_integer():", "if False:", "postgres"
    ),
    _chain("service.access.audit_proof", "if expected is not None and expected != stored:", "if False:"),
    _chain("service.access.audit_proof", "if nearest >= 0 and position <= spans[nearest][1]:", "if True:"),
    _backup("backup", "if any(digest not in still for digest in gaps):", "if False:"),
    _backup("check", "now - written_at < IN_FLIGHT_S", "now - written_at < 1e12"),
    _backup("restore", "if used and not force:", "if False:"),
    Mutant("shares", "service.access.turns", "if self._free == 1 and self._places > 1:", "if False:", _SHARES, "Turns"),
    Mutant(
        "shares", "service.access.turns", "key=lambda t: (t.held, t.used(now))", "key=lambda t: 0", _SHARES, "Turns"
    ),
    Mutant("shares", "service.access.quotas", "if account.operator is None else", "if True else", _SHARES, "Quotas"),
    Mutant("shares", "service.ingest.bounds", "if size > limits.metadata_bytes:", "if False:", _WORDS, "format"),
    _access("service.access.scopes", "if room in _ADMINISTRATION:", "if False:", _SCOPES, "one_scope"),
    _access("service.access.scopes", "if held is None:", "if True:", _SCOPES, "gives_away and sqlite"),
    _access("service.access.pending", "session.delete(row)", "str(row)", _OIDC, "counts_once and sqlite"),
    _access("service.access.oidc", '{"nonce": nonce, "client_id"', '{"client_id"', _OIDC, "somebody_else and sqlite"),
    _access(
        "service.registry.retention", "OperatorSettings.legal_hold.is_(False)", "True", _RETENTION, "hold and sqlite"
    ),
)
