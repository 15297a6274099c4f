"""Alarms with a plan (assignee, due date, work order) and comments."""

import sqlalchemy as sa
from alembic import op

revision = "0015"
down_revision = "0014"
branch_labels = None
depends_on = None

_PLAN = (("assignee", sa.String()), ("due_at", sa.DateTime(timezone=True)), ("work_order", sa.String()))


def upgrade() -> None:
    """Add the columns, empty; lists over all operators get an index of their order."""
    for table in ("alarms", "alarm_actions"):
        for name, kind in _PLAN:
            op.add_column(table, sa.Column(name, kind, nullable=True))
    op.add_column("alarms", sa.Column("comments", sa.Integer(), server_default="0", nullable=False))
    op.create_index("ix_alarms_raised_at", "alarms", ["raised_at"])


def downgrade() -> None:
    """Drop them."""
    op.drop_index("ix_alarms_raised_at", table_name="alarms")
    op.drop_column("alarms", "comments")
    for table in ("alarm_actions", "alarms"):
        for name, _ in reversed(_PLAN):
            op.drop_column(table, name)
