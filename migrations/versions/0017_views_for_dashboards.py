"""Views for dashboards of others over Postgres: pumps, trends, alarms; SQLite has none.

What they show is documented in docs/dashboards.md; they hold no secret and no raw bytes.
"""

from alembic import op

revision = "0017"
down_revision = "0016"
branch_labels = None
depends_on = None

_VIEWS = {
    "dashboard_pumps": """
        select p.operator, p.serial as pump, p.pump_type, a.aircraft, a.position,
               coalesce(a.state, 'insufficient_data') as state, coalesce(a.side, 'unknown') as side,
               (a.verdict ->> 'since')::timestamptz as since, (a.verdict ->> 'confidence')::double precision as confidence,
               a.verdict ->> 'advice' as advice, a.case_flow_lpm, coalesce(a.case_pressure_beyond, false) as case_pressure_beyond,
               a.at as last_record_at, l.priority as alarm_priority, l.acknowledged as alarm_acknowledged
        from pumps p
        left join lateral (
          select * from assessments where pump_id = p.id order by at desc, record_id desc limit 1) a on true
        left join lateral (
          select priority, acknowledged from alarms
          where pump_id = p.id and withdrawn_at is null and closed_at is null and (condition = 'active' or not acknowledged)
          order by raised_at desc, id desc limit 1) l on true
    """,
    "dashboard_trends": """
        select p.operator, p.serial as pump, p.pump_type, a.aircraft, a.position, a.at, t.key as metric,
               (t.value ->> 'mean')::double precision as value, (t.value ->> 'low')::double precision as low,
               (t.value ->> 'high')::double precision as high
        from assessments a join pumps p on p.id = a.pump_id cross join lateral jsonb_each(a.trend) t
        where t.value ->> 'mean' is not null
    """,
    "dashboard_alarms": """
        select a.operator, p.serial as pump, p.pump_type, a.id as alarm, a.onset_at, a.raised_at, a.cleared_at, a.closed_at,
               a.condition, a.acknowledged, a.priority, a.verdict_state as state, a.side, a.shelved_until,
               a.assignee, a.due_at, a.work_order, a.comments
        from alarms a join pumps p on p.id = a.pump_id where a.withdrawn_at is null
    """,
}


def upgrade() -> None:
    """Make the views."""
    if op.get_bind().dialect.name == "postgresql":
        for name, query in _VIEWS.items():
            op.execute(f"create view {name} as {query}")


def downgrade() -> None:
    """Drop them."""
    if op.get_bind().dialect.name == "postgresql":
        for name in _VIEWS:
            op.execute(f"drop view {name}")
