"""Engineers mark stretches of records good or bad."""

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the table."""
    op.create_table(
        "record_marks",
        sa.Column("row_id", sa.Integer(), nullable=False),
        sa.Column("id", sa.String(), nullable=False),
        sa.Column("pump_id", sa.Integer(), nullable=False),
        sa.Column("record_id", sa.String(), nullable=False),
        sa.Column("recorded_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("withdrawn_at", sa.DateTime(timezone=True), nullable=True),
        sa.Column("author", sa.String(), nullable=False),
        sa.Column("start_s", sa.Double(), nullable=False),
        sa.Column("end_s", sa.Double(), nullable=False),
        sa.Column("mark", sa.String(), nullable=False),
        sa.Column("reason", sa.String(), nullable=False),
        sa.ForeignKeyConstraint(["pump_id"], ["pumps.id"], name=op.f("fk_record_marks_pump_id_pumps")),
        sa.ForeignKeyConstraint(["record_id"], ["records.id"], name=op.f("fk_record_marks_record_id_records")),
        sa.PrimaryKeyConstraint("row_id", name=op.f("pk_record_marks")),
    )
    for column in ("id", "pump_id", "record_id"):
        op.create_index(op.f(f"ix_record_marks_{column}"), "record_marks", [column])


def downgrade() -> None:
    """Drop it."""
    op.drop_table("record_marks")
