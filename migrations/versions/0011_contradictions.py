"""What shows that records contradict one another: their last instant, a hash of their samples, remarks; looks of serials.

Rows from before stay without until their records are reduced and their pumps folded again.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

from service.storage.tables.base import UtcDateTime

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the columns and what finds them."""
    op.add_column("records", sa.Column("finished_at", UtcDateTime(timezone=True), nullable=True))
    op.add_column("records", sa.Column("samples_hash", sa.String(), nullable=True))
    json = sa.JSON().with_variant(postgresql.JSONB(astext_type=sa.Text()), "postgresql")
    op.add_column("records", sa.Column("remarks", json, nullable=True))
    op.add_column("pumps", sa.Column("look", sa.String(), nullable=True))
    op.create_index("ix_records_operator_samples_hash", "records", ["operator", "samples_hash"])
    op.create_index("ix_records_place", "records", ["operator", "aircraft", "position", "started_at"])
    op.create_index("ix_pumps_operator_look", "pumps", ["operator", "look"])


def downgrade() -> None:
    """Drop them."""
    op.drop_index("ix_pumps_operator_look", "pumps")
    op.drop_index("ix_records_place", "records")
    op.drop_index("ix_records_operator_samples_hash", "records")
    op.drop_column("pumps", "look")
    for column in ("remarks", "samples_hash", "finished_at"):
        op.drop_column("records", column)
