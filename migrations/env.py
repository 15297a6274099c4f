"""Alembic's environment: one set of tables, whichever database CASEDRAIN_DATABASE_URL names."""

from alembic import context

from service.settings import Settings
from service.storage.database import Database
from service.storage.tables import Base

config = context.config
url = config.attributes.get("url") or Settings().effective_database_url


def run() -> None:
    """Migrate the database of the settings, or the one handed over by the program."""
    database = Database(url)
    with database.engine.connect() as connection:
        if not database.is_sqlite:
            # a large table takes longer than any request may; whoever waits for a lock keeps all others waiting
            connection.exec_driver_sql("SET statement_timeout = 0")
            connection.exec_driver_sql("SET lock_timeout = '10s'")
            connection.commit()
        context.configure(
            connection=connection,
            target_metadata=Base.metadata,
            compare_type=True,
            render_as_batch=database.is_sqlite,
        )
        with context.begin_transaction():
            context.run_migrations()
        connection.commit()
    database.close()


if context.is_offline_mode():
    context.configure(url=url, target_metadata=Base.metadata, literal_binds=True)
    with context.begin_transaction():
        context.run_migrations()
else:
    run()
