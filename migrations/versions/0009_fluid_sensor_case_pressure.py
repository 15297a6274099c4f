"""Maintenance says which fluid went in and which sensor was replaced; assessments and alarms, that case pressure is beyond.

Entries from before stay without: nobody has said it. Older verdicts know nothing of the rule: it is false. Columns are
added and dropped in place: a batch would make SQLite's tables anew, and other tables refer to them.
"""

import sqlalchemy as sa
from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the columns."""
    op.add_column("maintenance_events", sa.Column("fluid", sa.String(), nullable=True))
    op.add_column("maintenance_events", sa.Column("channel", sa.String(), nullable=True))
    for table in ("assessments", "alarms"):
        beyond = sa.Column("case_pressure_beyond", sa.Boolean(), server_default=sa.false(), nullable=False)
        op.add_column(table, beyond)


def downgrade() -> None:
    """Drop them."""
    for table in ("alarms", "assessments"):
        op.drop_column(table, "case_pressure_beyond")
    op.drop_column("maintenance_events", "channel")
    op.drop_column("maintenance_events", "fluid")
