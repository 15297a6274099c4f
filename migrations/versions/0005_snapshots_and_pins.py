"""Snapshots of the fold with the chains that they are known by, and pumps held at earlier thresholds."""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

INSTANT = sa.DateTime(timezone=True)
DOCUMENT = sa.JSON().with_variant(postgresql.JSONB(), "postgresql")

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the columns, empty until a pump is folded next, and make the tables."""
    with op.batch_alter_table("records", schema=None) as batch_op:
        batch_op.add_column(sa.Column("reduction_digest", sa.String(), nullable=True))
        batch_op.add_column(sa.Column("has_zero_flow", sa.Boolean(), nullable=True))
        batch_op.add_column(sa.Column("has_spectrum", sa.Boolean(), nullable=True))
    with op.batch_alter_table("assessments", schema=None) as batch_op:
        batch_op.add_column(sa.Column("chain", sa.String(), nullable=True))
        batch_op.add_column(sa.Column("side", sa.String(), nullable=True))
        batch_op.add_column(sa.Column("candidates", DOCUMENT, nullable=True))
        batch_op.add_column(sa.Column("case_flow_lpm", sa.Double(), nullable=True))
    op.create_table(
        "fold_snapshots",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("pump_id", sa.Integer(), nullable=False),
        sa.Column("records", sa.Integer(), nullable=False),
        sa.Column("chain", sa.String(), nullable=False),
        sa.Column("since", INSTANT, nullable=True),
        sa.Column("content", sa.LargeBinary(), nullable=False),
        sa.ForeignKeyConstraint(["pump_id"], ["pumps.id"], name=op.f("fk_fold_snapshots_pump_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_fold_snapshots")),
        sa.UniqueConstraint("pump_id", "records", name=op.f("uq_fold_snapshots_pump_id_records")),
    )
    op.create_table(
        "threshold_pins",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("pump_id", sa.Integer(), nullable=False),
        sa.Column("number", sa.Integer(), nullable=True),
        sa.Column("counter", sa.Integer(), nullable=False),
        sa.Column("author", sa.String(), nullable=False),
        sa.Column("recorded_at", INSTANT, nullable=False),
        sa.ForeignKeyConstraint(["pump_id"], ["pumps.id"], name=op.f("fk_threshold_pins_pump_id")),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_threshold_pins")),
    )
    with op.batch_alter_table("threshold_pins", schema=None) as batch_op:
        batch_op.create_index(batch_op.f("ix_threshold_pins_pump_id"), ["pump_id"], unique=False)


def downgrade() -> None:
    """Drop them."""
    op.drop_table("threshold_pins")
    op.drop_table("fold_snapshots")
    with op.batch_alter_table("assessments", schema=None) as batch_op:
        batch_op.drop_column("case_flow_lpm")
        batch_op.drop_column("candidates")
        batch_op.drop_column("side")
        batch_op.drop_column("chain")
    with op.batch_alter_table("records", schema=None) as batch_op:
        batch_op.drop_column("has_spectrum")
        batch_op.drop_column("has_zero_flow")
        batch_op.drop_column("reduction_digest")
