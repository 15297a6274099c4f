"""Registry, history in event time, findings, operators."""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

INSTANT = sa.DateTime(timezone=True)
DOCUMENT = sa.JSON().with_variant(postgresql.JSONB(), "postgresql")

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the tables; stored assessments learn where the pump sat, known aircraft are registered."""
    op.create_table(
        "aircraft",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("operator", sa.String(), nullable=False),
        sa.Column("name", sa.String(), nullable=False),
        sa.Column("created_at", INSTANT, nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_aircraft")),
        sa.UniqueConstraint("operator", "name", name=op.f("uq_aircraft_operator_name")),
    )
    op.create_table(
        "deletions",
        sa.Column("id", sa.String(), nullable=False),
        sa.Column("deleted_operator", sa.String(), nullable=False),
        sa.Column("author", sa.String(), nullable=False),
        sa.Column("reason", sa.String(), nullable=False),
        sa.Column("started_at", INSTANT, nullable=False),
        sa.Column("finished_at", INSTANT, nullable=True),
        sa.Column("pending", DOCUMENT, nullable=False),
        sa.Column("receipt", DOCUMENT, nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_deletions")),
    )
    op.create_table(
        "operator_settings",
        sa.Column("operator", sa.String(), nullable=False),
        sa.Column("retention_days", sa.Integer(), nullable=True),
        sa.Column("changed_at", INSTANT, nullable=False),
        sa.Column("author", sa.String(), nullable=False),
        sa.PrimaryKeyConstraint("operator", name=op.f("pk_operator_settings")),
    )
    op.create_table(
        "reference_curves",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("pump_type", sa.String(), nullable=False),
        sa.Column("operator", sa.String(), nullable=True),
        sa.Column("points", DOCUMENT, nullable=False),
        sa.Column("recorded_at", INSTANT, nullable=False),
        sa.Column("author", sa.String(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_reference_curves")),
    )
    with op.batch_alter_table("reference_curves", schema=None) as batch_op:
        batch_op.create_index("ix_reference_curves_pump_type_operator", ["pump_type", "operator"], unique=False)

    op.create_table(
        "registry_versions",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("operator", sa.String(), nullable=False),
        sa.Column("kind", sa.String(), nullable=False),
        sa.Column("name", sa.String(), nullable=False),
        sa.Column("values", DOCUMENT, nullable=False),
        sa.Column("recorded_at", INSTANT, nullable=False),
        sa.Column("author", sa.String(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_registry_versions")),
    )
    with op.batch_alter_table("registry_versions", schema=None) as batch_op:
        batch_op.create_index("ix_registry_versions_entity", ["operator", "kind", "name"], unique=False)

    op.create_table(
        "findings",
        sa.Column("at", INSTANT, nullable=False),
        sa.Column("found", sa.String(), nullable=False),
        sa.Column("measured_case_flow_lpm", sa.Double(), nullable=True),
        sa.Column("removed", sa.Boolean(), nullable=False),
        sa.Column("note", sa.String(), nullable=False),
        sa.Column("row_id", sa.Integer(), nullable=False),
        sa.Column("id", sa.String(), nullable=False),
        sa.Column("pump_id", sa.Integer(), nullable=False),
        sa.Column("recorded_at", INSTANT, nullable=False),
        sa.Column("withdrawn_at", INSTANT, nullable=True),
        sa.Column("author", sa.String(), nullable=False),
        sa.ForeignKeyConstraint(["pump_id"], ["pumps.id"], name=op.f("fk_findings_pump_id")),
        sa.PrimaryKeyConstraint("row_id", name=op.f("pk_findings")),
    )
    with op.batch_alter_table("findings", schema=None) as batch_op:
        batch_op.create_index(batch_op.f("ix_findings_id"), ["id"], unique=False)
        batch_op.create_index(batch_op.f("ix_findings_pump_id"), ["pump_id"], unique=False)

    op.create_table(
        "installations",
        sa.Column("aircraft", sa.String(), nullable=False),
        sa.Column("position", sa.String(), nullable=False),
        sa.Column("installed_at", INSTANT, nullable=False),
        sa.Column("removed_at", INSTANT, nullable=True),
        sa.Column("row_id", sa.Integer(), nullable=False),
        sa.Column("id", sa.String(), nullable=False),
        sa.Column("pump_id", sa.Integer(), nullable=False),
        sa.Column("recorded_at", INSTANT, nullable=False),
        sa.Column("withdrawn_at", INSTANT, nullable=True),
        sa.Column("author", sa.String(), nullable=False),
        sa.ForeignKeyConstraint(["pump_id"], ["pumps.id"], name=op.f("fk_installations_pump_id")),
        sa.PrimaryKeyConstraint("row_id", name=op.f("pk_installations")),
    )
    with op.batch_alter_table("installations", schema=None) as batch_op:
        batch_op.create_index("ix_installations_aircraft_position", ["aircraft", "position"], unique=False)
        batch_op.create_index(batch_op.f("ix_installations_id"), ["id"], unique=False)
        batch_op.create_index(batch_op.f("ix_installations_pump_id"), ["pump_id"], unique=False)

    op.create_table(
        "maintenance_events",
        sa.Column("at", INSTANT, nullable=False),
        sa.Column("action", sa.String(), nullable=False),
        sa.Column("note", sa.String(), nullable=False),
        sa.Column("row_id", sa.Integer(), nullable=False),
        sa.Column("id", sa.String(), nullable=False),
        sa.Column("pump_id", sa.Integer(), nullable=False),
        sa.Column("recorded_at", INSTANT, nullable=False),
        sa.Column("withdrawn_at", INSTANT, nullable=True),
        sa.Column("author", sa.String(), nullable=False),
        sa.ForeignKeyConstraint(["pump_id"], ["pumps.id"], name=op.f("fk_maintenance_events_pump_id")),
        sa.PrimaryKeyConstraint("row_id", name=op.f("pk_maintenance_events")),
    )
    with op.batch_alter_table("maintenance_events", schema=None) as batch_op:
        batch_op.create_index(batch_op.f("ix_maintenance_events_id"), ["id"], unique=False)
        batch_op.create_index(batch_op.f("ix_maintenance_events_pump_id"), ["pump_id"], unique=False)

    op.create_table(
        "verdict_revisions",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("pump_id", sa.Integer(), nullable=False),
        sa.Column("record_id", sa.String(), nullable=False),
        sa.Column("at", INSTANT, nullable=False),
        sa.Column("old_state", sa.String(), nullable=False),
        sa.Column("new_state", sa.String(), nullable=True),
        sa.Column("cause", sa.String(), nullable=False),
        sa.Column("cause_id", sa.String(), nullable=True),
        sa.Column("changed_at", INSTANT, nullable=False),
        sa.ForeignKeyConstraint(["pump_id"], ["pumps.id"], name=op.f("fk_verdict_revisions_pump_id")),
        sa.ForeignKeyConstraint(["record_id"], ["records.id"], name=op.f("fk_verdict_revisions_record_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_verdict_revisions")),
    )
    with op.batch_alter_table("verdict_revisions", schema=None) as batch_op:
        batch_op.create_index("ix_verdict_revisions_pump_id_changed_at", ["pump_id", "changed_at"], unique=False)

    with op.batch_alter_table("assessments", schema=None) as batch_op:
        batch_op.add_column(sa.Column("aircraft", sa.String(), nullable=False, server_default=""))
        batch_op.add_column(sa.Column("position", sa.String(), nullable=False, server_default=""))
    for name in ("aircraft", "position"):
        op.execute(
            f"UPDATE assessments SET {name} = COALESCE("  # noqa: S608 - two literal names
            f"(SELECT records.{name} FROM records WHERE records.id = assessments.record_id), '')"
        )
    with op.batch_alter_table("assessments", schema=None) as batch_op:
        batch_op.alter_column("aircraft", server_default=None)
        batch_op.alter_column("position", server_default=None)
    op.execute(
        "INSERT INTO aircraft (operator, name, created_at) "
        "SELECT operator, aircraft, MIN(received_at) FROM records WHERE aircraft IS NOT NULL GROUP BY operator, aircraft"
    )

    with op.batch_alter_table("records", schema=None) as batch_op:
        batch_op.add_column(sa.Column("pump_type", sa.String(), nullable=True))
        batch_op.add_column(sa.Column("ended_at", INSTANT, nullable=True))
        batch_op.add_column(sa.Column("withdrawal", DOCUMENT, nullable=True))
        batch_op.add_column(sa.Column("raw_removed_at", INSTANT, nullable=True))
        batch_op.add_column(sa.Column("reduced_with", sa.String(), nullable=True))
    op.execute(
        "UPDATE records SET ended_at = (SELECT MIN(later.received_at) FROM records AS later "
        "WHERE later.supersedes = records.id AND later.status IN ('analysed', 'superseded')) "
        "WHERE status = 'superseded'"
    )


def downgrade() -> None:
    """Drop what this revision added."""
    with op.batch_alter_table("records", schema=None) as batch_op:
        batch_op.drop_column("reduced_with")
        batch_op.drop_column("raw_removed_at")
        batch_op.drop_column("withdrawal")
        batch_op.drop_column("ended_at")
        batch_op.drop_column("pump_type")

    with op.batch_alter_table("assessments", schema=None) as batch_op:
        batch_op.drop_column("position")
        batch_op.drop_column("aircraft")

    with op.batch_alter_table("verdict_revisions", schema=None) as batch_op:
        batch_op.drop_index("ix_verdict_revisions_pump_id_changed_at")

    op.drop_table("verdict_revisions")
    with op.batch_alter_table("maintenance_events", schema=None) as batch_op:
        batch_op.drop_index(batch_op.f("ix_maintenance_events_pump_id"))
        batch_op.drop_index(batch_op.f("ix_maintenance_events_id"))

    op.drop_table("maintenance_events")
    with op.batch_alter_table("installations", schema=None) as batch_op:
        batch_op.drop_index(batch_op.f("ix_installations_pump_id"))
        batch_op.drop_index(batch_op.f("ix_installations_id"))
        batch_op.drop_index("ix_installations_aircraft_position")

    op.drop_table("installations")
    with op.batch_alter_table("findings", schema=None) as batch_op:
        batch_op.drop_index(batch_op.f("ix_findings_pump_id"))
        batch_op.drop_index(batch_op.f("ix_findings_id"))

    op.drop_table("findings")
    with op.batch_alter_table("registry_versions", schema=None) as batch_op:
        batch_op.drop_index("ix_registry_versions_entity")

    op.drop_table("registry_versions")
    with op.batch_alter_table("reference_curves", schema=None) as batch_op:
        batch_op.drop_index("ix_reference_curves_pump_type_operator")

    op.drop_table("reference_curves")
    op.drop_table("operator_settings")
    op.drop_table("deletions")
    op.drop_table("aircraft")
