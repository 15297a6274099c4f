"""Pumps name the release and the code that made their verdicts, records the software that reduced them.

What is older than that stays empty, and is thereby marked to be made again.
"""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects import postgresql

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None

_JSON = sa.JSON().with_variant(postgresql.JSONB(), "postgresql")


def upgrade() -> None:
    """Add the columns."""
    with op.batch_alter_table("pumps") as batch_op:
        batch_op.add_column(sa.Column("made_by", sa.Integer(), nullable=True))
        batch_op.add_column(sa.Column("made_with", sa.String(), nullable=True))
    with op.batch_alter_table("records") as batch_op:
        batch_op.add_column(sa.Column("reduced_by", _JSON, nullable=True))
        batch_op.add_column(sa.Column("waits_for", sa.Integer(), nullable=True))


def downgrade() -> None:
    """Drop them."""
    with op.batch_alter_table("records") as batch_op:
        batch_op.drop_column("waits_for")
        batch_op.drop_column("reduced_by")
    with op.batch_alter_table("pumps") as batch_op:
        batch_op.drop_column("made_with")
        batch_op.drop_column("made_by")
