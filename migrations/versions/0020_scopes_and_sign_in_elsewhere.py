"""Scopes of keys; users whom an issuer signs in, and sign-ins on their way there."""

import sqlalchemy as sa
from alembic import op

revision = "0020"
down_revision = "0018"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the columns, empty, and the table."""
    op.add_column("api_keys", sa.Column("scopes", sa.String(), nullable=True))
    with op.batch_alter_table("users") as users:
        users.add_column(sa.Column("oidc_subject", sa.String(), nullable=True))
        users.create_unique_constraint(op.f("uq_users_oidc_subject"), ["oidc_subject"])
    op.create_table(
        "pending_sign_ins",
        sa.Column("state_hash", sa.String(), nullable=False),
        sa.Column("browser_hash", sa.String(), nullable=False),
        sa.Column("nonce", sa.String(), nullable=False),
        sa.Column("verifier", sa.String(), nullable=False),
        sa.Column("wanted", sa.String(), nullable=False),
        sa.Column("expires_at", sa.DateTime(timezone=True), nullable=False),
        sa.PrimaryKeyConstraint("state_hash", name=op.f("pk_pending_sign_ins")),
    )
    op.create_index("ix_pending_sign_ins_expires_at", "pending_sign_ins", ["expires_at"])


def downgrade() -> None:
    """Drop them; keys with scopes are revoked, or they could do more than they were made for."""
    op.execute("UPDATE api_keys SET revoked_at = created_at WHERE scopes IS NOT NULL AND revoked_at IS NULL")
    op.drop_table("pending_sign_ins")
    with op.batch_alter_table("users") as users:
        users.drop_constraint(op.f("uq_users_oidc_subject"), type_="unique")
        users.drop_column("oidc_subject")
    with op.batch_alter_table("api_keys") as keys:
        keys.drop_column("scopes")
