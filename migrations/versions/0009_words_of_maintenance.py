"""Maintenance says which fluid went in and which sensor was replaced.

Entries from before stay without: nobody has said it.
"""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the columns."""
    with op.batch_alter_table("maintenance_events") as batch_op:
        batch_op.add_column(sa.Column("fluid", sa.String(), nullable=True))
        batch_op.add_column(sa.Column("channel", sa.String(), nullable=True))


def downgrade() -> None:
    """Drop them."""
    with op.batch_alter_table("maintenance_events") as batch_op:
        batch_op.drop_column("channel")
        batch_op.drop_column("fluid")
