"""What an installation keeps for itself; names of users are unique within an operator, no longer among all of them.

Who was told that a name is taken knew that another operator has somebody of that name. On SQLite the table of users is
made anew, which others may not refer to meanwhile: sessions of users end, they sign in again.
"""

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the table, and exchange the constraint for one over operator and name."""
    op.create_table(
        "installation_values",
        sa.Column("name", sa.String(), nullable=False),
        sa.Column("value", sa.String(), nullable=False),
        sa.PrimaryKeyConstraint("name", name=op.f("pk_installation_values")),
    )
    _end_sessions()
    with op.batch_alter_table("users", schema=None) as batch_op:
        batch_op.drop_constraint(batch_op.f("uq_users_name"), type_="unique")
        batch_op.create_unique_constraint(batch_op.f("uq_users_operator_name"), ["operator", "name"])
    of_all = sa.text("operator IS NULL")
    op.create_index(
        "ix_users_name_of_all", "users", ["name"], unique=True, sqlite_where=of_all, postgresql_where=of_all
    )


def downgrade() -> None:
    """Go back; it fails where two operators have a user of the same name by then."""
    op.drop_index("ix_users_name_of_all", table_name="users")
    _end_sessions()
    with op.batch_alter_table("users", schema=None) as batch_op:
        batch_op.drop_constraint(batch_op.f("uq_users_operator_name"), type_="unique")
        batch_op.create_unique_constraint(batch_op.f("uq_users_name"), ["name"])
    op.drop_table("installation_values")


def _end_sessions() -> None:
    if op.get_bind().dialect.name == "sqlite":
        op.execute("DELETE FROM sessions WHERE user_id IS NOT NULL")
