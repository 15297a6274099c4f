"""How long an operator's jobs and audit entries are kept, and a hold on all that would go."""

import sqlalchemy as sa
from alembic import op

revision = "0021"
down_revision = "0020"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the columns: everything is kept, nothing is held."""
    op.add_column("operator_settings", sa.Column("job_days", sa.Integer(), nullable=True))
    op.add_column("operator_settings", sa.Column("audit_days", sa.Integer(), nullable=True))
    op.add_column("operator_settings", sa.Column("legal_hold", sa.Boolean(), nullable=False, server_default=sa.false()))


def downgrade() -> None:
    """Drop them; raw bytes of operators under a hold are kept for good, for the release before knows no hold."""
    op.execute(sa.text("UPDATE operator_settings SET retention_days = NULL WHERE legal_hold"))
    with op.batch_alter_table("operator_settings") as settings:
        settings.drop_column("legal_hold")
        settings.drop_column("audit_days")
        settings.drop_column("job_days")
