"""Maintenance says which fluid went in and which sensor was replaced; assessments and alarms, that case pressure is beyond.

Entries from before stay without: nobody has said it. Older verdicts know nothing of the rule: it is false.
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
    for table in ("assessments", "alarms"):
        with op.batch_alter_table(table) as batch_op:
            batch_op.add_column(
                sa.Column("case_pressure_beyond", sa.Boolean(), server_default=sa.false(), nullable=False)
            )


def downgrade() -> None:
    """Drop them."""
    for table in ("alarms", "assessments"):
        with op.batch_alter_table(table) as batch_op:
            batch_op.drop_column("case_pressure_beyond")
    with op.batch_alter_table("maintenance_events") as batch_op:
        batch_op.drop_column("channel")
        batch_op.drop_column("fluid")
