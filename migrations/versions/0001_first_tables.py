"""First tables."""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

INSTANT = sa.DateTime(timezone=True)
DOCUMENT = sa.JSON().with_variant(postgresql.JSONB(), "postgresql")

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create every table."""
    op.create_table(
        "api_keys",
        sa.Column("id", sa.String(), nullable=False),
        sa.Column("owner", sa.String(), nullable=False),
        sa.Column("role", sa.String(), nullable=False),
        sa.Column("operator", sa.String(), nullable=True),
        sa.Column("key_hash", sa.String(), nullable=False),
        sa.Column("created_at", INSTANT, nullable=False),
        sa.Column("expires_at", INSTANT, nullable=True),
        sa.Column("last_used_at", INSTANT, nullable=True),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_api_keys")),
        sa.UniqueConstraint("key_hash", name=op.f("uq_api_keys_key_hash")),
    )
    op.create_table(
        "pumps",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("operator", sa.String(), nullable=False),
        sa.Column("serial", sa.String(), nullable=False),
        sa.Column("pump_type", sa.String(), nullable=False),
        sa.Column("confirmed", sa.Boolean(), nullable=False),
        sa.Column("created_at", INSTANT, nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_pumps")),
        sa.UniqueConstraint("operator", "serial", name=op.f("uq_pumps_operator_serial")),
    )
    op.create_table(
        "refusals",
        sa.Column("id", sa.String(), nullable=False),
        sa.Column("operator", sa.String(), nullable=False),
        sa.Column("content_hash", sa.String(), nullable=False),
        sa.Column("received_at", INSTANT, nullable=False),
        sa.Column("problem", DOCUMENT, nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_refusals")),
    )
    with op.batch_alter_table("refusals", schema=None) as batch_op:
        batch_op.create_index(batch_op.f("ix_refusals_received_at"), ["received_at"], unique=False)

    op.create_table(
        "threshold_versions",
        sa.Column("number", sa.Integer(), nullable=False),
        sa.Column("scope", sa.String(), nullable=False),
        sa.Column("scope_id", sa.String(), nullable=False),
        sa.Column("operator", sa.String(), nullable=True),
        sa.Column("values", DOCUMENT, nullable=False),
        sa.Column("author", sa.String(), nullable=False),
        sa.Column("reason", sa.String(), nullable=False),
        sa.Column("created_at", INSTANT, nullable=False),
        sa.PrimaryKeyConstraint("number", name=op.f("pk_threshold_versions")),
    )
    with op.batch_alter_table("threshold_versions", schema=None) as batch_op:
        batch_op.create_index("ix_threshold_versions_scope_scope_id", ["scope", "scope_id", "operator"], unique=False)

    op.create_table(
        "records",
        sa.Column("id", sa.String(), nullable=False),
        sa.Column("operator", sa.String(), nullable=False),
        sa.Column("pump_id", sa.Integer(), nullable=True),
        sa.Column("aircraft", sa.String(), nullable=True),
        sa.Column("position", sa.String(), nullable=True),
        sa.Column("flight_id", sa.String(), nullable=True),
        sa.Column("segment", sa.String(), nullable=False),
        sa.Column("started_at", INSTANT, nullable=True),
        sa.Column("flight_hours", sa.Double(), nullable=True),
        sa.Column("status", sa.String(), nullable=False),
        sa.Column("problem", DOCUMENT, nullable=True),
        sa.Column("request", DOCUMENT, nullable=False),
        sa.Column("attributes", DOCUMENT, nullable=False),
        sa.Column("content_hash", sa.String(), nullable=False),
        sa.Column("content_type", sa.String(), nullable=False),
        sa.Column("request_hash", sa.String(), nullable=False),
        sa.Column("identity_hash", sa.String(), nullable=True),
        sa.Column("supersedes", sa.String(), nullable=True),
        sa.Column("received_at", INSTANT, nullable=False),
        sa.Column("reduction", DOCUMENT, nullable=True),
        sa.Column("residuals", DOCUMENT, nullable=True),
        sa.ForeignKeyConstraint(["pump_id"], ["pumps.id"], name=op.f("fk_records_pump_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_records")),
        sa.UniqueConstraint("identity_hash", name=op.f("uq_records_identity_hash")),
    )
    with op.batch_alter_table("records", schema=None) as batch_op:
        batch_op.create_index("ix_records_pump_id_started_at", ["pump_id", "started_at"], unique=False)
        batch_op.create_index(batch_op.f("ix_records_request_hash"), ["request_hash"], unique=False)
        batch_op.create_index("ix_records_status", ["status"], unique=False)
        batch_op.create_index(
            "uq_records_flight",
            ["pump_id", "flight_id", "segment"],
            unique=True,
            sqlite_where=sa.text("status = 'analysed'"),
            postgresql_where=sa.text("status = 'analysed'"),
        )

    op.create_table(
        "assessments",
        sa.Column("record_id", sa.String(), nullable=False),
        sa.Column("pump_id", sa.Integer(), nullable=False),
        sa.Column("at", INSTANT, nullable=False),
        sa.Column("state", sa.String(), nullable=False),
        sa.Column("trend", DOCUMENT, nullable=False),
        sa.Column("verdict", DOCUMENT, nullable=False),
        sa.ForeignKeyConstraint(["pump_id"], ["pumps.id"], name=op.f("fk_assessments_pump_id")),
        sa.ForeignKeyConstraint(["record_id"], ["records.id"], name=op.f("fk_assessments_record_id")),
        sa.PrimaryKeyConstraint("record_id", name=op.f("pk_assessments")),
    )
    with op.batch_alter_table("assessments", schema=None) as batch_op:
        batch_op.create_index("ix_assessments_pump_id_at", ["pump_id", "at"], unique=False)


def downgrade() -> None:
    """Drop every table."""
    with op.batch_alter_table("assessments", schema=None) as batch_op:
        batch_op.drop_index("ix_assessments_pump_id_at")

    op.drop_table("assessments")
    with op.batch_alter_table("records", schema=None) as batch_op:
        batch_op.drop_index(
            "uq_records_flight",
            sqlite_where=sa.text("status = 'analysed'"),
            postgresql_where=sa.text("status = 'analysed'"),
        )
        batch_op.drop_index("ix_records_status")
        batch_op.drop_index(batch_op.f("ix_records_request_hash"))
        batch_op.drop_index("ix_records_pump_id_started_at")

    op.drop_table("records")
    with op.batch_alter_table("threshold_versions", schema=None) as batch_op:
        batch_op.drop_index("ix_threshold_versions_scope_scope_id")

    op.drop_table("threshold_versions")
    with op.batch_alter_table("refusals", schema=None) as batch_op:
        batch_op.drop_index(batch_op.f("ix_refusals_received_at"))

    op.drop_table("refusals")
    op.drop_table("pumps")
    op.drop_table("api_keys")
