"""Indexes for lists of the newest records, of one operator or of all."""

from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Make them."""
    op.create_index("ix_records_received_at_id", "records", ["received_at", "id"])
    op.create_index("ix_records_operator_received_at_id", "records", ["operator", "received_at", "id"])


def downgrade() -> None:
    """Drop them."""
    op.drop_index("ix_records_operator_received_at_id", "records")
    op.drop_index("ix_records_received_at_id", "records")
