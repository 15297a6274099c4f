"""A pump's revision: a fold that was made without a lock sees by it whether anything has changed meanwhile."""

import sqlalchemy as sa
from alembic import op

revision = "0018"
down_revision = "0017"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Every pump begins with 0."""
    op.add_column("pumps", sa.Column("revision", sa.Integer(), server_default="0", nullable=False))


def downgrade() -> None:
    """Drop the column."""
    op.drop_column("pumps", "revision")
