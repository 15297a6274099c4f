"""How a pump stands by its newest record, kept beside it; verdicts are found by the aircraft they were made in."""

import sqlalchemy as sa
from alembic import op
from sqlalchemy.dialects.postgresql import JSONB

revision = "0022"
down_revision = "0021"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the columns, empty: the next fold of a pump fills them, or the housekeeping after the start."""
    op.add_column("pumps", sa.Column("standing", sa.JSON().with_variant(JSONB(), "postgresql"), nullable=True))
    op.add_column("pumps", sa.Column("standing_at", sa.Integer(), nullable=True))
    op.add_column("pumps", sa.Column("standing_link", sa.String(), nullable=True))
    op.create_index("ix_assessments_aircraft_pump_id_at", "assessments", ["aircraft", "pump_id", "at"])


def downgrade() -> None:
    """Drop them."""
    op.drop_index("ix_assessments_aircraft_pump_id_at", "assessments")
    op.drop_column("pumps", "standing_link")
    op.drop_column("pumps", "standing_at")
    op.drop_column("pumps", "standing")
